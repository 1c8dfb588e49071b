"""How time and memory grow with what there is more of, and the exponent of it."""

import shutil
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import torch

from benchmarks import big_tables, fitting, index, paper_size
from benchmarks.measuring import Side, measured
from lss_core.model import CameraModel
from shoot.planner import Planner
from shoot.training.allocation import keep_freed_memory

# Above this something that should be linear is not.
LARGEST_EXPONENT = 1.1


@dataclass(frozen=True)
class Growth:
    """One thing grown, all else fixed.

    Attributes:
        what: What is done.
        of: What it is grown in.
        sizes: Of it.
        seconds: Of a call at each size, the least of some.
        mb: Most memory of a call at each size (10^6 bytes).
    """

    what: str
    of: str
    sizes: tuple[float, ...]
    seconds: tuple[float, ...]
    mb: tuple[float, ...]

    @property
    def exponent(self) -> float:
        """Fitted slope of log time over log size."""
        return _slope(self.sizes, self.seconds)

    @property
    def memory_exponent(self) -> float:
        """Fitted slope of log memory over log size."""
        return _slope(self.sizes, self.mb)

    @property
    def holds(self) -> bool:
        """Whether neither grows faster than linearly."""
        return max(self.exponent, self.memory_exponent) <= LARGEST_EXPONENT


def _slope(sizes: Sequence[float], values: Sequence[float]) -> float:
    return float(np.polyfit(np.log(sizes), np.log(values), 1)[0])


def _grow(
    what: str,
    of: str,
    sizes: Sequence[int],
    prepare: Callable[[int], Callable[[], Any]],
    repeats: int = 5,
    size_of: Callable[[int], float] = float,
) -> Growth:
    times_s, peaks_mb = [], []
    for size in sizes:
        side = Side(partial(_prepared, prepare, size))
        side.seconds()
        times_s.append(min(side.seconds() for _ in range(repeats)))
        peaks_mb.append(max(side.peak_mb(), 1.0))
        side.close()
    return Growth(what, of, tuple(map(size_of, sizes)), tuple(times_s), tuple(peaks_mb))


def _prepared(prepare: Callable[[int], Callable[[], Any]], size: int) -> Callable[[], Any]:
    keep_freed_memory()
    return prepare(size)


def _map_of(num_samples: int, num_cameras: int, cells_a_side: int) -> Callable[[], Any]:
    config = paper_size.with_grid(cells_a_side)
    model = CameraModel(config, paper_size.IMAGE_HW).eval()
    batch = paper_size.batch(num_samples, num_cameras)
    return torch.no_grad()(lambda: model.forward_batch(batch))


def by_cameras(num: int) -> Callable[[], Any]:
    """Images to map, one sample of some cameras."""
    return _map_of(1, num, 200)


def by_batch(num: int) -> Callable[[], Any]:
    """Images to map, some samples."""
    return _map_of(num, 6, 200)


def by_grid(cells_a_side: int) -> Callable[[], Any]:
    """Images to map, on a grid of some cells a side."""
    return _map_of(1, 6, cells_a_side)


def by_templates(num: int) -> Callable[[], Any]:
    """Scores of some templates on four maps, and their gradient."""
    few = torch.from_numpy(fitting.futures(2000).reshape(-1, 20, 2)).float()
    templates = few.repeat(-(-num // len(few)), 1, 1)[:num]
    templates = templates + 0.3 * torch.randn(
        templates.shape, generator=torch.Generator().manual_seed(0)
    )
    planner = Planner(templates, paper_size.MODEL.grid)
    cost_map = torch.zeros(4, *planner.grid.shape, requires_grad=True)

    def run() -> Any:
        return torch.autograd.grad(planner(cost_map).logsumexp(dim=1).sum(), cost_map)

    return run


def all_growth(folder: Path) -> Iterator[Growth]:
    """Everything; takes some minutes."""
    yield _grow("images to map", "cameras", (1, 2, 4, 6, 8, 12), by_cameras)
    yield _grow("images to map", "samples in a batch", (1, 2, 4, 8), by_batch, 3)
    yield _grow(
        "images to map", "cells", (100, 200, 300, 400), by_grid, 3, lambda side: float(side**2)
    )
    yield _grow(
        "scores and their gradient", "templates", (100, 1000, 10_000, 100_000), by_templates
    )
    yield _by_scenes(folder)


def _by_scenes(folder: Path) -> Growth:
    """First build of the index; its tables are made and stay in the folder."""
    sizes, times_s, peaks_mb = (106, 212, 425, 850), [], []
    for num in sizes:
        root = index.make_tables(folder, num)
        index.read_tables(root)
        runs = []
        for repeat in range(2):
            cache = folder / f"growth-cache-{num}-{repeat}"
            runs.append(measured(partial(_build_afresh, root, cache)))
        times_s.append(min(seconds for seconds, _ in runs))
        peaks_mb.append(min(mb for _, mb in runs))
    assert sizes[-1] == big_tables.NUM_SCENES
    return Growth(
        "first build of the index",
        "scenes",
        tuple(map(float, sizes)),
        tuple(times_s),
        tuple(peaks_mb),
    )


def _build_afresh(root: Path, cache: Path) -> int:
    shutil.rmtree(cache, ignore_errors=True)
    return index.build_index(root, cache)
