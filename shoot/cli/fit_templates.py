"""shoot-fit-templates: K templates, fitted to ego futures or taken from a vocabulary."""

from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Annotated

import numpy as np
import tyro
from numpy.typing import NDArray

from lss_core.bounds import Bounds, Seed, SettingError, check_settings
from lss_core.config import CAMERAS, check_cameras
from lss_core.data.drives import know_scenes
from lss_core.data.samples import SampleIndex, load_index, rows_of_split
from lss_core.data.usable import LEFT_OUT, LeftOut, save_left_out, usable_scenes
from lss_core.errors import DataError
from lss_core.files import check_writable
from lss_core.geometry import FloatArray
from shoot.cli.app import run
from shoot.rendering import render_templates, save_figure
from shoot.templates import (
    Coverage,
    TemplateSet,
    fit_templates,
    fit_templates_stream,
    read_vocabulary,
    write_vocabulary,
)
from shoot.training.run_scenes import check_apart
from shoot.trajectories import DT_S, HORIZON_S, mine_futures, whole_steps

_SCENES_A_CHUNK = 50
NumTemplates = Annotated[int, Bounds(1, 1_000_000)]


@dataclass(frozen=True)
class DataSource:
    """Where tables are.

    Attributes:
        root: Folder that holds the version's folder; only a vocabulary does without.
        version: Name of the tables' folder.
        cameras: Channels, as in training: both then share one cached index.
        skip_bad: Leave out scenes whose poses cannot be, count and list them, instead of stopping.
    """

    root: str | None = None
    version: str = "v1.0-trainval"
    cameras: tuple[str, ...] = CAMERAS
    skip_bad: bool = False

    def __post_init__(self) -> None:
        check_settings(self)
        check_cameras(self.cameras)


@dataclass(frozen=True)
class FitTemplatesConfig:
    """Fit templates to the ego trajectories of a split, or take them from a vocabulary.

    Attributes:
        data: Where tables are.
        out: Template file to write (.npz); its card (.json) and picture (.png) appear beside it.
        horizon_s: Length of the trajectories: 5 s, or that of the vocabulary.
        dt_s: Time between their points, the first of which is as late: 0.25 s. A vocabulary does
            not tell its own, so it must be given.
        vocabulary: Take the trajectories of another planner instead of fitting: an array of numpy
            (.npy), K x T x 2 (x, y), K x T x 3 (x, y, heading) or that flattened to K x 3 T, in
            metres, x forward and y left. With a data set, its futures are counted on them.
        export: Write the templates as such an array, too (.npy): float32, K x T x 3 (x, y, heading
            in radians). The heading is the direction of travel, kept where the car stands.
        split: Scenes to fit on, or to count.
        coverage_split: Scenes to measure coverage on as well, if the data set has them.
        k: Number of templates to fit.
        seed: Of K-Means.
        stream: Never hold all futures at once: mini-batch K-Means, 50 scenes at a time, for data
            sets whose futures do not fit into memory. The card says what is given up at most.
        dask: Address of a dask scheduler, as tcp://host:8786; its workers then mine the futures.
    """

    data: DataSource
    out: str
    horizon_s: Annotated[float | None, Bounds(0.01, 60.0)] = None
    dt_s: Annotated[float | None, Bounds(0.01, 10.0)] = None
    vocabulary: Annotated[str | None, tyro.conf.arg(name="from")] = None
    export: str | None = None
    split: str = "train"
    coverage_split: str = "val"
    k: NumTemplates = 1000
    seed: Seed = 0
    stream: bool = False
    dask: str | None = None

    def __post_init__(self) -> None:
        check_settings(self)
        if self.vocabulary is not None:
            if self.dt_s is None:
                raise SettingError(
                    "dt_s is not given, but a vocabulary does not tell the time between its "
                    "points: at 10 Hz, --dt-s 0.1."
                )
        elif self.data.root is None:
            raise SettingError(
                "data.root is not given; name the data set to fit to, or a vocabulary (--from)."
            )
        elif whole_steps(self.length_s, self.step_s) is None:
            raise SettingError(
                f"horizon_s is {self.length_s:g}, but must be a whole number of steps of dt_s, "
                f"{self.step_s:g}."
            )

    @property
    def step_s(self) -> float:
        """Time between points."""
        return DT_S if self.dt_s is None else self.dt_s

    @property
    def length_s(self) -> float:
        """Length of trajectories that are fitted."""
        return HORIZON_S if self.horizon_s is None else self.horizon_s


