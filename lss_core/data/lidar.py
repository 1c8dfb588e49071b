"""Lidar sweeps from disk, in the ego frame."""

from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float
from numpy.typing import NDArray

from lss_core.data.samples import TIME_TOLERANCE_S, SampleIndex
from lss_core.errors import DataError
from lss_core.geometry import FloatArray, apply, invert

_FIELDS = 5  # x, y, z, intensity, ring: nuScenes' own layout
_POINT_BYTES = 4 * _FIELDS
# Of metres and intensity. Sensors write what is no number, or a huge one, where nothing came back.
_LARGEST = 10_000.0
# Nearer returns, measured over ground from the lidar, are from the car that carries it.
_OWN_CAR_M = 2.2


def load_sweep(index: SampleIndex, root: Path, row: int) -> FloatArray:
    """[P, 3] points of a sample's keyframe sweep, metres, in `ego`.

    Raises:
        DataError: If the sample has no sweep, or its file is missing or damaged.
    """
    name = str(index.lidar_path[row])
    if not name:
        raise DataError(f"Sample {index.sample_token[row]} has no lidar sweep.")
    points = _read(root / name)[:, :3].astype(np.float64)
    return apply(index.ego_from_lidar[row], points)


def recent_sweeps(index: SampleIndex, row: int, num_scans: int) -> NDArray[np.int64]:
    """Rows of `track_*` of a sample's sweep and those before it in its scene, the newest first.

    Fewer than `num_scans` at the beginning of a scene.

    Raises:
        DataError: If the sample has no sweep.
    """
    if not index.lidar_path[row]:
        raise DataError(f"Sample {index.sample_token[row]} has no lidar sweep.")
    track = index.track(int(index.sample_scene[row]))
    end = track.start + int(
        np.searchsorted(
            index.track_time_s[track], index.time_s[row] + TIME_TOLERANCE_S, side="right"
        )
    )
    newest_first: NDArray[np.int64] = np.arange(max(track.start, end - num_scans), end)[::-1]
    return newest_first


def load_scans(
    index: SampleIndex, root: Path, row: int, num_scans: int
) -> Float[np.ndarray[Any, np.dtype[np.float32]], "P 5"]:
    """Points of a sample's sweep and those before it, as if the car had stood still meanwhile.

    The car's own motion between the sweeps is undone; what else moves leaves a trail, which the age
    of each point tells apart. Returns from the car itself are left out, and points that have no
    place: of numbers that are not finite, or beyond 10 km.

    Args:
        index: Of the data set.
        root: Its folder.
        row: Of the sample.
        num_scans: Sweeps, the keyframe's own included.

    Returns:
        x, y, z in metres in `ego`, intensity 0 to 255, age in seconds.

    Raises:
        DataError: If the sample has no sweep, or a file is missing or damaged.
    """
    ego_from_global = invert(index.global_from_ego[row])
    scans = []
    for sweep in recent_sweeps(index, row, num_scans):
        values = _read(root / index.sweep_path[sweep].decode())
        values = values[np.hypot(values[:, 0], values[:, 1]) >= _OWN_CAR_M]
        ego_from_lidar = ego_from_global @ index.global_from_track[sweep]
        ego_from_lidar = (ego_from_lidar @ index.ego_from_lidar[row]).astype(np.float32)
        scan = np.empty_like(values)
        scan[:, :3] = values[:, :3] @ ego_from_lidar[:3, :3].T + ego_from_lidar[:3, 3]
        scan[:, 3] = values[:, 3]
        scan[:, 4] = index.time_s[row] - index.track_time_s[sweep]
        scans.append(scan)
    return np.concatenate(scans)


def check_size(path: Path) -> None:
    """Look whether a sweep's file can hold whole points.

    Raises:
        DataError: If it is missing, empty or ends within a point.
    """
    try:
        num_bytes = path.stat().st_size
    except OSError as error:
        raise DataError(f"The lidar sweep '{path}' cannot be read: {error.strerror}.") from error
    if not num_bytes:
        raise DataError(f"The lidar sweep '{path}' is damaged: it is empty.")
    if num_bytes % _POINT_BYTES:
        raise DataError(f"The lidar sweep '{path}' is damaged: it ends within a point.")


def _read(path: Path) -> Float[np.ndarray[Any, np.dtype[np.float32]], "P 5"]:
    """Points in the lidar's own frame; those without a place or intensity are left out."""
    check_size(path)
    try:
        values: NDArray[np.float32] = np.fromfile(path, dtype=np.float32).reshape(-1, _FIELDS)
    except OSError as error:
        raise DataError(f"The lidar sweep '{path}' cannot be read: {error.strerror}.") from error
    # Comparisons with what is no number are false.
    values = values[(np.abs(values[:, :4]) <= _LARGEST).all(axis=-1)]
    if not len(values):
        raise DataError(f"The lidar sweep '{path}' is damaged: none of its points has a place.")
    return values
