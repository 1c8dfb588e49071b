"""Whether a sweep's file was cut off at a whole point, by what other sweeps of its scene hold.

A download or a full disk ends a file where a block of the disk ends, and one block in five ends a
point. Such a file reads without an error, as a car that sees a small part of its surroundings.
"""

import functools
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from lss_core.data.samples import SampleIndex
from lss_core.data.sensors.sweep_layout import POINT_BYTES

_BLOCK_BYTES = 4096
# Fewer sweeps, or sweeps of fewer points, are no measure of what is usual.
_FEWEST, _FEWEST_POINTS, _NUM_ASKED = 5, 100, 16
# No sweep of one lidar is this much smaller than another ...
_TENTH = 0.1
# ... and one in a thousand ends with a block by chance, of which hardly one is as small as this.
_HALF = 0.5
_SECTOR_RAD = np.deg2rad(5.0)
_SHARE_OF_TURN = 0.75


@dataclass(frozen=True)
class SceneSweeps:
    """Some sweeps of a scene, to be compared with; their files are looked at when asked for.

    Attributes:
        root: Of the data set.
        names: Of files, relative to it.
    """

    root: Path
    names: tuple[str, ...]

    @staticmethod
    def of_scene(index: SampleIndex, root: Path, scene: int) -> "SceneSweeps":
        """Keyframe sweeps all over a scene."""
        names = index.lidar_path[index.sample_scene == scene]
        names = names[names != ""]
        asked = np.unique(np.linspace(0, len(names) - 1, min(len(names), _NUM_ASKED)).astype(int))
        return SceneSweeps(root, tuple(names[asked].tolist()))


def cut_flaw(path: Path, num_bytes: int, others: SceneSweeps) -> str:
    """Why a sweep seems to be cut off; empty if it does not, or if there are too few others."""
    usual_bytes = _usual_bytes(others)
    counts = (
        f"has {num_bytes // POINT_BYTES} points where sweeps of its scene usually have "
        f"{usual_bytes // POINT_BYTES}"
    )
    if num_bytes < _TENTH * usual_bytes:
        return counts
    if num_bytes % _BLOCK_BYTES or not usual_bytes:
        return ""
    if num_bytes < _HALF * usual_bytes:
        return f"{counts}, and ends where a block of a disk does"
    if _num_sectors(path) < _SHARE_OF_TURN * _usual_sectors(others):
        return f"{counts}, sees less of the turn, and ends where a block of a disk does"
    return ""


@functools.lru_cache(maxsize=4096)
def _usual_bytes(sweeps: SceneSweeps) -> int:
    """Median size; 0 if that is no measure."""
    num_bytes = [path.stat().st_size for path in _there(sweeps)]
    usual_bytes = int(np.median(num_bytes)) if len(num_bytes) >= _FEWEST else 0
    return usual_bytes if usual_bytes >= _FEWEST_POINTS * POINT_BYTES else 0


@functools.lru_cache(maxsize=64)
def _usual_sectors(sweeps: SceneSweeps) -> float:
    return float(np.median([_num_sectors(path) for path in _there(sweeps)]))


def _there(sweeps: SceneSweeps) -> list[Path]:
    return [path for name in sweeps.names if (path := sweeps.root / name).is_file()]


def _num_sectors(path: Path) -> int:
    """How many sectors around the lidar have a point."""
    num_points = path.stat().st_size // POINT_BYTES
    points = np.fromfile(path, dtype=np.float32, count=5 * num_points).reshape(-1, 5)
    azimuth_rad: NDArray[np.float32] = np.arctan2(points[:, 1], points[:, 0])
    azimuth_rad = azimuth_rad[np.isfinite(azimuth_rad)]
    return len(np.unique(np.floor(azimuth_rad / _SECTOR_RAD)))
