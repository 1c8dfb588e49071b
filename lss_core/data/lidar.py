"""Lidar sweeps from disk, in the ego frame."""

from pathlib import Path

import numpy as np

from lss_core.data.samples import SampleIndex
from lss_core.errors import DataError
from lss_core.geometry import FloatArray, apply

_FIELDS = 5  # x, y, z, intensity, ring: nuScenes' own layout


def load_sweep(index: SampleIndex, root: Path, row: int) -> FloatArray:
    """[P, 3] points of a sample's keyframe sweep, metres, in `ego`.

    Raises:
        DataError: If the sample has no sweep, or its file is missing or cut off.
    """
    name = str(index.lidar_path[row])
    if not name:
        raise DataError(f"Sample {index.sample_token[row]} has no lidar sweep.")
    path = root / name
    try:
        values = np.fromfile(path, dtype=np.float32)
    except OSError as error:
        raise DataError(f"The lidar sweep '{path}' cannot be read: {error.strerror}.") from error
    if len(values) % _FIELDS:
        raise DataError(f"The lidar sweep '{path}' is damaged: it ends within a point.")
    points = values.reshape(-1, _FIELDS)[:, :3].astype(np.float64)
    return apply(index.ego_from_lidar[row], points)
