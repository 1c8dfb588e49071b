"""What the planners of Table 6 and its kin are trained on, and what the queue does with each."""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Literal

from run_queue import Experiment, Kind, Place
from run_queue import run_all as run_queue

from lss_core.data.splits import official_scenes
from lss_core.files import write_atomically
from planning_table.experiments import HALF
from planning_table.records import record_of
from shoot.cli.fit_templates import DataSource, FitTemplatesConfig, fit
from shoot.world.config import VERSION, MakeWorldConfig
from shoot.world.writer import make_world


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
    """Make the data set, its splits and the templates, unless they are there.

    Args:
        place: Where to.
        train_scenes: Scenes to train on.
        val_scenes: Scenes to evaluate on.
        k: Number of templates.
        workers: Processes.
        sweeps: Which sweeps get files; planners that read several scans need all.
    """
    make_world(
        MakeWorldConfig(
            out=place.world,
            train_scenes=train_scenes,
            val_scenes=val_scenes,
            image_scale=0.11,
            scenes_per_town=2,
            tail_s=5.0,
            sweeps=sweeps,
            lidar_azimuths=128,
            workers=workers,
        )
    )
    train = official_scenes(VERSION, "train")[:train_scenes]
    splits = {
        "train": train,
        "val": official_scenes(VERSION, "val")[:val_scenes],
        HALF: train[: -(-train_scenes // 2)],
    }
    with write_atomically(place.world / VERSION / "splits.json") as stream:
        stream.write(json.dumps(splits).encode())
    if not templates_of(place).exists():
        fit(
            FitTemplatesConfig(DataSource(str(place.world), VERSION), str(templates_of(place)), k=k)
        )
