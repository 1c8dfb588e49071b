"""shoot-fit-templates: mine ego futures and fit K templates to them."""

from dataclasses import asdict, dataclass, replace
from pathlib import Path

from lss_core.config import CAMERAS
from lss_core.data.samples import load_index, rows_of_split
from lss_core.errors import DataError
from shoot.cli.app import run
from shoot.rendering import render_templates, save_figure
from shoot.templates import TemplateSet, fit_templates
from shoot.trajectories import mine_futures


@dataclass(frozen=True)
class DataSource:
    """Where tables are.

    Attributes:
        root: Folder that holds the version's folder.
        version: Name of the tables' folder.
        cameras: Channels, as in training: both then share one cached index.
    """

    root: str
    version: str = "v1.0-trainval"
    cameras: tuple[str, ...] = CAMERAS


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
        dask: Address of a dask scheduler, as tcp://host:8786; its workers then mine the futures.
    """

    data: DataSource
    out: str
    split: str = "train"
    coverage_split: str = "val"
    k: int = 1000
    seed: int = 0
    dask: str | None = None


def fit(config: FitTemplatesConfig) -> TemplateSet:
    """Mine, fit, save file, card and picture, and report.

    Raises:
        DataError: If the data is not as it should be or has too few trajectories.
    """
    out = Path(config.out)
    if out.suffix != ".npz":
        raise DataError(f"The template file must end in .npz, got '{out}'.")
    index = load_index(config.data.root, config.data.version, config.data.cameras)
    rows = rows_of_split(index, config.data.root, config.data.version, config.split)
    futures = mine_futures(index, rows, "sweeps", config.dask)
    num_scenes = len(set(futures.scene.tolist()))
    print(
        f"Mined {len(futures.xy_m)} starts in {num_scenes} scenes of '{config.split}'; left out "
        f"{futures.num_left_out} without 5 s of future."
    )
    templates = fit_templates(futures.xy_m, config.k, config.seed)
    coverage = {config.split: templates.coverage(futures.xy_m)}
    try:
        other = rows_of_split(index, config.data.root, config.data.version, config.coverage_split)
        held_out = mine_futures(index, other, "sweeps", config.dask).xy_m
        if config.coverage_split != config.split and len(held_out):
            coverage[config.coverage_split] = templates.coverage(held_out)
    except DataError as error:
        print(f"No coverage on '{config.coverage_split}': {error}")
    card = {
        "data": {"version": config.data.version, "name": Path(config.data.root).resolve().name},
        "split": config.split,
        "num_scenes": num_scenes,
        "starts": "every LIDAR_TOP sweep with 5 s of recorded future",
        "num_left_out": futures.num_left_out,
        "coverage": {name: asdict(value) for name, value in coverage.items()},
    }
    templates = replace(templates, card=templates.card | card)
    templates.save(out)
    save_figure(render_templates(templates.points, templates.counts), out.with_suffix(".png"))
    print("Distance of a future to its nearest template (mean over its points, m):")
    print(f"  {'split':8} {'futures':>8} {'mean':>6} {'median':>6} {'95 %':>6} {'max':>6}")
    for name, value in coverage.items():
        print(
            f"  {name:8} {value.count:8d} {value.mean_m:6.2f} {value.median_m:6.2f} "
            f"{value.p95_m:6.2f} {value.max_m:6.2f}"
        )
    print(f"Wrote {config.k} templates to {out} (card {out.stem}.json, picture {out.stem}.png).")
    return templates


def main() -> None:
    """Entry point."""
    run(FitTemplatesConfig, fit, "Mine ego futures and fit K templates to them by K-Means.")
