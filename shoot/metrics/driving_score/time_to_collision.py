"""Whether the ego would hit someone if it went on as it does: TTC."""

from typing import Any

import numpy as np
from jaxtyping import Bool

from shoot.metrics.driving_score.collisions import AHEAD_RAD, BEHIND_RAD, off_heading
from shoot.metrics.driving_score.surroundings import Whereabouts
from shoot.metrics.driving_score.tracks import Others, Track

Array = np.ndarray[Any, np.dtype[Any]]

LOOK_AHEAD_S = (0.0, 0.3, 0.6, 0.9)
# Slower steps are skipped.
STOPPED_MPS = 0.005


def near_collisions(ego: Track, others: Others, where: Whereabouts) -> Bool[Array, " T"]:
    """The steps at which the ego is about to hit someone who should have been heeded.

    The footprint is moved on along its heading at its speed by 0, 0.3, 0.6 and 0.9 s, and compared
    with where the others are by then. A near collision counts if the other lies ahead (its middle
    within 30 degrees of the heading, seen from the rear axle now), or else not behind (150 degrees)
    while the ego is in several lanes, off the road or in an intersection.

    How it began decides: while an other goes on being in the way, it is judged by the first step.
    One that is touched at step 0 is not looked at before they are apart. Steps of which it is not
    known where the others are 0.9 s later are left out.
    """
    delays = [ego.steps_in(ahead_s) for ahead_s in LOOK_AHEAD_S]
    num_steps = max(0, min(len(ego), others.yaw_rad.shape[1] - max(delays)))
    found = np.zeros(len(ego), dtype=bool)
    now = slice(num_steps)
    way = np.stack([np.cos(ego.yaw_rad[now]), np.sin(ego.yaw_rad[now])], axis=-1)
    is_hit = np.stack(
        [
            others.overlap(
                ego.centre_m[now] + way * (ego.speed_mps[now] * delay * ego.dt_s)[:, None],
                ego.yaw_rad[now],
                delay=delay,
            )
            for delay in delays
        ],
        axis=-1,
    )
    is_hit &= (np.abs(ego.speed_mps[now]) >= STOPPED_MPS)[:, None]
    in_way = is_hit.any(axis=-1)
    begins = in_way.copy()
    begins[:, 1:] &= ~in_way[:, :-1]
    begins[:, :1] &= ~others.overlap(ego.centre_m[:1], ego.yaw_rad[:1])[:, : begins[:, :1].shape[1]]
    other, step = np.nonzero(begins)
    # Who is not there yet is seen where the ego would meet it.
    delay = np.array(delays)[is_hit[other, step].argmax(axis=-1)]
    seen = step + np.where(others.is_present[other, step], 0, delay)
    off_rad = off_heading(ego, step, others.centre_m[other, seen])
    must_heed = where.is_in_several_lanes | (where.off_road_m > 0.0) | where.is_axle_in_intersection
    counts = (off_rad <= AHEAD_RAD) | (must_heed[step] & (off_rad < BEHIND_RAD))
    found[step[counts]] = True
    return found


def time_to_collision(ego: Track, others: Others, where: Whereabouts) -> float:
    """TTC: 0 if there is a near collision, see `near_collisions`, else 1."""
    return float(not near_collisions(ego, others, where).any())
