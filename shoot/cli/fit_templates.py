"""shoot-fit-templates: mine ego futures and fit K templates to them."""

from collections.abc import Iterator
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Annotated

import numpy as np
from numpy.typing import NDArray

from lss_core.bounds import Bounds, Seed, check_settings
from lss_core.config import CAMERAS, check_cameras
from lss_core.data.drives import know_scenes
from lss_core.data.samples import SampleIndex, load_index, rows_of_split
from lss_core.data.usable import LEFT_OUT, LeftOut, save_left_out, usable_scenes
from lss_core.errors import DataError
from lss_core.files import check_writable
from lss_core.geometry import FloatArray
from shoot.cli.app import run
from shoot.rendering import render_templates, save_figure
from shoot.templates import TemplateSet, fit_templates, fit_templates_stream
from shoot.training.run_scenes import check_apart
from shoot.trajectories import mine_futures

_SCENES_A_CHUNK = 50
NumTemplates = Annotated[int, Bounds(1, 1_000_000)]


@dataclass(frozen=True)
class DataSource:
    """Where tables are.

    Attributes:
        root: Folder that holds the version's folder.
        version: Name of the tables' folder.
        cameras: Channels, as in training: both then share one cached index.
        skip_bad: Leave out scenes whose poses cannot be, count and list them, instead of stopping.
    """

    root: str
    version: str = "v1.0-trainval"
    cameras: tuple[str, ...] = CAMERAS
    skip_bad: bool = False

    def __post_init__(self) -> None:
        check_settings(self)
        check_cameras(self.cameras)


@dataclass(frozen=True)
class FitTemplatesConfig:
    """Fit templates to the ego trajectories of a split.

    Attributes:
        data: Where tables are.
        out: Template file to write (.npz); its card (.json) and picture (.png) appear beside it.
        split: Scenes to fit on.
        coverage_split: Scenes to measure coverage on as well, if the data set has them.
        k: Number of templates.
        seed: Of K-Means.
        stream: Never hold all futures at once: mini-batch K-Means, 50 scenes at a time, for data
            sets whose futures do not fit into memory. The card says what is given up at most.
        dask: Address of a dask scheduler, as tcp://host:8786; its workers then mine the futures.
    """

    data: DataSource
    out: str
    split: str = "train"
    coverage_split: str = "val"
    k: NumTemplates = 1000
    seed: Seed = 0
    stream: bool = False
    dask: str | None = None

    def __post_init__(self) -> None:
        check_settings(self)


