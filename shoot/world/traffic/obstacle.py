"""The ego as something that stands or moves in the way: what it is in the way of."""

import math
from functools import lru_cache

import numpy as np
import shapely
from numpy.typing import NDArray

from lss_core.geometry import FloatArray
from shoot.footprint import (
    EGO_LENGTH_M,
    EGO_REAR_M,
    EGO_WIDTH_M,
    footprint_centres,
    rectangles_overlap,
    turn,
)
from shoot.world.town.town import Town
from shoot.world.traffic.bodies import EgoBody
from shoot.world.traffic.cars import Car
from shoot.world.traffic.driver import ROUTE_STEP_M

# Of others' way: what they leave between themselves and the ego at the least.
AIR_M = 0.3
# Half of somebody on foot, and the same air.
WALKER_ROOM_M = 0.6
# An ego that could still stop before somebody, braking so, is not in the way yet.
LAST_BRAKE_MPS2 = 4.0
# Who is to step onto a crosswalk trusts an ego to brake so, and to stop so far before it.
SAFE_BRAKE_MPS2, SAFE_ROOM_M = 2.6, 0.5
PATH_HALF_M = 1.35

Geometries = NDArray[np.object_]
EGO_SIZE_M = np.array([EGO_LENGTH_M, EGO_WIDTH_M])
EGO_FRONT_M = EGO_LENGTH_M - EGO_REAR_M


def gap_ahead(ego: EgoBody, car: Car, sight_m: float) -> tuple[float, float] | None:
    """(room before the ego on a car's route, the ego's speed in that direction), if it is there.

    The room is how far the car can go until its front half would touch the ego, with a little air
    around it: an ego close behind is not in its way. A car that the ego overlaps has none.

    Args:
        ego: Wherever it is.
        car: Another one, on its route.
        sight_m: How far ahead the car looks.
    """
    first = int(car.at_m / ROUTE_STEP_M)
    ahead = slice(first, first + int(sight_m / ROUTE_STEP_M) + 1)
    axle_m, yaw_rad = car.route.xy_m[ahead], car.route.yaw_rad[ahead]
    reach_m = float(car.size_m[0]) + EGO_LENGTH_M + AIR_M
    near = np.flatnonzero(np.hypot(*(axle_m - ego.xy_m).T) < reach_m)
    if not len(near):
        return None
    box_m, box_rad = car.box(np.array([car.at_m]))
    if _overlaps(ego, box_m, box_rad, car.size_m[:2], 0.0)[0]:
        return 0.0, 0.0
    along = np.stack([np.cos(yaw_rad[near]), np.sin(yaw_rad[near])], axis=1)
    half_m = axle_m[near] + along * car.front_m / 2
    size_m = np.array([car.front_m, car.size_m[1]])
    hits = np.flatnonzero(_overlaps(ego, half_m, yaw_rad[near], size_m, AIR_M))
    if not len(hits):
        return None
    hit = int(near[hits[0]])
    # It may have come to touch at any point of the last half metre.
    gap_m = (first + hit - 1) * ROUTE_STEP_M - car.at_m
    return max(gap_m, 0.0), max(ego.speed_mps * math.cos(ego.yaw_rad - yaw_rad[hit]), 0.0)


def _overlaps(
    ego: EgoBody, centre_m: FloatArray, yaw_rad: FloatArray, size_m: FloatArray, air_m: float
) -> NDArray[np.bool_]:
    ego_rad = np.array([ego.yaw_rad])
    ego_m = footprint_centres(ego.xy_m[None], ego_rad)
    ego_size_m = (EGO_SIZE_M + 2 * air_m)[None]
    return rectangles_overlap(centre_m, yaw_rad, size_m[None], ego_m, ego_rad, ego_size_m)


def occupied_paths(ego: EgoBody, town: Town) -> frozenset[int]:
    """Paths across intersections that the ego stands on, index into `Town.lanes`."""
    paths, areas = _path_areas(town)
    return frozenset(paths[shapely.intersects(areas, _reach(ego, 0.0))].tolist())


def threatened_crosswalks(ego: EgoBody, town: Town) -> frozenset[int]:
    """Crosswalks that the ego stands on or could not stop before, index into `Town.crosswalks`."""
    stop_m = ego.speed_mps**2 / (2 * SAFE_BRAKE_MPS2) + SAFE_ROOM_M
    touched = shapely.intersects(_crosswalk_areas(town), _reach(ego, stop_m))
    return frozenset(np.flatnonzero(touched).tolist())


def bars_way(ego: EgoBody, from_m: FloatArray, to_m: FloatArray) -> bool:
    """Whether somebody on foot had better not take a step, since the ego stands there or comes.

    A step into the ego's side, front or rear is barred, and one onto the ground it is about to
    cover and can hardly stop before. Who is there already walks on, as one does.

    Args:
        ego: Wherever it is.
        from_m: [2] where the step begins, in the town's frame.
        to_m: [2] where it ends.
    """
    cos, sin = math.cos(ego.yaw_rad), math.sin(ego.yaw_rad)
    ego_axes = np.array([[cos, -sin], [sin, cos]])
    before, after = ((np.stack([from_m, to_m]) - ego.xy_m) @ ego_axes).tolist()
    half_m = EGO_WIDTH_M / 2 + WALKER_ROOM_M
    if abs(after[1]) >= half_m or after[0] < -EGO_REAR_M - WALKER_ROOM_M:
        return False
    if after[0] < EGO_FRONT_M + WALKER_ROOM_M:
        middle_m = EGO_LENGTH_M / 2 - EGO_REAR_M
        is_nearer = math.hypot(after[0] - middle_m, after[1]) < math.hypot(
            before[0] - middle_m, before[1]
        )
        return is_nearer
    brake_m = ego.speed_mps**2 / (2 * LAST_BRAKE_MPS2)
    return bool(after[0] < EGO_FRONT_M + WALKER_ROOM_M + brake_m and abs(before[1]) >= half_m)


def _reach(ego: EgoBody, ahead_m: float) -> shapely.Polygon:
    """The ego's footprint and so much of what lies before it."""
    front_m, half_m = EGO_FRONT_M + ahead_m, EGO_WIDTH_M / 2
    corners_m = np.array(
        [[front_m, half_m], [-EGO_REAR_M, half_m], [-EGO_REAR_M, -half_m], [front_m, -half_m]]
    )
    return shapely.Polygon(ego.xy_m + turn(corners_m, np.full(4, ego.yaw_rad)))


@lru_cache(maxsize=1)
def _path_areas(town: Town) -> tuple[NDArray[np.int64], Geometries]:
    """Each path across an intersection, and the ground a large vehicle covers on it."""
    paths = [lane for lane in town.lanes if lane.turn is not None]
    lines = np.array([shapely.LineString(lane.centreline_m) for lane in paths])
    areas = shapely.buffer(lines, PATH_HALF_M, cap_style="flat")
    shapely.prepare(areas)
    return np.array([lane.lane_id for lane in paths], dtype=np.int64), areas


@lru_cache(maxsize=1)
def _crosswalk_areas(town: Town) -> Geometries:
    areas = np.array([shapely.Polygon(walk.outline_m) for walk in town.crosswalks])
    shapely.prepare(areas)
    return areas
