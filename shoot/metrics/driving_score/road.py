"""Whether the ego kept to the road, its direction and its lane: DAC, DDC and LK."""

from typing import Any

import numpy as np
import shapely
from jaxtyping import Bool, Float

from shoot.metrics.driving_score.surroundings import Surroundings, Whereabouts
from shoot.metrics.driving_score.tracks import Track

Array = np.ndarray[Any, np.dtype[Any]]

# nuPlan lets corners stand out by this much; navsim by nothing.
NUPLAN_TOLERANCE_M = 0.3

DIRECTION_WINDOW_S = 1.0
COMPLIANT_BELOW_M, VIOLATED_FROM_M = 2.0, 6.0

OFF_CENTRE_M = 0.5
OFF_CENTRE_S = 2.0


def drivable_area(where: Whereabouts, tolerance_m: float = 0.0) -> float:
    """DAC: 0 if a corner is ever more than the tolerance off drivable ground, else 1."""
    return float(not (where.off_road_m > tolerance_m).any())


def moves(ego: Track) -> Float[Array, " T"]:
    """Metres that the middle of the footprint has moved since the step before; 0 at the first."""
    moved_m = np.linalg.norm(np.diff(ego.centre_m, axis=0), axis=-1)
    return np.concatenate([[0.0], moved_m])


def is_against(ego: Track, around: Surroundings, where: Whereabouts) -> Bool[Array, " T"]:
    """The steps that were driven against the route's direction.

    The middle of the footprint is in none of its lanes, or moves against the traffic of all that it
    is in. Intersections are left out.
    """
    on_route = where.is_centre_in_lane & around.lanes.is_on_route
    step, lane = np.nonzero(on_route)
    moved_m = np.diff(ego.centre_m, axis=0, prepend=ego.centre_m[:1])[step]
    along = np.zeros_like(on_route)
    direction = around.lanes.direction(lane, ego.centre_m[step])
    along[step, lane] = (moved_m * direction).sum(axis=-1) >= 0.0
    against: Array = ~along.any(axis=-1) & ~where.is_centre_in_intersection
    return against


def driving_direction(ego: Track, against: Bool[Array, " T"]) -> float:
    """DDC: by the most metres within 1 s against the direction: below 2 m 1, below 6 m 1/2, else 0.

    Args:
        ego: Its track.
        against: See `is_against`.
    """
    covered_m = np.cumsum(np.concatenate([[0.0], moves(ego) * against]))
    window = min(len(ego), ego.steps_in(DIRECTION_WINDOW_S))
    most_m = (covered_m[window:] - covered_m[:-window]).max()
    if most_m < COMPLIANT_BELOW_M:
        return 1.0
    return 0.5 if most_m < VIOLATED_FROM_M else 0.0


def lane_keeping(ego: Track, around: Surroundings, where: Whereabouts) -> float:
    """LK: 0 if the middle is more than 0.5 m off the route's centre line for 2 s on end, else 1.

    Steps in intersections neither count nor end a stretch.
    """
    off_m = shapely.distance(around.route, shapely.points(ego.centre_m))
    is_off = np.asarray(off_m > OFF_CENTRE_M)[~where.is_centre_in_intersection]
    since = np.arange(1, len(is_off) + 1)
    on_end = since - np.maximum.accumulate(np.where(is_off, 0, since))
    longest = on_end.max(initial=0)
    return float(longest < int(np.ceil(OFF_CENTRE_S / ego.dt_s - 1e-6)))
