"""What was driven before a start: what baselines know that see no image."""

import numpy as np
from numpy.typing import NDArray

from lss_core.data.samples import TIME_TOLERANCE_S
from lss_core.geometry import FloatArray
from shoot.footprint import turn
from shoot.trajectories.poses import check_poses, positions_at

# The past has times of its own, whatever those of the templates: baselines read it.
PAST_S = 2.0
PAST_DT_S = 0.25


def past_from_poses(
    times_s: FloatArray,
    xy_m: FloatArray,
    yaw_rad: FloatArray,
    starts_s: FloatArray,
    past_s: float = PAST_S,
    dt_s: float = PAST_DT_S,
) -> tuple[FloatArray, NDArray[np.bool_]]:
    """Where the ego was in the seconds before each start, seen from the start.

    Positions are interpolated linearly in time between the recorded poses, so nothing after the
    start takes part if each start is the time of a pose.

    Args:
        times_s: [P] strictly increasing, at least one.
        xy_m: [P, 2] ego origin in a fixed frame.
        yaw_rad: [P] heading in the same frame; jumps by 2 pi are allowed.
        starts_s: [S] moments to look back from, within the recorded time.
        past_s: How far back.
        dt_s: Time between points; the first point is `dt_s` before the start.

    Returns:
        [S, P, 2] points, the latest first, x forward and y left at the start; zero where the
        recording does not reach back that far. [S, P] where it does.

    Raises:
        ValueError: If poses or starts are not finite or of other shapes, or times do not increase.
    """
    check_poses(times_s, xy_m, yaw_rad, starts_s)
    behind_s = starts_s[:, None] - dt_s * np.arange(1, round(past_s / dt_s) + 1)
    known = behind_s >= times_s[0] - TIME_TOLERANCE_S
    moved_m = positions_at(times_s, xy_m, behind_s) - positions_at(times_s, xy_m, starts_s)[:, None]
    yaw = np.interp(starts_s, times_s, np.unwrap(yaw_rad))
    return np.where(known[..., None], turn(moved_m, -yaw[:, None]), 0.0), known


def recent_motion(
    times_s: FloatArray,
    xy_m: FloatArray,
    yaw_rad: FloatArray,
    starts_s: FloatArray,
    window_s: float = 0.5,
) -> tuple[FloatArray, FloatArray]:
    """Velocity in the ego frame and yaw rate, from poses at and before each start only."""
    before_s = np.maximum(starts_s - window_s, times_s[0])
    elapsed_s = starts_s - before_s
    safe_s = np.where(elapsed_s > 0.0, elapsed_s, 1.0)
    heading = np.unwrap(yaw_rad)
    yaw = np.interp(starts_s, times_s, heading)
    moved_m = positions_at(times_s, xy_m, starts_s) - positions_at(times_s, xy_m, before_s)
    velocity = turn(moved_m, -yaw) / safe_s[:, None]
    turned = (yaw - np.interp(before_s, times_s, heading)) / safe_s
    return velocity, turned