def fit(config: FitTemplatesConfig) -> TemplateSet:
    """Mine, fit, save file, card and picture, and report.

    Raises:
        DataError: If the data is not as it should be, has too few trajectories, or a scene of the
            other split shares a drive with one that is fitted on.
        OSError: If a file cannot be written.
    """
    out = Path(config.out)
    if out.suffix != ".npz":
        raise DataError(f"The template file must end in .npz, got '{out}'.")
    check_writable(out)
    index = load_index(config.data.root, config.data.version, config.data.cameras)
    rows, left_out = _rows(index, config.data, config.split)
    scenes = list(dict.fromkeys(index.sample_scene[rows].tolist()))
    known = know_scenes(index, scenes)
    other = _held_out_rows(index, config)
    held_out = know_scenes(index, np.unique(index.sample_scene[other]).tolist())
    check_apart(held_out, known, config.coverage_split, config.split)
    num_starts = sum(len(index.track_time_s[index.track(scene)]) for scene in scenes)
    templates, shown = (_fit_stream if config.stream else _fit_all)(index, rows, config)
    num_left_out = num_starts - templates.card["num_futures"]
    print(
        f"Mined {templates.card['num_futures']} starts in {len(scenes)} scenes of "
        f"'{config.split}'; left out {num_left_out} without 5 s of future."
    )
    if config.stream:
        print(
            "Fitted as a stream: the sum of squared distances is at most "
            f"{100 * templates.card['inertia_given_up_at_most']:.0f} % greater than with all "
            "futures held at once; coverage is that of a sample."
        )
    coverage = {config.split: templates.coverage(shown)}
    if len(other):
        futures = mine_futures(index, other, "sweeps", config.dask).xy_m
        if len(futures):
            coverage[config.coverage_split] = templates.coverage(futures)
    card = {
        "data": {"version": config.data.version, "name": Path(config.data.root).resolve().name},
        "split": config.split,
        "num_scenes": len(scenes),
        "scene_names": [scene.name for scene in known],
        "scene_tokens": [scene.token for scene in known],
        "scene_digests": [scene.digest for scene in known],
        "starts": "every LIDAR_TOP sweep with 5 s of recorded future",
        "num_left_out": num_left_out,
        "num_bad_scenes": len(left_out),
        "coverage": {name: asdict(value) for name, value in coverage.items()},
    }
    templates = replace(templates, card=templates.card | card)
    save_left_out(out.with_suffix(f".{LEFT_OUT}"), {config.split: left_out})
    save_figure(render_templates(templates.points, templates.counts), out.with_suffix(".png"))
    templates.save(out)
    print("Distance of a future to its nearest template (mean over its points, m):")
    print(f"  {'split':8} {'futures':>8} {'mean':>6} {'median':>6} {'95 %':>6} {'max':>6}")
    for name, value in coverage.items():
        print(
            f"  {name:8} {value.count:8d} {value.mean_m:6.2f} {value.median_m:6.2f} "
            f"{value.p95_m:6.2f} {value.max_m:6.2f}"
        )
    if left_out:
        print(f"Left out {len(left_out)} scenes, listed in {out.stem}.{LEFT_OUT}.")
    print(f"Wrote {config.k} templates to {out} (card {out.stem}.json, picture {out.stem}.png).")
    return templates


def _rows(
    index: SampleIndex, data: DataSource, split: str
) -> tuple[NDArray[np.int64], list[LeftOut]]:
    """Samples of a split in scenes that can be used, and the other scenes."""
    rows = rows_of_split(index, data.root, data.version, split)
    usable = usable_scenes(index, rows, data.skip_bad)
    scenes = dict.fromkeys(replace(one, sample="") for one in usable.left_out)
    return usable.rows, list(scenes)


def _held_out_rows(index: SampleIndex, config: FitTemplatesConfig) -> NDArray[np.int64]:
    """Samples of the split that coverage is measured on as well; none where there is no such."""
    if config.coverage_split == config.split:
        return np.zeros(0, dtype=np.int64)
    try:
        return _rows(index, config.data, config.coverage_split)[0]
    except DataError as error:
        print(f"No coverage on '{config.coverage_split}': {error}")
        return np.zeros(0, dtype=np.int64)


def _fit_all(
    index: SampleIndex, rows: NDArray[np.int64], config: FitTemplatesConfig
) -> tuple[TemplateSet, FloatArray]:
    """Templates, and the futures they were fitted to."""
    futures = mine_futures(index, rows, "sweeps", config.dask).xy_m
    return fit_templates(futures, config.k, config.seed), futures


def _fit_stream(
    index: SampleIndex, rows: NDArray[np.int64], config: FitTemplatesConfig
) -> tuple[TemplateSet, FloatArray]:
    """Templates, and some futures."""
    scene_of_row = index.sample_scene[rows]
    scenes = np.unique(scene_of_row)

    def chunks() -> Iterator[FloatArray]:
        for first in range(0, len(scenes), _SCENES_A_CHUNK):
            own = rows[np.isin(scene_of_row, scenes[first : first + _SCENES_A_CHUNK])]
            yield mine_futures(index, own, "sweeps", config.dask).xy_m

    return fit_templates_stream(chunks, config.k, config.seed)


def main() -> None:
    """Entry point."""
    run(FitTemplatesConfig, fit, "Mine ego futures and fit K templates to them by K-Means.")
