"""Mines futures and pasts from the poses of a data set's scenes."""

from dataclasses import dataclass
from functools import partial
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from lss_core.data.samples import SampleIndex
from lss_core.data.usable import usable_scenes
from lss_core.geometry import FloatArray
from shoot.jobs.parallel import run_jobs
from shoot.trajectories.futures import DT_S, HORIZON_S, Futures, futures_from_poses
from shoot.trajectories.past import past_from_poses, recent_motion

_SCENES_A_JOB = 10


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
    horizon_s: float = HORIZON_S,
    dt_s: float = DT_S,
) -> Futures:
    """Futures of the scenes of the given samples.

    Args:
        index: Of the data set.
        rows: [R] samples, in the order of `rows_of_split`.
        starts: `sweeps`: from every LIDAR_TOP sweep of their scenes (templates); `keyframes`: from
            the samples themselves (training and evaluation).
        dask: Address of a dask scheduler whose workers do it, a number of scenes at a time.
        horizon_s: How far ahead; a start with less than that recorded after it is left out.
        dt_s: Time between points; the first point is at `dt_s`.

    Raises:
        DataError: If the poses of a scene cannot be (`usable_scenes` leaves such out), or the
            cluster cannot be used.
        ValueError: If the horizon is no multiple of `dt_s`.
    """
    usable_scenes(index, rows, skip_bad=False)
    rides = _rides(index, rows, starts)
    chunks = [
        (first, rides[first : first + _SCENES_A_JOB])
        for first in range(0, len(rides), _SCENES_A_JOB)
    ]
    parts = dict(run_jobs(partial(_mine_chunk, horizon_s, dt_s), chunks, dask=dask))
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


def _mine_chunk(
    horizon_s: float, dt_s: float, chunk: tuple[int, list[_Ride]]
) -> tuple[int, list[Futures]]:
    """Futures of some rides, with the number that came with them."""
    first, rides = chunk
    return first, [_mine(ride, horizon_s, dt_s) for ride in rides]


def _mine(ride: _Ride, horizon_s: float, dt_s: float) -> Futures:
    poses = ride.time_s, ride.xy_m, ride.yaw_rad
    futures, kept = futures_from_poses(*poses, ride.starts_s, horizon_s, dt_s)
    velocity, yaw_rate = recent_motion(*poses, ride.starts_s[kept])
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
        dt_s=dt_s,
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
        dt_s=parts[0].dt_s,
    )
