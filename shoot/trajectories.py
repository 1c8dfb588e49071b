"""Ego futures, mined from recorded poses: what templates are fitted on and labels are made of."""

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from lss_core.data.samples import TIME_TOLERANCE_S, SampleIndex
from lss_core.data.usable import usable_scenes
from lss_core.errors import DataError
from lss_core.geometry import FloatArray
from shoot.footprint import turn
from shoot.jobs.parallel import run_jobs

HORIZON_S = 5.0
DT_S = 0.25
PAST_S = 2.0
# Faster than any car on a road; what seems faster is in other units or seen from elsewhere.
MAX_SPEED_MPS = 100.0
_SCENES_A_JOB = 10


@dataclass(frozen=True)
class Futures:
    """Ego futures with where they start, and what was driven before.

    The past is known from poses at and before the start alone, as long as the start is the time of
    a pose, which keyframes and sweeps are.

    Attributes:
        xy_m: [M, T, 2] ego origin at 0.25 s, 0.5 s ... 5 s, in the ego frame of the start.
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
    """

    xy_m: FloatArray
    scene: NDArray[np.int64]
    sample: NDArray[np.int64]
    velocity_mps: FloatArray
    yaw_rate_radps: FloatArray
    past_xy_m: FloatArray
    past_known: NDArray[np.bool_]
    num_left_out: int

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
    _check_poses(times_s, xy_m, yaw_rad, starts_s)
    if not (np.isfinite(horizon_s) and np.isfinite(dt_s) and dt_s > 0.0):
        raise ValueError(f"dt_s and horizon_s must be more than 0 s, got {dt_s} and {horizon_s}.")
    num_points = round(horizon_s / dt_s)
    if num_points < 1 or abs(num_points * dt_s - horizon_s) > 1e-9:
        raise ValueError(f"A horizon of {horizon_s} s is not a whole number of {dt_s} s steps.")
    starts_s = np.asarray(starts_s, dtype=np.float64)
    if not len(times_s):
        return np.zeros((0, num_points, 2)), np.zeros(len(starts_s), dtype=bool)
    kept = (starts_s >= times_s[0] - TIME_TOLERANCE_S) & (
        starts_s + horizon_s <= times_s[-1] + TIME_TOLERANCE_S
    )
    here_s = starts_s[kept]
    ahead_s = here_s[:, None] + dt_s * np.arange(1, num_points + 1)
    origin_m = _at(times_s, xy_m, here_s)
    moved_m = _at(times_s, xy_m, ahead_s) - origin_m[:, None]
    yaw = np.interp(here_s, times_s, np.unwrap(yaw_rad))
    return turn(moved_m, -yaw[:, None]), kept


