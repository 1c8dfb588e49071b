"""shoot-render: pictures of what a trained run sees, and plans or finds around the car."""

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
import tyro
from matplotlib.figure import Figure
from numpy.typing import NDArray

from lss_core.bounds import Count, check_settings
from lss_core.config import DataConfig
from lss_core.data.samples import SampleIndex, load_index, rows_of_split
from lss_core.data.tables.file_names import is_plain
from lss_core.data.usable import LEFT_OUT, Needs, save_left_out
from lss_core.errors import DataError
from shoot.cli.app import run
from shoot.cli.asked_run import OtherData, refuse_settings
from shoot.rendering import render_sample, render_segmentation, save_figure
from shoot.report.sample_views import view_sample
from shoot.report.segmentation_views import view_segmentation
from shoot.training.config import task_of
from shoot.training.planning.data import label_rows
from shoot.training.segmentation.config import SegmentConfig
from shoot.training.segmentation.data import label_segments
from shoot.training.split import SampleSplit


@dataclass(frozen=True)
class RenderConfig:
    """Draw samples: six images, and from above what is planned or found.

    Of a planner that is the cost map with ranked trajectories and the driven one; of a segmentation
    what it found, drawn back onto the images, too, and the truth beside it.

    Attributes:
        run: Run folder.
        out: Folder for the pictures, one PNG a sample.
        split: Scenes to take samples from.
        num: Number of samples, evenly spread.
        token: One sample to draw instead.
        lidar: Show the lidar sweep too, of a planner.
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
    if task_of(Path(config.run)) == SegmentConfig.task:
        return _render_segmentation(config)
    trained = config.data.open_run(config.run, config.checkpoint)
    data = trained.config.data
    index, rows = _rows(data, config)
    needs = Needs(lidar_scans=max(data.lidar_scans, int(config.lidar)))
    split = label_rows(index, rows, data, trained.templates, needs, "asked for ")

    def draw(position: int) -> Figure:
        return render_sample(view_sample(trained, split, position, config.lidar))

    return _draw_all(split, draw, config)


def _render_segmentation(config: RenderConfig) -> list[Path]:
    refuse_settings({"--lidar": config.lidar}, config.run)
    trained = config.data.open_segmenter(config.run, config.checkpoint)
    told = trained.config
    index, rows = _rows(told.data, config)
    split = label_segments(index, rows, told.data, told.model.grid, told.classes, told.rule)

    def draw(position: int) -> Figure:
        return render_segmentation(view_segmentation(trained, split, position))

    return _draw_all(split, draw, config)


def _rows(data: DataConfig, config: RenderConfig) -> tuple[SampleIndex, NDArray[np.int64]]:
    """The index, and in it the split's samples, or the one asked for, wherever it is."""
    index = load_index(data.root, data.version, data.cameras)
    if config.token is None:
        return index, rows_of_split(index, data.root, data.version, config.split)
    return index, np.asarray([index.row_of(config.token)])


def _draw_all(
    split: SampleSplit, draw: Callable[[int], Figure], config: RenderConfig
) -> list[Path]:
    """As many samples as are asked for, evenly spread."""
    num = min(config.num, len(split))
    out = Path(config.out)
    save_left_out(out / LEFT_OUT, {config.split: split.left_out})
    paths = []
    for position in np.linspace(0, len(split) - 1, num).round().astype(int):
        token = str(split.index.sample_token[split.rows[position]])
        if not is_plain(token):
            raise DataError(
                f"The token '{token}' of a sample cannot be the name of a file; rename it in "
                "sample.json and sample_data.json."
            )
        paths.append(save_figure(draw(int(position)), out / f"{token}.png"))
        print(paths[-1])
    return paths


def main() -> None:
    """Entry point."""
    run(RenderConfig, render, "Draw what a trained run sees, and plans or finds.")
