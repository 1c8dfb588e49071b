"""shoot-render: pictures of what a trained planner sees and plans."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

import numpy as np
import tyro

from lss_core.data.dataset import usable_rows
from lss_core.data.samples import load_index, rows_of_split
from lss_core.errors import DataError
from shoot.cli.app import run
from shoot.datamodule import LabelledSplit
from shoot.prediction import TrainedRun, open_run
from shoot.rendering import render_sample, save_figure
from shoot.sample_views import view_sample
from shoot.trajectories import mine_futures


@dataclass(frozen=True)
class OtherData:
    """Data other than what the run was trained on.

    Attributes:
        root: Data root; the run's own if not given.
        version: Version of the tables; the run's own if not given.
        skip_missing: Leave out samples whose image files are absent, and count them.
    """

    root: str | None = None
    version: str | None = None
    skip_missing: bool = False


@dataclass(frozen=True)
class RenderConfig:
    """Draw samples: six images and the cost map with ranked trajectories and the driven one.

    Attributes:
        run: Run folder.
        out: Folder for the pictures, one PNG a sample.
        split: Scenes to take samples from.
        num: Number of samples, evenly spread.
        token: One sample to draw instead.
        lidar: Show the lidar sweep too.
        checkpoint: `last` or `best`.
        data: Data other than the run's own.
    """

    run: Annotated[str, tyro.conf.Positional]
    out: str
    split: str = "val"
    num: int = 4
    token: str | None = None
    lidar: bool = False
    checkpoint: str = "last"
    data: OtherData = field(default_factory=OtherData)


def render(config: RenderConfig) -> list[Path]:
    """Draw and save; returns the pictures' paths.

    Raises:
        DataError: If run, data or sample are not as they should be.
    """
    trained = open_run(
        config.run,
        config.checkpoint,
        config.data.root,
        config.data.version,
        skip_missing=config.data.skip_missing,
    )
    split = _samples(trained, config)
    num = min(config.num, len(split.labels))
    paths = []
    for position in np.linspace(0, len(split.labels) - 1, num).round().astype(int):
        row = int(split.futures.sample[position])
        view = view_sample(trained, split, int(position), config.lidar)
        path = Path(config.out) / f"{split.index.sample_token[row]}.png"
        paths.append(save_figure(render_sample(view), path))
        print(path)
    return paths


def _samples(trained: TrainedRun, config: RenderConfig) -> LabelledSplit:
    """The split's samples, or the one asked for, wherever it is."""
    data = trained.config.data
    index = load_index(data.root, data.version, data.cameras)
    if config.token is None:
        rows = rows_of_split(index, data.root, data.version, config.split)
    else:
        rows = np.asarray([index.row_of(config.token)])
    futures = mine_futures(index, rows, "keyframes")
    if not len(futures.sample):
        raise DataError("None of the samples asked for has five seconds of future.")
    usable = usable_rows(
        index, Path(data.root), futures.sample, data.skip_missing, data.lidar_scans
    )
    futures = futures.select(np.isin(futures.sample, usable))
    return LabelledSplit(index, futures, trained.templates.nearest(futures.xy_m))


def main() -> None:
    """Entry point."""
    run(RenderConfig, render, "Draw what a trained planner sees and plans.")
