"""What the planners of Table 6 and its kin are trained on, and what the queue does with each."""

from collections.abc import Sequence
from pathlib import Path
from typing import Literal

from data_set import make_data
from run_queue import Experiment, Kind, Place
from run_queue import run_all as run_queue

from planning_table.records import record_of
from shoot.cli.fit_templates import DataSource, FitTemplatesConfig, fit
from shoot.world.config import VERSION


def templates_of(place: Place) -> Path:
    """The template file of all runs of a place."""
    return place.folder / "templates.npz"


PLANNERS = Kind(
    train_flags=lambda place: ("--templates", str(templates_of(place))),
    evaluate_flags=lambda folder: ("--html", str(folder / "report.html")),
    record_of=record_of,
    told=lambda record: f"top-10 {record['methods']['model']['top10']['value']:.1f} %",
)


def run_all(
    experiments: Sequence[Experiment], place: Place, jobs: int, flags: Sequence[str] = ()
) -> list[str]:
    """Train and evaluate planners that have no record yet; returns the names of runs that failed.

    See `run_queue.run_all`.
    """
    return run_queue(experiments, place, PLANNERS, jobs, flags)


def prepare(
    place: Place,
    train_scenes: int,
    val_scenes: int,
    k: int,
    workers: int,
    sweeps: Literal["keyframes", "all"] = "all",
) -> None:
    """Make the data set and the templates, unless they are there; see `data_set.make_data`.

    Args:
        place: Where to.
        train_scenes: Scenes to train on.
        val_scenes: Scenes to evaluate on.
        k: Number of templates.
        workers: Processes.
        sweeps: Which sweeps get files; planners that read several scans need all.
    """
    make_data(place.world, train_scenes, val_scenes, workers, sweeps)
    templates = templates_of(place)
    if not templates.exists():
        fit(FitTemplatesConfig(DataSource(str(place.world), VERSION), str(templates), k=k))
