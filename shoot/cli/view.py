"""shoot-view: a scene as a page to scrub through, with what a trained planner makes of it."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
import tyro
from numpy.typing import NDArray

from lss_core.bounds import check_settings
from lss_core.data.samples import SampleIndex, load_index, rows_of_split
from lss_core.data.usable import Needs
from lss_core.errors import DataError
from lss_core.files import check_writable
from lss_core.legible import legible
from shoot.cli.app import run
from shoot.cli.asked_run import OtherData
from shoot.report.viewer.page import write_viewer
from shoot.report.viewer.scene import MOST_SAMPLES, view_scene
from shoot.training.config import task_of
from shoot.training.planning.data import label_rows
from shoot.training.segmentation.config import SegmentConfig

# Of a message: how many names of scenes, and how much of each.
_NAMED, _LETTERS = 3, 60


@dataclass(frozen=True)
class ViewConfig:
    """Write a page that scrubs through a scene: images, cost map, ranked and driven paths.

    It is one file for any browser, below 20 MB, and needs no network.

    Attributes:
        run: Run folder of a planner.
        out: Page to write, HTML.
        split: Scenes to choose from.
        scene: Name of the scene; the first of the split if not given.
        checkpoint: `last` or `best`.
        data: Data other than the run's own.
    """

    run: Annotated[str, tyro.conf.Positional]
    out: str
    split: str = "val"
    scene: str | None = None
    checkpoint: Literal["last", "best"] = "last"
    data: OtherData = field(default_factory=OtherData)

    def __post_init__(self) -> None:
        check_settings(self)


def view(config: ViewConfig) -> Path:
    """Write the page and say its size; returns its path.

    Raises:
        DataError: If run, data or scene are not as they should be.
        OSError: If the page cannot be written.
    """
    if task_of(Path(config.run)) == SegmentConfig.task:
        raise DataError(
            f"'{legible(config.run)}' is a segmentation, and shoot-view shows planners; draw what "
            "it finds with shoot-render."
        )
    check_writable(config.out)
    trained = config.data.open_run(config.run, config.checkpoint)
    data = trained.config.data
    index = load_index(data.root, data.version, data.cameras)
    rows = rows_of_split(index, data.root, data.version, config.split)
    rows = _of_scene(index, rows, config)
    step = -(-len(rows) // MOST_SAMPLES)
    name = legible(str(index.scene_name[index.sample_scene[rows[0]]]))
    needs = Needs.of_planner(data.lidar_scans)
    split = label_rows(index, rows[::step], data, trained.templates, needs, f"of scene '{name}' ")
    about = [f"Run {legible(Path(config.run).resolve().name)}, checkpoint {config.checkpoint}."]
    if step > 1:
        about.append(f"Of the scene's {len(rows)} samples one in {step} is shown.")
    size = write_viewer(view_scene(trained, split, about), config.out)
    print(f"Page: {config.out}, {len(split)} samples of {name}, {size / 1e6:.1f} MB")
    return Path(config.out)


def _of_scene(index: SampleIndex, rows: NDArray[np.int64], config: ViewConfig) -> NDArray[np.int64]:
    """Those of the split's rows that are of the scene asked for, or of the first."""
    scenes = index.sample_scene[rows]
    wanted = config.scene
    is_wanted = (
        np.ones(len(rows), dtype=bool) if wanted is None else index.scene_name[scenes] == wanted
    )
    if not is_wanted.any():
        names = list(dict.fromkeys(index.scene_name[scenes].tolist()))
        some = ", ".join(f"'{legible(str(name)[:_LETTERS])}'" for name in names[:_NAMED])
        raise DataError(
            f"There is no scene '{legible(str(wanted)[:_LETTERS])}' in split '{config.split}', "
            f"which has {len(names)}: {some}{', ...' if len(names) > _NAMED else ''}."
        )
    own: NDArray[np.int64] = rows[scenes == scenes[is_wanted][0]]
    return own


def main() -> None:
    """Entry point."""
    run(ViewConfig, view, "Write a page that scrubs through a scene of a trained planner.")
