"""The ego's x axis held against the direction in which the car drives."""

import numpy as np
from numpy.typing import NDArray

from lss_core.data.tables.tracks import Motion
from lss_core.geometry import FloatArray, wrap_angle

# Further off than mountings, slip or another origin of the ego frame explain.
_OFF_RAD = np.deg2rad(20.0)
_OPPOSED_RAD = np.deg2rad(150.0)
# Nobody reverses faster than this for longer.
_REVERSE_MPS = 5.0
_REVERSE_S = 2.0
# Less driving than this says nothing by itself.
_ENOUGH_S = 1.5
# Slow scenes may all be driven backwards where there are fewer.
_MANY = 3
# An offset of a whole data set that is worth a word.
_DOUBTFUL_RAD = np.deg2rad(5.0)


def heading_flaws(motion: Motion) -> dict[int, str]:
    """What is measured in those scenes whose x axis does not point where they drive.

    Reversing is a car's good right: slow motion counts by its line only, unless most scenes of a
    data set would be driven backwards.
    """
    if not len(motion.scene):
        return {}
    num = int(motion.scene.max()) + 1

    def seconds(of: NDArray[np.bool_]) -> FloatArray:
        total_s = np.bincount(motion.scene[of], motion.lasts_s[of], minlength=num)
        return total_s.astype(np.float64)

    everything = np.ones(len(motion.scene), dtype=bool)
    is_fast = motion.speed_mps >= _REVERSE_MPS
    counts_fast = is_fast & (seconds(is_fast) >= _REVERSE_S)[motion.scene]
    line_rad = 0.5 * wrap_angle(2.0 * motion.angle_rad)
    away_rad = np.abs(np.where(counts_fast, motion.angle_rad, line_rad))
    moving_s = seconds(everything)
    is_long = moving_s >= _ENOUGH_S
    is_off = _medians(motion.scene, away_rad, num) > _OFF_RAD
    # Scenes that are too short count together.
    short = ~is_long[motion.scene]
    if motion.lasts_s[short].sum() >= _ENOUGH_S and np.median(away_rad[short]) > _OFF_RAD:
        is_long[:] = True
    bad = is_off & is_long
    opposed_s = seconds(np.abs(motion.angle_rad) > _OPPOSED_RAD)
    is_opposed = (opposed_s >= 0.9 * moving_s) & (moving_s >= _ENOUGH_S)
    is_most = is_opposed.sum() >= _MANY and is_opposed.sum() > 0.5 * (moving_s >= _ENOUGH_S).sum()
    if is_most or (bad & is_opposed).any():
        bad |= is_opposed
    return {
        scene: f"{_in_words(motion, scene)} (while it drives, {moving_s[scene]:.0f} s)"
        for scene in np.flatnonzero(bad).tolist()
    }


def heading_offset(motion: Motion, left_out: list[int]) -> str:
    """What is measured if the headings of a whole data set are off by a little; else empty.

    Args:
        motion: Of the data set.
        left_out: Scenes that are known to be wrong.
    """
    own = (motion.speed_mps >= _REVERSE_MPS) & ~np.isin(motion.scene, left_out)
    if motion.lasts_s[own].sum() < _ENOUGH_S:
        return ""
    off_rad = float(np.median(motion.angle_rad[own]))
    if abs(off_rad) < _DOUBTFUL_RAD:
        return ""
    return (
        f"the ego's x axis points {'left' if off_rad > 0 else 'right'} of its motion by "
        f"{abs(np.rad2deg(off_rad)):.0f} degrees (median over {motion.lasts_s[own].sum():.0f} s of "
        f"driving in {len(np.unique(motion.scene[own]))} scenes)"
    )


def median_angles(motion: Motion, num: int) -> FloatArray:
    """[num] by scene, in [0, pi]: how far the x axis is off the motion; 0 where nothing moves."""
    return _medians(motion.scene, np.abs(motion.angle_rad), num)


def _medians(scene: NDArray[np.int64], values: FloatArray, num: int) -> FloatArray:
    """[num] by scene; 0 where there is none."""
    order = np.lexsort((values, scene))
    counts = np.bincount(scene, minlength=num)
    starts = np.cumsum(counts) - counts
    middle = np.minimum(starts + counts // 2, len(values) - 1)
    return np.where(counts > 0, values[order][middle], 0.0) if len(values) else np.zeros(num)


def _in_words(motion: Motion, scene: int) -> str:
    angles_rad = motion.angle_rad[motion.scene == scene]
    mean = np.exp(1j * angles_rad).mean()
    if abs(mean) < 0.5:
        return "the direction of the ego's x axis has nothing to do with its motion"
    off_rad = float(np.angle(mean))
    if abs(off_rad) > _OPPOSED_RAD:
        return "the ego's x axis points against its motion"
    side = "left" if off_rad > 0.0 else "right"
    return f"the ego's x axis points {side} of its motion by {abs(np.rad2deg(off_rad)):.0f} degrees"
