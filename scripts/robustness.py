"""Robustness: noisy mountings, dead cameras, new ones (the paper's Figures 6 and 7, Table 3).

    python scripts/robustness.py [FOLDER] [--task segmentation] [--jobs 2]

Trains a segmentation and a planner as usual, with noise, with dropped cameras and with four of the
six, asks each of them under all conditions, and writes the tables of docs/results/robustness.md;
hours in all. Run again, it goes on where it was. Records go to docs/results/robustness/, and the
tables are made from these alone.
"""

import logging
import os
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import tyro
from data_set import make_data
from planning_table.work import PLANNERS, prepare
from robustness_table.asking import ask
from robustness_table.conditions import Condition, conditions_of, runs_of
from robustness_table.page import write_tables
from run_queue import Experiment, Place, load_records, run_all, run_script, save_record
from segmentation_table.records import SEGMENTATIONS

from lss_core.bounds import Bounds, Count, Workers, check_settings

logger = logging.getLogger(__name__)

Task = Literal["segmentation", "planning"]
_KINDS = {"segmentation": SEGMENTATIONS, "planning": PLANNERS}


@dataclass(frozen=True)
class RobustnessConfig:
    """What to run, and where.

    Attributes:
        folder: For data set and runs; that of table6.py has the data set.
        task: Which runs; both if not given.
        jobs: Runs side by side; each gets its share of the cores.
        every: Every so many validation samples are asked about.
        records: Folder of the records.
        pages: Folder of README.md and docs/, where the tables stand between markers.
        tables_only: Make the tables from the records and end.
        train_scenes: Scenes to train on.
        val_scenes: Scenes to evaluate on.
        flags: More arguments of shoot-train, for trials.
    """

    folder: Annotated[Path, tyro.conf.Positional] = Path("runs/table6")
    task: tuple[Task, ...] = ("segmentation", "planning")
    jobs: Workers = 2
    every: Count = 3
    records: Path = Path("docs/results/robustness")
    pages: Path = Path()
    tables_only: bool = False
    train_scenes: Annotated[int, Bounds(1, 700)] = 700
    val_scenes: Annotated[int, Bounds(1, 150)] = 100
    flags: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        check_settings(self)


def robustness(config: RobustnessConfig) -> list[str]:
    """Do what is left to do; returns the names of runs that failed."""
    failed: list[str] = []
    for task in () if config.tables_only else config.task:
        place = Place(config.folder, config.records / "runs" / task, f"robustness-{task}")
        sizes = config.train_scenes, config.val_scenes
        workers = len(os.sched_getaffinity(0))
        if task == "planning":
            prepare(place, *sizes, k=1000, workers=workers)
        else:
            make_data(place.world, *sizes, workers, "all")
        runs = runs_of(task)
        failed += run_all(runs, place, _KINDS[task], config.jobs, config.flags)
        for run in runs:
            if place.record(run).exists():
                for condition in conditions_of(run):
                    _ask_once(task, place, run, condition, config)
    write_tables(load_records(config.records), config.pages)
    return failed


def _ask_once(
    task: Task, place: Place, run: Experiment, condition: Condition, config: RobustnessConfig
) -> None:
    """Leave a record of it, unless there is one."""
    file = config.records / f"{task}-{run.planner}-{condition.name.replace(' ', '')}.json"
    if file.exists():
        return
    logger.info(f"{task}, {run.planner}: asked with {condition.name}")
    scores = ask(task, place.run(run), condition, config.every)
    said = {"task": task, "run": run.planner, "condition": condition.name, "every": config.every}
    save_record(said | {"scores": scores}, file)


if __name__ == "__main__":
    run_script(lambda: robustness(tyro.cli(RobustnessConfig, description=__doc__)))
