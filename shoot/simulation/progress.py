"""How far along its route the ego is, also beside it and where the route comes by again."""

import numpy as np

from lss_core.geometry import FloatArray, wrap_angle
from shoot.simulation.vehicle import VehicleState
from shoot.world.traffic.driver import ROUTE_STEP_M, Route

# A heading off the route's by a radian counts as so far away from it.
_METRES_PER_RAD = 10.0
# Between two looks nobody drives further; further on it is the route of another time.
_BACK_M, _AHEAD_M = 10.0, 20.0


def first_place(route: Route, state: VehicleState) -> float:
    """Arc length in metres of the route's point nearest to the ego, where it comes by first."""
    away = _away(route, state)
    about_m = float(np.argmax(away <= away.min() + ROUTE_STEP_M)) * ROUTE_STEP_M
    return next_place(route, state, about_m)


def next_place(route: Route, state: VehicleState, near_m: float) -> float:
    """Arc length in metres of the route's point nearest to the ego, near where it was last.

    Args:
        route: Its way.
        state: Where it is.
        near_m: What the last look said.
    """
    at_m = np.arange(len(route.xy_m)) * ROUTE_STEP_M
    is_near = (at_m >= near_m - _BACK_M) & (at_m <= near_m + _AHEAD_M)
    return float(at_m[np.argmin(np.where(is_near, _away(route, state), np.inf))])


def _away(route: Route, state: VehicleState) -> FloatArray:
    """[Q] how far off each point of the route the ego is, in metres, headings included."""
    away_m = np.hypot(route.xy_m[:, 0] - state.x_m, route.xy_m[:, 1] - state.y_m)
    away: FloatArray = away_m + _METRES_PER_RAD * np.abs(wrap_angle(route.yaw_rad - state.yaw_rad))
    return away
