"""Templates on a data set: fitted to its futures, or given ones on which these are counted."""

from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from lss_core.data.drives import know_scenes
from lss_core.data.samples import SampleIndex, load_index, rows_of_split
from lss_core.data.usable import LeftOut, usable_scenes
from lss_core.errors import DataError
from lss_core.geometry import FloatArray
from shoot.cli.template_settings import DataSource, FitTemplatesConfig
from shoot.templates import Coverage, TemplateSet, fit_templates, fit_templates_stream
from shoot.training.run_scenes import check_apart
from shoot.trajectories import mine_futures

_SCENES_A_CHUNK = 50


@dataclass(frozen=True)
class MadeTemplates:
    """Templates, and what a data set says of them.

    Attributes:
        templates: With their card.
        coverage: By split; empty if no data set was looked at.
        left_out: Scenes that could not be used.
    """

    templates: TemplateSet
    coverage: dict[str, Coverage]
    left_out: list[LeftOut]


def templates_on_data(config: FitTemplatesConfig, given: TemplateSet | None) -> MadeTemplates:
    """Templates fitted to the futures of a data set, or given ones that these are counted on.

    Args:
        config: What to fit, and on which scenes; says what was mined.
        given: A vocabulary; None: templates are fitted.

    Raises:
        DataError: If the data is not as it should be, has too few trajectories, or a scene of the
            other split shares a drive with one that is fitted on.
    """
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
        templates = fit_templates(shown, config.k, config.seed, config.step_s, config.method)
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
    return MadeTemplates(replace(templates, card=templates.card | card), coverage, left_out)


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