def fit(config: FitTemplatesConfig) -> TemplateSet:
    """Make templates, save file, card and picture, and report.

    Raises:
        DataError: If the data or the vocabulary is not as it should be, there are too few
            trajectories, or a scene of the other split shares a drive with one that is fitted on.
        OSError: If a file cannot be written.
    """
    out = Path(config.out)
    for path, suffix in ((config.out, ".npz"), (config.export, ".npy")):
        if path is not None and Path(path).suffix != suffix:
            what = "template file" if suffix == ".npz" else "exported vocabulary"
            raise DataError(f"The {what} must end in {suffix}, got '{path}'.")
        if path is not None:
            check_writable(path)
    given = None if config.vocabulary is None else _read_vocabulary(config)
    made = _without_data(given) if given and not config.data.root else _on_data(config, given)
    templates = made.templates
    save_left_out(out.with_suffix(f".{LEFT_OUT}"), {config.split: made.left_out})
    figure = render_templates(templates.points, templates.counts, templates.dt_s)
    save_figure(figure, out.with_suffix(".png"))
    templates.save(out)
    if made.coverage:
        print("Distance of a future to its nearest template (mean over its points, m):")
        print(f"  {'split':8} {'futures':>8} {'mean':>6} {'median':>6} {'95 %':>6} {'max':>6}")
    for name, value in made.coverage.items():
        print(
            f"  {name:8} {value.count:8d} {value.mean_m:6.2f} {value.median_m:6.2f} "
            f"{value.p95_m:6.2f} {value.max_m:6.2f}"
        )
    if made.left_out:
        print(f"Left out {len(made.left_out)} scenes, listed in {out.stem}.{LEFT_OUT}.")
    num = len(templates.points)
    print(f"Wrote {num} templates to {out} (card {out.stem}.json, picture {out.stem}.png).")
    if config.export is not None:
        write_vocabulary(config.export, templates)
        print(f"Exported: {config.export}")
    return templates


@dataclass(frozen=True)
class _Made:
    """Templates, and what a data set says of them."""

    templates: TemplateSet
    coverage: dict[str, Coverage]
    left_out: list[LeftOut]


def _read_vocabulary(config: FitTemplatesConfig) -> TemplateSet:
    templates = read_vocabulary(str(config.vocabulary), config.step_s)
    if config.horizon_s is not None and abs(config.horizon_s - templates.horizon_s) > 1e-9:
        raise DataError(
            f"'{config.vocabulary}' has {templates.points.shape[1]} points, at {config.step_s:g} s "
            f"each {templates.horizon_s:g} s in all, not {config.horizon_s:g} s (--horizon-s)."
        )
    return templates


def _without_data(given: TemplateSet) -> _Made:
    """A vocabulary as it is."""
    print(
        f"Took {len(given.points)} templates of {given.horizon_s:g} s; without --data.root no "
        "futures are counted."
    )
    return _Made(given, {}, [])


