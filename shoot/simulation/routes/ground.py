"""What lies beneath a driven route: road, lanes, the route's centre line, lights."""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import shapely
from numpy.typing import NDArray

from lss_core.geometry import FloatArray, direction_of
from shoot.metrics.driving_score.road import moves
from shoot.metrics.driving_score.surroundings import Lanes, Lights, Surroundings, locate
from shoot.metrics.driving_score.tracks import Track
from shoot.simulation.route_lanes import ground_of, lanes_of_route
from shoot.world.town.town import Lane, Town
from shoot.world.traffic.driver import ROUTE_STEP_M, follow_lanes
from shoot.world.traffic.recording import RED

# The route reaches so far behind its start and beyond what was reached, and no further: it may come
# by again, and progress is measured to the nearest point.
_BEHIND_M, _BEYOND_M = 10.0, 30.0


@dataclass(frozen=True)
class Ground:
    """The surroundings that scores take, in two readings of who drives against the route.

    Attributes:
        lawful: All lanes may be driven in their direction.
        is_on_route: [L] lanes of the route, their neighbours in the same direction included.
    """

    lawful: Surroundings
    is_on_route: NDArray[np.bool_]

    @cached_property
    def strict(self) -> Surroundings:
        """As navsim has it: who is in no lane of the route drives against it."""
        lanes = replace(self.lawful.lanes, is_on_route=self.is_on_route)
        return replace(self.lawful, lanes=lanes)

    def off_route_m(self, ego: Track) -> float:
        """Metres that the ego drove in no lane of the route, intersections left out."""
        where = locate(ego, self.strict)
        is_off = ~(where.is_centre_in_lane & self.is_on_route).any(axis=-1)
        return float(moves(ego)[is_off & ~where.is_centre_in_intersection].sum())


def ground_of_route(
    town: Town,
    route_lanes: tuple[int, ...],
    route_at_m: FloatArray,
    ego: Track,
    signal_state: NDArray[np.int64],
) -> Ground:
    """Road, lanes, route and lights around a track.

    Args:
        town: Where.
        route_lanes: Lanes and paths of the route, in order.
        route_at_m: [T] how far along the route the ego was.
        ego: Its track at the same steps.
        signal_state: [T, signals] at the steps of the track.
    """
    places, route_m = _part_of_route(town, route_lanes, route_at_m)
    on_route = lanes_of_route(town, route_lanes, places)
    lanes = Lanes(
        tuple(lane.centreline_m for lane in town.lanes),
        np.array([lane.width_m for lane in town.lanes]),
        np.ones(len(town.lanes), dtype=np.bool_),
    )
    surroundings = Surroundings(
        drivable=town.road,
        lanes=lanes,
        route_m=route_m,
        intersections=tuple(shapely.Polygon(one.outline_m) for one in town.intersections),
        lights=_lights(town, on_route, ego, signal_state),
    )
    return Ground(surroundings, np.array([lane.lane_id in on_route for lane in town.lanes]))


def _part_of_route(
    town: Town, route_lanes: tuple[int, ...], route_at_m: FloatArray
) -> tuple[list[int], FloatArray]:
    """(places of lanes in the route, [R, 2] centre line) of what of it could be reached."""
    route = follow_lanes([town.lanes[i] for i in route_lanes], pace=1.0)
    low_m, high_m = route_at_m.min() - _BEHIND_M, route_at_m.max() + _BEYOND_M
    starts_m = np.array(route.starts_m)
    places = np.flatnonzero((starts_m[1:] > low_m) & (starts_m[:-1] < high_m))
    points_m = np.arange(len(route.xy_m)) * ROUTE_STEP_M
    return places.tolist(), route.xy_m[(points_m >= low_m) & (points_m <= high_m)]


def _lights(town: Town, on_route: set[int], ego: Track, signal_state: NDArray[np.int64]) -> Lights:
    """Those of the route; where the ego came on another lane, those of all paths behind it."""
    behind: dict[int, set[int]] = {}
    for lane in town.lanes:
        if lane.signal is None:
            continue
        paths = set(lane.successors)
        if not _has_driven(ego, lane):
            paths &= on_route if lane.lane_id in on_route else set()
        if paths:
            behind.setdefault(lane.signal, set()).update(paths)
    if not behind:
        return Lights()
    signals = sorted(behind)
    grounds = tuple(ground_of(town, behind[signal], "flat") for signal in signals)
    return Lights(grounds, signal_state[:, signals].T == RED)


def _has_driven(ego: Track, lane: Lane) -> bool:
    """Whether the middle of the car was ever on a lane, and looked along it."""
    line = shapely.LineString(lane.centreline_m)
    ground = shapely.buffer(line, lane.width_m / 2, cap_style="flat")
    is_on = shapely.contains_xy(ground, ego.centre_m[:, 0], ego.centre_m[:, 1])
    if not is_on.any():
        return False
    along_m = shapely.line_locate_point(line, shapely.points(ego.centre_m[is_on]))
    nearest = np.clip(
        np.searchsorted(np.cumsum(np.hypot(*np.diff(lane.centreline_m, axis=0).T)), along_m),
        0,
        len(lane.centreline_m) - 2,
    )
    lane_rad = direction_of(np.diff(lane.centreline_m, axis=0))[nearest]
    return bool((np.cos(ego.yaw_rad[is_on] - lane_rad) > 0.0).any())
