"""How far the ego got along its route: EP."""

import numpy as np
import shapely

from shoot.metrics.driving_score.surroundings import Surroundings
from shoot.metrics.driving_score.tracks import Track

# Where nobody gets farther than this, nobody has to.
LITTLE_M = 5.0


def measure_progress(ego: Track, around: Surroundings) -> float:
    """Metres along the route's centre line from the first to the last step; 0 if it went back."""
    first, last = (shapely.Point(ego.centre_m[step]) for step in (0, -1))
    return max(0.0, float(around.route.project(last) - around.route.project(first)))


def ego_progress(progress_m: float, multiplier: float, reference_m: float) -> float:
    """EP: progress as a share of the largest that counts, at most 1; 1 if that is at most 5 m.

    Args:
        progress_m: The ego's, see `measure_progress`.
        multiplier: NC * DAC * DDC * TLC of the ego.
        reference_m: What a rule-driven car got in its place, times its own multipliers.
    """
    largest_m = max(progress_m * multiplier, reference_m)
    if largest_m <= LITTLE_M:
        return 1.0
    return float(np.clip(progress_m / largest_m, 0.0, 1.0))
