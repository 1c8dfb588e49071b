"""Lidar sweeps from disk, in the ego frame."""

import logging
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float
from numpy.typing import NDArray

from lss_core.data.samples import TIME_TOLERANCE_S, SampleIndex
from lss_core.data.sensors.sweep_cuts import SceneSweeps, cut_flaw
from lss_core.data.sensors.sweep_layout import (
    EXPECTED_WORDS,
    POINT_BYTES,
    has_place,
    layout_flaw,
    pieces_of,
)
from lss_core.errors import DataError
from lss_core.geometry import FloatArray, apply, invert
from lss_core.legible import legible

logger = logging.getLogger(__name__)

Points = Float[np.ndarray[Any, np.dtype[np.float32]], "P 5"]

_BRIGHTEST = 255.0
# Nearer returns, measured over ground from the lidar, are from the car that carries it.
_OWN_CAR_M = 2.2
# Data sets whose intensities were warned of.
_warned: set[Path] = set()


def load_sweep(index: SampleIndex, root: Path, row: int) -> FloatArray:
    """[P, 3] points of a sample's keyframe sweep, metres, in `ego`.

    Raises:
        DataError: If the sample has no sweep, or its file is missing, damaged or of another layout.
    """
    name = str(index.lidar_path[row])
    if not name:
        raise DataError(f"Sample {index.sample_token[row]} has no lidar sweep.")
    others = SceneSweeps.of_scene(index, root, int(index.sample_scene[row]))
    points = _read(root / name, others)[:, :3].astype(np.float64)
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
    place: of numbers that are not finite, or beyond 10 km. Intensities beyond 0 to 255 become the
    nearest of these, with a warning; those that are no number become 0.

    Args:
        index: Of the data set.
        root: Its folder.
        row: Of the sample.
        num_scans: Sweeps, the keyframe's own included.

    Returns:
        x, y, z in metres in `ego`, intensity 0 to 255, age in seconds.

    Raises:
        DataError: If the sample has no sweep, or a file is missing, damaged or of another layout.
    """
    others = SceneSweeps.of_scene(index, root, int(index.sample_scene[row]))
    ego_from_global = invert(index.global_from_ego[row])
    scans = []
    for sweep in recent_sweeps(index, row, num_scans):
        values = _with_intensity(_read(root / index.sweep_path[sweep].decode(), others), root)
        ego_from_lidar = ego_from_global @ index.global_from_track[sweep]
        ego_from_lidar = ego_from_lidar @ index.ego_from_lidar[row]
        age_s = float(index.time_s[row] - index.track_time_s[sweep])
        scans.append(place_scan(values, ego_from_lidar, age_s))
    return np.concatenate(scans)


def place_scan(
    points_lidar: Points, ego_from_lidar: FloatArray, age_s: float
) -> Float[np.ndarray[Any, np.dtype[np.float32]], "Q 5"]:
    """Points of one sweep as a planner reads them, without those of the car itself.

    Args:
        points_lidar: x, y, z in metres in `lidar`, intensity 0 to 255, ring.
        ego_from_lidar: [4, 4] the lidar's pose at the sweep, in `ego` of now.
        age_s: How long ago that was.

    Returns:
        x, y, z in metres in `ego`, intensity, age in seconds.
    """
    values = points_lidar[np.hypot(points_lidar[:, 0], points_lidar[:, 1]) >= _OWN_CAR_M]
    single = ego_from_lidar.astype(np.float32)
    scan = np.empty_like(values)
    scan[:, :3] = values[:, :3] @ single[:3, :3].T + single[:3, 3]
    scan[:, 3] = values[:, 3]
    scan[:, 4] = age_s
    return scan


def check_file(path: Path, others: SceneSweeps) -> None:
    """Look whether a sweep's file seems to hold whole points of the right layout, and all of them.

    Of a long file only some parts are read.

    Args:
        path: Of the file.
        others: Sweeps of the same scene.

    Raises:
        DataError: If it is missing, empty, ends within a point, is much smaller than the others, or
            looks like points of another layout.
    """
    try:
        num_bytes = path.stat().st_size
        with path.open("rb") as stream:
            pieces = []
            for start, end in pieces_of(num_bytes):
                stream.seek(start)
                pieces.append(stream.read(end - start))
    except OSError as error:
        raise DataError(f"The lidar sweep '{path}' cannot be read: {error.strerror}.") from error
    _check(path, num_bytes, b"".join(pieces), others)


def _check(path: Path, num_bytes: int, pieces: bytes, others: SceneSweeps) -> None:
    if not num_bytes:
        raise DataError(f"The lidar sweep '{path}' is damaged: it is empty.")
    flaw = layout_flaw(pieces, num_bytes)
    if num_bytes % POINT_BYTES:
        more = f" ({flaw}; {EXPECTED_WORDS})" if flaw else ""
        raise DataError(f"The lidar sweep '{path}' is damaged: it ends within a point{more}.")
    if flaw:
        raise DataError(f"The lidar sweep '{path}' {flaw}; {EXPECTED_WORDS}.")
    flaw = cut_flaw(path, num_bytes, others)
    if flaw:
        raise DataError(f"The lidar sweep '{path}' seems to be cut off: it {flaw}.")


def _read(path: Path, others: SceneSweeps) -> Float[np.ndarray[Any, np.dtype[np.float32]], "P 5"]:
    """Points in the lidar's own frame; those without a place are left out."""
    try:
        raw = path.read_bytes()
    except OSError as error:
        raise DataError(f"The lidar sweep '{path}' cannot be read: {error.strerror}.") from error
    pieces = b"".join(raw[start:end] for start, end in pieces_of(len(raw)))
    _check(path, len(raw), pieces, others)
    values: NDArray[np.float32] = np.frombuffer(raw, dtype=np.float32).reshape(-1, 5)
    values = values[has_place(values)]
    if not len(values):
        raise DataError(f"The lidar sweep '{path}' is damaged: none of its points has a place.")
    return values


def _with_intensity(
    values: Float[np.ndarray[Any, np.dtype[np.float32]], "P 5"], root: Path
) -> Float[np.ndarray[Any, np.dtype[np.float32]], "P 5"]:
    """The points, their intensities within 0 to 255."""
    intensity = values[:, 3]
    # Comparisons with what is no number are false.
    good = (intensity >= 0.0) & (intensity <= _BRIGHTEST)
    if good.all():
        return values
    if root not in _warned:
        _warned.add(root)
        finite = intensity[np.isfinite(intensity)]
        span = f"{finite.min():g} to {finite.max():g}" if len(finite) else "no finite number"
        logger.warning(
            "Intensities of lidar points in '%s' are not all within 0 to 255 (those of the first "
            "such sweep: %s): beyond it they become 0 or 255, and 0 where they are no number; "
            "scale those in the files to 0 to 255.",
            legible(str(root)),
            span,
        )
    changed = values.copy()
    changed[:, 3] = np.clip(np.nan_to_num(intensity, nan=0.0), 0.0, _BRIGHTEST)
    return changed
