"""What happened on a drive, in plain numbers: collisions, metres, seconds."""

from dataclasses import dataclass
from typing import Any

import numpy as np
import shapely
from jaxtyping import Bool

from shoot.footprint import EGO_LENGTH_M, EGO_REAR_M, EGO_WIDTH_M, turn
from shoot.metrics.driving_score.collisions import Contact, find_contacts
from shoot.metrics.driving_score.lights import count_red_lights, red_touches
from shoot.metrics.driving_score.progress import measure_progress
from shoot.metrics.driving_score.road import is_against, moves
from shoot.metrics.driving_score.smoothness import feel
from shoot.metrics.driving_score.surroundings import Surroundings, locate
from shoot.metrics.driving_score.time_to_collision import near_collisions
from shoot.metrics.driving_score.tracks import Others, Track

Array = np.ndarray[Any, np.dtype[Any]]

# A car that is slower stands.
STUCK_MPS = 0.1
# What may make it wait lies within this distance of the front bumper, and this far aside of its
# flanks: people about to cross included.
WAITS_AHEAD_M, WAITS_ASIDE_M = 10.0, 1.0


@dataclass(frozen=True)
class Facts:
    """What happened on a drive.

    Attributes:
        contacts: The first contact with each other, with its fault and its step.
        driven_m: Metres that the middle of the car moved.
        progress_m: Of these, along the route.
        off_road_m: Metres driven with a corner off drivable ground.
        against_m: Metres driven in no lane of the route, or against its direction, intersections
            left out.
        red_lights: How often a red light was run.
        near_collisions: How many of the steps were nearly a collision, as TTC counts them.
        stuck_s: Time that it stood with no reason to, see `is_stuck`.
        max_accel_mps2, max_brake_mps2: Strongest, smoothed as for comfort; both at least 0.
        max_lat_accel_mps2, max_jerk_mps3, max_yaw_rate_radps: Largest amounts, smoothed likewise.
    """

    contacts: tuple[Contact, ...]
    driven_m: float
    progress_m: float
    off_road_m: float
    against_m: float
    red_lights: int
    near_collisions: int
    stuck_s: float
    max_accel_mps2: float
    max_brake_mps2: float
    max_lat_accel_mps2: float
    max_jerk_mps3: float
    max_yaw_rate_radps: float


def collect_facts(
    ego: Track, others: Others, around: Surroundings, strict_lights: bool = False
) -> Facts:
    """What happened, of the same arrays that `epdms` scores.

    Raises:
        ValueError: If the track has fewer than 4 steps, or lights have others.
    """
    where = locate(ego, around)
    moved_m = moves(ego)
    felt = feel(ego)
    return Facts(
        contacts=find_contacts(ego, others, where),
        driven_m=float(moved_m.sum()),
        progress_m=measure_progress(ego, around),
        off_road_m=float(moved_m[where.off_road_m > 0.0].sum()),
        against_m=float(moved_m[is_against(ego, around, where)].sum()),
        red_lights=count_red_lights(around, red_touches(ego, around, where, strict_lights)),
        near_collisions=int(near_collisions(ego, others, where).sum()),
        stuck_s=float(is_stuck(ego, others, around).sum() * ego.dt_s),
        max_accel_mps2=float(felt.lon_accel_mps2.max(initial=0.0)),
        max_brake_mps2=float((-felt.lon_accel_mps2).max(initial=0.0)),
        max_lat_accel_mps2=float(np.abs(felt.lat_accel_mps2).max()),
        max_jerk_mps3=float(np.abs(felt.jerk_mps3).max()),
        max_yaw_rate_radps=float(np.abs(felt.yaw_rate_radps).max()),
    )


def is_stuck(ego: Track, others: Others, around: Surroundings) -> Bool[Array, " T"]:
    """The steps at which the ego stands and nothing shows why.

    It is slower than 0.1 m/s. Nobody is in the rectangle before its front bumper that is 10 m long
    and reaches 1 m beyond either flank, and no connector of a red light touches that.
    """
    length_m = EGO_LENGTH_M - EGO_REAR_M
    before_m = np.tile([length_m + WAITS_AHEAD_M / 2, 0.0], (len(ego), 1))
    middle_m = ego.xy_m + turn(before_m, ego.yaw_rad)
    size_m = np.array([WAITS_AHEAD_M, EGO_WIDTH_M + 2.0 * WAITS_ASIDE_M])
    waits = others.overlap(middle_m, ego.yaw_rad, size_m).any(axis=0)
    if around.lights.connectors:
        corners_m = size_m / 2 * np.array([[1, 1], [-1, 1], [-1, -1], [1, -1]])
        ground_m = middle_m[:, None] + turn(corners_m[None], ego.yaw_rad[:, None])
        connectors = np.array(around.lights.connectors, dtype=object)[:, None]
        near = shapely.intersects(connectors, shapely.polygons(ground_m))
        waits |= (near & around.lights.is_red).any(axis=0)
    return np.asarray((np.abs(ego.speed_mps) < STUCK_MPS) & ~waits)
