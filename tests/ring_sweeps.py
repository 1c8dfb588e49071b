"""Sweeps that all see the same standing points."""

from pathlib import Path

import numpy as np
from tiny_tables import TRAIN_A

from lss_core.data.samples import SampleIndex
from lss_core.geometry import apply, invert

# What stands around the first scene's car, in `global`, metres up to 30 m from it.
RING_M = np.column_stack(
    [
        np.asarray([[TRAIN_A.x_m, TRAIN_A.y_m]])
        + 30.0 * np.stack([np.cos(np.arange(12)), np.sin(np.arange(12))], axis=1),
        np.linspace(0.2, 3.0, 12),
    ]
)


def write_sweeps(index: SampleIndex, root: Path) -> None:
    """Every sweep sees the same standing points, with their number as intensity."""
    for sweep, name in enumerate(index.sweep_path):
        row = int(np.searchsorted(index.track_start, sweep, side="right")) - 1
        sample = int(np.flatnonzero(index.sample_scene == row)[0])
        lidar_from_global = invert(index.global_from_track[sweep] @ index.ego_from_lidar[sample])
        seen = np.zeros((len(RING_M) + 1, 5), dtype=np.float32)
        seen[:-1, :3] = apply(lidar_from_global, RING_M)
        seen[:-1, 3] = np.arange(len(RING_M))
        seen[-1, :3] = [0.3, -1.0, -0.5]  # the car's own roof
        path = root / name.decode()
        path.parent.mkdir(parents=True, exist_ok=True)
        seen.tofile(path)
