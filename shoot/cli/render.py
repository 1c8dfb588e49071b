"""shoot-render: pictures of what a trained planner sees and plans."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
import tyro

from lss_core.bounds import Count, check_settings
from lss_core.config import check_cameras
from lss_core.data.samples import load_index, rows_of_split
from lss_core.data.tables.file_names import is_plain
from lss_core.data.usable import LEFT_OUT, Needs, save_left_out
from lss_core.errors import DataError
from shoot.cli.app import run
from shoot.prediction.run import TrainedRun, open_run
from shoot.rendering import render_sample, save_figure
from shoot.report.sample_views import view_sample
from shoot.training.planning.data import LabelledSplit, label_rows


@dataclass(frozen=True)
class OtherData:
    """Data other than what the run was trained on.

    Attributes:
        root: Data root; the run's own if not given.
        version: Version of the tables; the run's own if not given.
        cameras: Channels that the planner is to see, any number of them; the run's own if not
            given.
        skip_bad: Leave out samples whose files are absent or damaged, or whose calibration or poses
            cannot be, count and list them.
    """

    root: str | None = None
    version: str | None = None
    cameras: tuple[str, ...] | None = None
    skip_bad: bool = False

    def __post_init__(self) -> None:
        check_settings(self)
        if self.cameras is not None:
            check_cameras(self.cameras)


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
    num: Count = 4
    token: str | None = None
    lidar: bool = False
    checkpoint: Literal["last", "best"] = "last"
    data: OtherData = field(default_factory=OtherData)

    def __post_init__(self) -> None:
        check_settings(self)


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
        skip_bad=config.data.skip_bad,
        cameras=config.data.cameras,
    )
    split = _samples(trained, config)
    num = min(config.num, len(split.labels))
    out = Path(config.out)
    save_left_out(out / LEFT_OUT, {config.split: split.left_out})
    paths = []
    for position in np.linspace(0, len(split.labels) - 1, num).round().astype(int):
        token = str(split.index.sample_token[split.futures.sample[position]])
        if not is_plain(token):
            raise DataError(
                f"The token '{token}' of a sample cannot be the name of a file; rename it in "
                "sample.json and sample_data.json."
            )
        view = view_sample(trained, split, int(position), config.lidar)
        paths.append(save_figure(render_sample(view), out / f"{token}.png"))
        print(paths[-1])
    return paths


def _samples(trained: TrainedRun, config: RenderConfig) -> LabelledSplit:
    """The split's samples, or the one asked for, wherever it is."""
    data = trained.config.data
    index = load_index(data.root, data.version, data.cameras)
    if config.token is None:
        rows = rows_of_split(index, data.root, data.version, config.split)
    else:
        rows = np.asarray([index.row_of(config.token)])
    needs = Needs(lidar_scans=max(data.lidar_scans, int(config.lidar)))
    return label_rows(index, rows, data, trained.templates, needs, "asked for ")


def main() -> None:
    """Entry point."""
    run(RenderConfig, render, "Draw what a trained planner sees and plans.")