def _on_data(config: FitTemplatesConfig, given: TemplateSet | None) -> _Made:
    """Templates fitted to the futures of a data set, or given ones that these are counted on."""
    data, root = config.data, str(config.data.root)
    index = load_index(root, data.version, data.cameras)
    rows, left_out = _rows(index, root, data, config.split)
    scenes = list(dict.fromkeys(index.sample_scene[rows].tolist()))
    known = know_scenes(index, scenes)
    other = _held_out_rows(index, root, config)
    if given is None:
        held_out = know_scenes(index, np.unique(index.sample_scene[other]).tolist())
        check_apart(held_out, known, config.coverage_split, config.split)
    num_starts = sum(len(index.track_time_s[index.track(scene)]) for scene in scenes)
    times = (config.length_s, config.step_s) if given is None else (given.horizon_s, given.dt_s)

    def mine(own: NDArray[np.int64]) -> FloatArray:
        return mine_futures(index, own, "sweeps", config.dask, *times).xy_m

    if given is not None:
        shown = mine(rows)
        templates = _counted(given, shown)
    elif config.stream:
        templates, shown = _fit_stream(index.sample_scene[rows], rows, mine, config)
    else:
        shown = mine(rows)
        templates = fit_templates(shown, config.k, config.seed, config.step_s)
    num_left_out = num_starts - templates.card["num_futures"]
    print(
        f"Mined {templates.card['num_futures']} starts in {len(scenes)} scenes of "
        f"'{config.split}'; left out {num_left_out} without {templates.horizon_s:g} s of future."
    )
    if "inertia_given_up_at_most" in templates.card:
        print(
            "Fitted as a stream: the sum of squared distances is at most "
            f"{100 * templates.card['inertia_given_up_at_most']:.0f} % greater than with all "
            "futures held at once; coverage is that of a sample."
        )
    coverage = {config.split: templates.coverage(shown)}
    if len(other):
        futures = mine(other)
        if len(futures):
            coverage[config.coverage_split] = templates.coverage(futures)
    card = {
        "data": {"version": data.version, "name": Path(root).resolve().name},
        "split": config.split,
        "num_scenes": len(scenes),
        "starts": f"every LIDAR_TOP sweep with {templates.horizon_s:g} s of recorded future",
        "num_left_out": num_left_out,
        "num_bad_scenes": len(left_out),
        "coverage": {name: asdict(value) for name, value in coverage.items()},
    }
    if given is None:  # a vocabulary was not fitted on these
        card |= {
            "scene_names": [scene.name for scene in known],
            "scene_tokens": [scene.token for scene in known],
            "scene_digests": [scene.digest for scene in known],
        }
    return _Made(replace(templates, card=templates.card | card), coverage, left_out)


def _rows(
    index: SampleIndex, root: str, data: DataSource, split: str
) -> tuple[NDArray[np.int64], list[LeftOut]]:
    """Samples of a split in scenes that can be used, and the other scenes."""
    rows = rows_of_split(index, root, data.version, split)
    usable = usable_scenes(index, rows, data.skip_bad)
    scenes = dict.fromkeys(replace(one, sample="") for one in usable.left_out)
    return usable.rows, list(scenes)


def _held_out_rows(index: SampleIndex, root: str, config: FitTemplatesConfig) -> NDArray[np.int64]:
    """Samples of the split that coverage is measured on as well; none where there is no such."""
    if config.coverage_split == config.split:
        return np.zeros(0, dtype=np.int64)
    try:
        return _rows(index, root, config.data, config.coverage_split)[0]
    except DataError as error:
        print(f"No coverage on '{config.coverage_split}': {error}")
        return np.zeros(0, dtype=np.int64)


def _counted(given: TemplateSet, futures: FloatArray) -> TemplateSet:
    """A vocabulary with the futures nearest to each of its trajectories counted."""
    counts = np.bincount(given.nearest(futures), minlength=len(given.points))
    return replace(given, counts=counts, card=given.card | {"num_futures": len(futures)})


def _fit_stream(
    scene_of_row: NDArray[np.int64],
    rows: NDArray[np.int64],
    mine: Callable[[NDArray[np.int64]], FloatArray],
    config: FitTemplatesConfig,
) -> tuple[TemplateSet, FloatArray]:
    """Templates, and some futures."""
    scenes = np.unique(scene_of_row)

    def chunks() -> Iterator[FloatArray]:
        for first in range(0, len(scenes), _SCENES_A_CHUNK):
            yield mine(rows[np.isin(scene_of_row, scenes[first : first + _SCENES_A_CHUNK])])

    return fit_templates_stream(chunks, config.k, config.seed, config.step_s)


def main() -> None:
    """Entry point."""
    run(FitTemplatesConfig, fit, "Fit K templates to ego futures by K-Means, or take a vocabulary.")