def past_from_poses(
    times_s: FloatArray,
    xy_m: FloatArray,
    yaw_rad: FloatArray,
    starts_s: FloatArray,
    past_s: float = PAST_S,
    dt_s: float = DT_S,
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
    _check_poses(times_s, xy_m, yaw_rad, starts_s)
    behind_s = starts_s[:, None] - dt_s * np.arange(1, round(past_s / dt_s) + 1)
    known = behind_s >= times_s[0] - TIME_TOLERANCE_S
    moved_m = _at(times_s, xy_m, behind_s) - _at(times_s, xy_m, starts_s)[:, None]
    yaw = np.interp(starts_s, times_s, np.unwrap(yaw_rad))
    return np.where(known[..., None], turn(moved_m, -yaw[:, None]), 0.0), known


def _check_poses(
    times_s: FloatArray, xy_m: FloatArray, yaw_rad: FloatArray, starts_s: FloatArray
) -> None:
    num = len(times_s)
    shapes = [np.shape(array) for array in (times_s, xy_m, yaw_rad)]
    if shapes != [(num,), (num, 2), (num,)] or np.ndim(starts_s) != 1:
        raise ValueError(
            f"Poses must be times [P], places [P, 2], headings [P] and starts [S], got "
            f"{', '.join(str(list(shape)) for shape in (*shapes, np.shape(starts_s)))}."
        )
    if not all(np.isfinite(array).all() for array in (times_s, xy_m, yaw_rad, starts_s)):
        raise ValueError("Poses and starts must be finite, but hold NaN or infinity.")
    if np.any(np.diff(times_s) <= 0.0):
        raise ValueError("Pose times must increase.")


@dataclass(frozen=True)
class _Ride:
    """A scene's poses and the starts in it; what mining it needs, also on another machine."""

    scene: int
    time_s: FloatArray
    xy_m: FloatArray
    yaw_rad: FloatArray
    starts_s: FloatArray
    sample: NDArray[np.int64]


def mine_futures(
    index: SampleIndex,
    rows: NDArray[np.int64],
    starts: Literal["sweeps", "keyframes"],
    dask: str | None = None,
) -> Futures:
    """Futures of the scenes of the given samples.

    Args:
        index: Of the data set.
        rows: [R] samples, in the order of `rows_of_split`.
        starts: `sweeps`: from every LIDAR_TOP sweep of their scenes (templates); `keyframes`: from
            the samples themselves (training and evaluation).
        dask: Address of a dask scheduler whose workers do it, a number of scenes at a time.

    Raises:
        DataError: If the poses of a scene cannot be (`usable_scenes` leaves such out), or the
            cluster cannot be used.
    """
    usable_scenes(index, rows, skip_bad=False)
    rides = _rides(index, rows, starts)
    chunks = [
        (first, rides[first : first + _SCENES_A_JOB])
        for first in range(0, len(rides), _SCENES_A_JOB)
    ]
    parts = dict(run_jobs(_mine_chunk, chunks, dask=dask))
    return _join([part for first in sorted(parts) for part in parts[first]])


def _rides(
    index: SampleIndex, rows: NDArray[np.int64], starts: Literal["sweeps", "keyframes"]
) -> list[_Ride]:
    rides = []
    for scene in dict.fromkeys(index.sample_scene[rows].tolist()):
        track = index.track(scene)
        time_s = index.track_time_s[track]
        # Subtracting first keeps microseconds exact.
        zero_s = time_s[0]
        sample = rows[index.sample_scene[rows] == scene]
        starts_s = index.time_s[sample]
        if starts == "sweeps":
            starts_s, sample = time_s, np.full(len(time_s), -1)
        rides.append(
            _Ride(
                scene,
                time_s - zero_s,
                index.track_xy_m[track],
                index.track_yaw_rad[track],
                starts_s - zero_s,
                sample,
            )
        )
    return rides


def _mine_chunk(chunk: tuple[int, list[_Ride]]) -> tuple[int, list[Futures]]:
    """Futures of some rides, with the number that came with them."""
    first, rides = chunk
    return first, [_mine(ride) for ride in rides]


def _mine(ride: _Ride) -> Futures:
    poses = ride.time_s, ride.xy_m, ride.yaw_rad
    futures, kept = futures_from_poses(*poses, ride.starts_s)
    velocity, yaw_rate = _recent_motion(*poses, ride.starts_s[kept])
    past, past_known = past_from_poses(*poses, ride.starts_s[kept])
    return Futures(
        xy_m=futures,
        scene=np.full(len(futures), ride.scene),
        sample=ride.sample[kept],
        velocity_mps=velocity,
        yaw_rate_radps=yaw_rate,
        past_xy_m=past,
        past_known=past_known,
        num_left_out=int((~kept).sum()),
    )


def _join(parts: list[Futures]) -> Futures:
    return Futures(
        xy_m=np.concatenate([part.xy_m for part in parts]),
        scene=np.concatenate([part.scene for part in parts]),
        sample=np.concatenate([part.sample for part in parts]),
        velocity_mps=np.concatenate([part.velocity_mps for part in parts]),
        yaw_rate_radps=np.concatenate([part.yaw_rate_radps for part in parts]),
        past_xy_m=np.concatenate([part.past_xy_m for part in parts]),
        past_known=np.concatenate([part.past_known for part in parts]),
        num_left_out=sum(part.num_left_out for part in parts),
    )


def _recent_motion(
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
    moved_m = _at(times_s, xy_m, starts_s) - _at(times_s, xy_m, before_s)
    velocity = turn(moved_m, -yaw) / safe_s[:, None]
    turned = (yaw - np.interp(before_s, times_s, heading)) / safe_s
    return velocity, turned


def _at(times_s: FloatArray, xy_m: FloatArray, query_s: FloatArray) -> FloatArray:
    x_m, y_m = (np.interp(query_s, times_s, xy_m[:, axis]) for axis in range(2))
    return np.stack([x_m, y_m], axis=-1)
