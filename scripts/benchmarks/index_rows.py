"""Rows of the index: what is timed of it, against what, and what must hold."""

import os
import shutil
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path

import numpy as np

from benchmarks import big_tables, index, loading
from benchmarks.measuring import Pair, Side, Spread, measured
from benchmarks.row import Check, Row, Setting


def index_rows(setting: Setting) -> Iterator[Row]:
    """Index and mining at the size of v1.0-trainval."""
    root = index.make_tables(setting.folder)
    index.read_tables(root)  # so that the files stand in the system's memory for both sides
    read_s, _ = measured(partial(index.read_tables, root))
    devkit_s, devkit_mb = measured(partial(index.open_devkit, root))
    cache = setting.folder / "index-cache"
    builds, starts = [], []
    for _ in range(3):
        shutil.rmtree(cache, ignore_errors=True)
        builds.append(measured(partial(index.build_index, root, cache)))
        starts.append(measured(partial(index.start, root, cache)))
    mine_s, _ = measured(partial(index.mine, root, cache))
    shares = [index.share_of_checks(root, cache / f"checked-{number}") for number in range(3)]
    checks = float(np.median(shares))
    build_s = Spread.of([seconds for seconds, _ in builds])
    start_s = Spread.of([seconds for seconds, _ in starts])
    yield Row(
        "first start on tables of 850 scenes, 2.6 M poses: index",
        "nuscenes-devkit opened",
        "seven tables read, index built and kept",
        _against(devkit_s, devkit_mb, build_s, builds[-1][1]),
        1.0,
        read_s,
        (
            Check(
                f"checks of poses and calibration take {100.0 * checks:.1f} % of the rest of the "
                "build (at most 10)",
                checks <= 0.1,
            ),
        ),
    )
    one, eight = (_workers_mb(root, cache, num) for num in (1, 8))
    with_images_s = start_s.high
    yield Row(
        "each later start: index, splits, futures of all keyframes",
        "nuscenes-devkit opened",
        "index mapped from its cache",
        _against(devkit_s, devkit_mb, start_s, starts[-1][1]),
        1.0,
        None,
        (
            Check(f"{with_images_s:.2f} s at most (less than 2)", with_images_s < 2.0),
            Check(f"futures of all sweeps of 700 scenes {mine_s:.2f} s, index included", True),
            Check(
                f"memory of a process with 8 loader workers {eight / one:.2f} times that with one "
                f"({eight:.0f} and {one:.0f} MB, shared pages counted once)",
                eight / one <= 1.3,
            ),
        ),
    )


def _against(plain_s: float, plain_mb: float, fast_s: Spread, fast_mb: float) -> Pair:
    """A pair whose plain side takes too long to be repeated."""
    ratio = Spread(plain_s / fast_s.median, plain_s / fast_s.high, plain_s / fast_s.low)
    return Pair(Spread.of([plain_s]), fast_s, ratio, plain_mb, fast_mb)


def _workers_mb(root: Path, cache: Path, num_workers: int) -> float:
    side = Side(partial(_workers, root, cache, num_workers))
    try:
        return float(side.result())
    finally:
        side.close()


def _workers(root: Path, cache: Path, num_workers: int) -> Callable[[], float]:
    os.environ["SHOOT_CACHE"] = str(cache)
    return loading.workers_mb(root, big_tables.VERSION, num_workers)
