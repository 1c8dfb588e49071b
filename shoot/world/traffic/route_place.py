"""Where on a route a car is that may stand beside it."""

from dataclasses import dataclass

import numpy as np

from lss_core.geometry import wrap_angle
from shoot.world.traffic.bodies import EgoBody
from shoot.world.traffic.driver import ROUTE_STEP_M, Route

OFF_ROUTE_M, OFF_ROUTE_RAD = 2.0, np.pi / 3
# Who left its route may come back to it so far on. Farther on it is the route of another time: in a
# town's blocks most routes come by again.
BACK_M, AHEAD_M = 30.0, 100.0


@dataclass(frozen=True)
class RoutePlace:
    """The nearest point of a route.

    Attributes:
        at_m: Its arc length.
        off_m: How far the rear axle is from it.
        off_rad: How far the heading is from the route's there.
    """

    at_m: float
    off_m: float
    off_rad: float


def find_place(route: Route, body: EgoBody, near_m: float) -> RoutePlace | None:
    """Where on its route a car is, or None if it has left it.

    It keeps to its route while its rear axle is within `OFF_ROUTE_M` of it and its heading within
    `OFF_ROUTE_RAD` of the route's. A route may pass one place twice: then `near_m` decides. Its
    last lanes, from where on there is no next intersection to ask for, do not count.

    Args:
        route: To be followed.
        body: Rear axle and heading, in the town's frame.
        near_m: Arc length where it was last.
    """
    at_m = np.arange(len(route.xy_m)) * ROUTE_STEP_M
    counts = (at_m > near_m - BACK_M) & (at_m < min(near_m + AHEAD_M, route.starts_m[-4]))
    away_m = np.hypot(*(route.xy_m - body.xy_m).T)
    away_rad = np.abs(wrap_angle(route.yaw_rad - body.yaw_rad))
    counts &= (away_m < OFF_ROUTE_M + ROUTE_STEP_M) & (away_rad < OFF_ROUTE_RAD)
    near = np.flatnonzero(counts)
    if not len(near):
        return None
    passes = np.split(near, np.flatnonzero(np.diff(near) > 1) + 1)
    same = min(passes, key=lambda idx: float(np.abs(idx * ROUTE_STEP_M - near_m).min()))
    nearest = int(same[np.argmin(away_m[same])])
    found = [
        _on_chord(route, body, i)
        for i in (nearest - 1, nearest)
        if 0 <= i < len(route.xy_m) - 1
    ]  # fmt: skip
    place = min(found, key=lambda place: place.off_m)
    return None if place.off_m > OFF_ROUTE_M or place.off_rad > OFF_ROUTE_RAD else place


def _on_chord(route: Route, body: EgoBody, i: int) -> RoutePlace:
    start_m, end_m = route.xy_m[i], route.xy_m[i + 1]
    chord_m = end_m - start_m
    share = float(np.clip((body.xy_m - start_m) @ chord_m / (chord_m @ chord_m), 0.0, 1.0))
    off_m = float(np.hypot(*(start_m + share * chord_m - body.xy_m)))
    yaw_rad = route.yaw_rad[i] + share * (route.yaw_rad[i + 1] - route.yaw_rad[i])
    off_rad = abs(float(wrap_angle(np.asarray(yaw_rad - body.yaw_rad))))
    return RoutePlace((i + share) * ROUTE_STEP_M, off_m, off_rad)
