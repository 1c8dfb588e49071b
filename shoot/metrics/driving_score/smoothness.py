"""How the drive feels, and whether plans agree: HC and EC.

Everything is smoothed by Savitzky-Golay filters: a polynomial is fitted to the steps around each,
and its value or slope is taken. Windows are counted in steps, of 0.1 s.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from jaxtyping import Float
from scipy.signal import savgol_filter

from shoot.footprint import EGO_LENGTH_M, EGO_REAR_M
from shoot.metrics.comfort import (
    JERK_MAX_MPS3,
    LAT_ACCEL_MAX_MPS2,
    LON_ACCEL_MAX_MPS2,
    LON_ACCEL_MIN_MPS2,
)
from shoot.metrics.driving_score.tracks import Track

Array = np.ndarray[Any, np.dtype[Any]]

# Beside those of `shoot.metrics.comfort`; themselves out of bounds.
LON_JERK_MAX_MPS3 = 4.13
YAW_RATE_MAX_RADPS, YAW_ACCEL_MAX_RADPS2 = 0.95, 1.93

# How far two plans may differ, as root mean square; themselves within bounds.
ACCEL_APART_MPS2, JERK_APART_MPS3 = 0.7, 0.5
YAW_RATE_APART_RADPS, YAW_ACCEL_APART_RADPS2 = 0.1, 0.1
PLAN_GAP_S = 0.5

_ACCEL_STEPS, _JERK_STEPS, _YAW_STEPS = 8, 15, 5
MIN_STEPS = 4  # a cubic goes through fewer


@dataclass(frozen=True, eq=False)
class Feel:
    """What a passenger feels at each step.

    Attributes:
        lon_accel_mps2, lat_accel_mps2: Of the middle of the car, ahead and to the left.
        accel_mps2: Amount, at the rear axle.
        lon_jerk_mps3: Change of the middle's longitudinal acceleration.
        jerk_mps3: Change of the amount.
        yaw_rate_radps: To the left.
        yaw_accel_radps2: Its change, by a cubic.
        yaw_accel_by_square_radps2: Its change, by a square, which is what two plans are compared
            by.
    """

    lon_accel_mps2: Float[Array, " T"]
    lat_accel_mps2: Float[Array, " T"]
    accel_mps2: Float[Array, " T"]
    lon_jerk_mps3: Float[Array, " T"]
    jerk_mps3: Float[Array, " T"]
    yaw_rate_radps: Float[Array, " T"]
    yaw_accel_radps2: Float[Array, " T"]
    yaw_accel_by_square_radps2: Float[Array, " T"]


def feel(track: Track) -> Feel:
    """Accelerations, jerks and yaw rates along a track, smoothed.

    Raw acceleration is the slope of the speed, raw yaw rate that of the heading (from the step
    before to the step after). The car turns about its rear axle, so that the middle feels the turn
    itself too.

    Raises:
        ValueError: With fewer than 4 steps.
    """
    if len(track) < MIN_STEPS:
        raise ValueError(
            f"Comfort is measured of {MIN_STEPS} steps or more, got {len(track)}: give a longer "
            "track, or more history."
        )
    yaw_rad = np.unwrap(track.yaw_rad)
    accel, turn = (_slope(a, track.dt_s) for a in (track.speed_mps, yaw_rad))
    ahead_m = EGO_LENGTH_M / 2 - EGO_REAR_M
    lateral = track.speed_mps * turn
    lon, lat, amount = (
        _smooth(a, track.dt_s, _ACCEL_STEPS, 2)
        for a in (
            accel - turn**2 * ahead_m,
            lateral + _slope(turn, track.dt_s) * ahead_m,
            np.hypot(accel, lateral),
        )
    )
    return Feel(
        lon_accel_mps2=lon,
        lat_accel_mps2=lat,
        accel_mps2=amount,
        lon_jerk_mps3=_smooth(lon, track.dt_s, _JERK_STEPS, 2, 1),
        jerk_mps3=_smooth(amount, track.dt_s, _JERK_STEPS, 2, 1),
        yaw_rate_radps=_smooth(yaw_rad, track.dt_s, _YAW_STEPS, 2, 1),
        yaw_accel_radps2=_smooth(yaw_rad, track.dt_s, _YAW_STEPS, 3, 2),
        yaw_accel_by_square_radps2=_smooth(yaw_rad, track.dt_s, _YAW_STEPS, 2, 2),
    )


def history_comfort(felt: Feel) -> float:
    """HC: 1 if all of the drive, its history included, stays within six bounds, else 0.

    Args:
        felt: Of the track with its history in front.
    """
    bounded = (
        (felt.lon_accel_mps2, LON_ACCEL_MIN_MPS2, LON_ACCEL_MAX_MPS2),
        (felt.lat_accel_mps2, -LAT_ACCEL_MAX_MPS2, LAT_ACCEL_MAX_MPS2),
        (felt.jerk_mps3, -JERK_MAX_MPS3, JERK_MAX_MPS3),
        (felt.lon_jerk_mps3, -LON_JERK_MAX_MPS3, LON_JERK_MAX_MPS3),
        (felt.yaw_rate_radps, -YAW_RATE_MAX_RADPS, YAW_RATE_MAX_RADPS),
        (felt.yaw_accel_radps2, -YAW_ACCEL_MAX_RADPS2, YAW_ACCEL_MAX_RADPS2),
    )
    return float(all((low < a.min()) and (a.max() < high) for a, low, high in bounded))


def plans_agree(earlier: Track, later: Track, gap_s: float = PLAN_GAP_S) -> float:
    """EC of two plans: 1 if they differ little where both plan, else 0.

    Where they lead is not compared, only how they feel, so each may be in its own frame.

    Args:
        earlier: From when it was made on.
        later: Made `gap_s` after it, of the same length and time step.
        gap_s: At least one step.

    Raises:
        ValueError: If the plans do not fit together, or share fewer than 4 steps.
    """
    steps = earlier.steps_in(gap_s)
    if len(earlier) != len(later) or earlier.dt_s != later.dt_s or steps < 1:
        raise ValueError(
            "Plans must have the same steps, of a length that their gap is a multiple of; got "
            f"{len(earlier)} of {earlier.dt_s} s and {len(later)} of {later.dt_s} s, {gap_s} s "
            "apart."
        )
    shared = len(earlier) - steps
    one, two = feel(earlier.part(steps)), feel(later.part(0, max(shared, 0)))
    apart = (
        (one.accel_mps2 - two.accel_mps2, ACCEL_APART_MPS2),
        (one.jerk_mps3 - two.jerk_mps3, JERK_APART_MPS3),
        (one.yaw_rate_radps - two.yaw_rate_radps, YAW_RATE_APART_RADPS),
        (
            one.yaw_accel_by_square_radps2 - two.yaw_accel_by_square_radps2,
            YAW_ACCEL_APART_RADPS2,
        ),
    )
    return float(all(np.sqrt((a**2).mean()) <= most for a, most in apart))


def extended_comfort(plans: Sequence[Track], gap_s: float = PLAN_GAP_S) -> float | None:
    """EC: share of plans that agree with the one before; None with fewer than two.

    Args:
        plans: All those made, in order, `gap_s` apart.
        gap_s: Time between two.
    """
    if len(plans) < 2:
        return None
    agree = [plans_agree(one, two, gap_s) for one, two in pairwise(plans)]
    return float(np.mean(agree))


def _slope(values: Array, dt_s: float) -> Array:
    """Exact for squares, at the ends too."""
    slope: Array = np.gradient(values, dt_s, edge_order=2)
    return slope


def _smooth(values: Array, dt_s: float, window: int, order: int, derivative: int = 0) -> Array:
    """By polynomials of an order, over windows no longer than there are steps."""
    window = min(window, len(values))
    smoothed: Array = savgol_filter(values, window, order, deriv=derivative, delta=dt_s)
    return smoothed
