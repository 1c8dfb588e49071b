"""Ego futures: what templates are fitted on and labels are made of."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from lss_core.data.samples import TIME_TOLERANCE_S
from lss_core.errors import DataError
from lss_core.geometry import FloatArray
from shoot.footprint import turn
from shoot.trajectories.poses import check_poses, positions_at

# The paper's (section 5.6). What a run uses stands in its template file.
HORIZON_S = 5.0
DT_S = 0.25
# Faster than any car on a road; what seems faster is in other units or seen from elsewhere.
MAX_SPEED_MPS = 100.0


@dataclass(frozen=True)
class Futures:
    """Ego futures with where they start, and what was driven before.

    The past is known from poses at and before the start alone, as long as the start is the time of
    a pose, which keyframes and sweeps are.

    Attributes:
        xy_m: [M, T, 2] ego origin at `dt_s`, 2 `dt_s` ... T `dt_s`, in the ego frame of the start.
        scene: [M] row of the scene in the index.
        sample: [M] row of the sample in the index; -1 for starts that are no keyframe.
        velocity_mps: [M, 2] mean velocity over the last half second before the start, in the ego
            frame of the start; zero where the recording begins.
        yaw_rate_radps: [M] mean yaw rate over the same time.
        past_xy_m: [M, P, 2] ego origin 0.25 s, 0.5 s ... 2 s before the start, in the ego frame of
            the start; zero where not known.
        past_known: [M, P] whether the recording of the scene reaches back that far. Where
            `past_known[:, 0]` is false, velocity and yaw rate mean nothing.
        num_left_out: Starts without a whole future in their scene.
        dt_s: Time between the points of `xy_m`; that of the past is always 0.25 s.
    """

    xy_m: FloatArray
    scene: NDArray[np.int64]
    sample: NDArray[np.int64]
    velocity_mps: FloatArray
    yaw_rate_radps: FloatArray
    past_xy_m: FloatArray
    past_known: NDArray[np.bool_]
    num_left_out: int
    dt_s: float = DT_S

    def select(self, mask: NDArray[np.bool_]) -> "Futures":
        """Only some of them; the others count as left out."""
        return replace(
            self,
            xy_m=self.xy_m[mask],
            scene=self.scene[mask],
            sample=self.sample[mask],
            velocity_mps=self.velocity_mps[mask],
            yaw_rate_radps=self.yaw_rate_radps[mask],
            past_xy_m=self.past_xy_m[mask],
            past_known=self.past_known[mask],
            num_left_out=self.num_left_out + int((~mask).sum()),
        )


def check_futures(futures: FloatArray, dt_s: float) -> None:
    """Check that [M, T, 2] futures are some that a car can have driven.

    Args:
        futures: Metres in the ego frame of each start, which is the origin at time 0.
        dt_s: Time between points; the first is at `dt_s`.

    Raises:
        DataError: If they have another shape, are not finite, or on average faster than 100 m/s.
    """
    if futures.ndim != 3 or futures.shape[1] < 1 or futures.shape[2] != 2:
        raise DataError(f"Futures must be [M, T, 2], got {list(futures.shape)}.")
    if not 0.0 < dt_s < np.inf:
        raise DataError(f"dt_s must be more than 0 s, got {dt_s}.")
    if not np.isfinite(futures).all():
        wrong = int((~np.isfinite(futures)).any(axis=(1, 2)).sum())
        raise DataError(f"Futures must be finite, but {wrong} of {len(futures)} are not.")
    steps_m = np.diff(futures, axis=1, prepend=0.0)
    speed_mps = np.linalg.norm(steps_m, axis=-1).mean(axis=1) / dt_s
    if speed_mps.max(initial=0.0) > MAX_SPEED_MPS:
        raise DataError(
            f"Futures must be slower than {MAX_SPEED_MPS:g} m/s, but one drives "
            f"{speed_mps.max():.0f} m/s; give metres in the ego frame of each start, a point every "
            f"{dt_s:g} s."
        )


def whole_steps(time_s: float, dt_s: float) -> int | None:
    """How many steps of `dt_s` the time is; None if no whole number of them, or less than one.

    It tells whether trajectories have a point at that time, and which.
    """
    num_steps = round(time_s / dt_s)
    return num_steps if num_steps >= 1 and abs(num_steps * dt_s - time_s) <= 1e-9 else None


def futures_from_poses(
    times_s: FloatArray,
    xy_m: FloatArray,
    yaw_rad: FloatArray,
    starts_s: FloatArray,
    horizon_s: float = HORIZON_S,
    dt_s: float = DT_S,
) -> tuple[FloatArray, NDArray[np.bool_]]:
    """Where the ego goes in the seconds after each start, seen from the start.

    Positions are interpolated linearly in time between the recorded poses; t = 0 is none of the
    points. A start before the first pose, or with less than the whole horizon recorded after it, is
    left out.

    Paper: section 5.6 (5 s, every 0.25 s: 20 points).

    Args:
        times_s: [P] strictly increasing.
        xy_m: [P, 2] ego origin in a fixed frame.
        yaw_rad: [P] heading in the same frame; jumps by 2 pi are allowed.
        starts_s: [S] moments to look ahead from.
        horizon_s: How far ahead.
        dt_s: Time between points; the first point is at `dt_s`.

    Returns:
        [S', T, 2] futures of the kept starts, x forward and y left at the start; [S] which were
        kept.

    Raises:
        ValueError: If poses or starts are not finite or of other shapes, times do not increase, or
            the horizon is no multiple of `dt_s`.
    """
    check_poses(times_s, xy_m, yaw_rad, starts_s)
    if not (np.isfinite(horizon_s) and np.isfinite(dt_s) and dt_s > 0.0):
        raise ValueError(f"dt_s and horizon_s must be more than 0 s, got {dt_s} and {horizon_s}.")
    num_points = whole_steps(horizon_s, dt_s)
    if num_points is None:
        raise ValueError(f"A horizon of {horizon_s} s is not a whole number of {dt_s} s steps.")
    starts_s = np.asarray(starts_s, dtype=np.float64)
    if not len(times_s):
        return np.zeros((0, num_points, 2)), np.zeros(len(starts_s), dtype=bool)
    kept = (starts_s >= times_s[0] - TIME_TOLERANCE_S) & (
        starts_s + horizon_s <= times_s[-1] + TIME_TOLERANCE_S
    )
    here_s = starts_s[kept]
    ahead_s = here_s[:, None] + dt_s * np.arange(1, num_points + 1)
    origin_m = positions_at(times_s, xy_m, here_s)
    moved_m = positions_at(times_s, xy_m, ahead_s) - origin_m[:, None]
    yaw = np.interp(here_s, times_s, np.unwrap(yaw_rad))
    return turn(moved_m, -yaw[:, None]), kept
