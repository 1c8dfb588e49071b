"""The index at the size of v1.0-trainval: reading tables, first build, later starts, mining.

Each function does one thing once, so that a process of its own can be timed doing it. `cache` is
the folder that SHOOT_CACHE names.
"""

import os
import time
from pathlib import Path
from typing import Any
from unittest.mock import patch

import msgspec

from benchmarks.big_tables import NUM_SCENES, VERSION, write_big_tables
from lss_core.config import CAMERAS
from lss_core.data.checks.sample_problems import SampleProblems, find_problems
from lss_core.data.samples import SampleIndex, building, load_index, rows_of_split
from lss_core.data.tables.reading import TABLES, read_pieces
from shoot.trajectories import mine_futures


class _Nothing(msgspec.Struct, gc=False):
    """Of a record nothing is wanted: the parser still has to go through all of it."""


def make_tables(folder: Path, scenes: int = NUM_SCENES) -> Path:
    """The data root below a folder that has the tables; made unless it is there."""
    root = folder / f"tables-of-{scenes}-scenes"
    return root if root.exists() else write_big_tables(root, scenes)


def open_devkit(root: Path) -> int:
    """Open nuscenes-devkit, the other reader of these tables; the number of samples."""
    from nuscenes.nuscenes import NuScenes  # here, so that no other function pays for it

    return len(NuScenes(VERSION, dataroot=str(root), verbose=False).sample)


def skim_tables(root: Path) -> int:
    """Read the bytes of the seven tables and find all records, no columns; how many there are."""
    paths = (root / VERSION / f"{name}.json" for name in TABLES.values())
    return sum(len(msgspec.json.decode(p.read_bytes(), type=list[_Nothing])) for p in paths)


def read_tables(root: Path) -> int:
    """Read the columns that an index needs, and drop them; how many records there are."""
    folder = root / VERSION
    return sum(len(piece) for kind in TABLES for piece in read_pieces(folder, kind))


def build_index(root: Path, cache: Path) -> int:
    """Build the index and keep it, as the first start does; the number of samples.

    Raises:
        FileExistsError: If the cache folder is there already.
    """
    cache.mkdir(parents=True)
    return len(_index(root, cache).sample_token)


def share_of_checks(root: Path, cache: Path) -> float:
    """Time spent on what poses and calibration cannot be, as a share of the rest of a build."""
    spent_s = 0.0

    def timed(*given: Any) -> SampleProblems:
        nonlocal spent_s
        started = time.perf_counter()
        found = find_problems(*given)
        spent_s += time.perf_counter() - started
        return found

    with patch.object(building, "find_problems", timed):
        started = time.perf_counter()
        build_index(root, cache)
        return spent_s / (time.perf_counter() - started - spent_s)


def start(root: Path, cache: Path) -> int:
    """What each later start does: index, splits, futures of all keyframes; how many there are."""
    index = _index(root, cache)
    rows = [rows_of_split(index, root, VERSION, split) for split in ("train", "val")]
    return sum(len(mine_futures(index, own, "keyframes").xy_m) for own in rows)


def mine(root: Path, cache: Path) -> int:
    """Index and futures of all sweeps of the training split, as templates need; how many."""
    index = _index(root, cache)
    rows = rows_of_split(index, root, VERSION, "train")
    return len(mine_futures(index, rows, "sweeps").xy_m)


def _index(root: Path, cache: Path) -> SampleIndex:
    os.environ["SHOOT_CACHE"] = str(cache)
    return load_index(root, VERSION, CAMERAS)
