"""Robustness: noisy mountings, dead cameras, new ones (the paper's Figures 6 and 7, Table 3).

    python scripts/robustness.py [FOLDER] [--task segmentation] [--jobs 2]

Trains a segmentation and a planner as usual, with noise, with dropped cameras and with four of the
six, asks each of them under all conditions, and writes tables and pictures of
docs/results/robustness.md; hours in all. Run again, it goes on where it was. Records go to
docs/results/robustness/, and what the page shows is made from these alone, all but one picture of
what a run sees.
"""

import logging
import os
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import tyro
from data_set import HALF_SCENES
from planning_table.work import PLANNERS, prepare
from robustness_table.asking import SPLIT, ask
from robustness_table.conditions import PLAIN, Condition, conditions_of, runs_of
from robustness_table.curves_figure import draw_curves
from robustness_table.missing_figure import draw_missing
from robustness_table.page import write_tables
from robustness_table.paired import asked_file
from robustness_table.rig_figure import draw_rig
from run_queue import Place, QueueConfig, is_trained, load_records, run_all, run_script, save_record
from segmentation_table.records import SEGMENTATIONS

from lss_core.bounds import Bounds, Count

logger = logging.getLogger(__name__)

Task = Literal["segmentation", "planning"]
_KINDS = {"segmentation": SEGMENTATIONS, "planning": PLANNERS}


@dataclass(frozen=True)
class RobustnessConfig(QueueConfig):
    """What to run, and where.

    Attributes:
        folder: For data set, templates and runs; that of segmentation_tables.py has the data set.
        task: Which runs; both if not given.
        train_scenes: Scenes to train on: half of table6.py's, for half of its steps.
        every: Every so many validation samples are asked about.
        records: Folder of the records.
    """

    folder: Annotated[Path, tyro.conf.Positional] = Path("runs/half")
    task: tuple[Task, ...] = ("segmentation", "planning")
    train_scenes: Annotated[int, Bounds(1, 700)] = HALF_SCENES
    every: Count = 6
    records: Path = Path("docs/results/robustness")


def robustness(config: RobustnessConfig) -> list[str]:
    """Do what is left to do; returns the names of runs that failed."""
    failed: list[str] = []
    for task in () if config.tables_only else config.task:
        place = Place(config.folder, config.records / "runs" / task, task)
        workers = len(os.sched_getaffinity(0))
        prepare(place, config.train_scenes, config.val_scenes, 1000, workers)
        runs = runs_of(task)
        failed += run_all(list(runs.values()), place, _KINDS[task], config.jobs, config.flags)
        for name, run in runs.items():
            if is_trained(place.run(run)):
                for condition in conditions_of(name):
                    _ask_once(task, name, place.run(run), condition, config)
                if (task, name) == ("segmentation", PLAIN):
                    draw_missing(place.run(run), _picture(config, "missing"))
    write_tables(config.records, config.pages)
    records = load_records(config.records)
    draw_curves(records, _picture(config, "curves"))
    draw_rig(records, _picture(config, "rig"))
    return failed


def _picture(config: RobustnessConfig, name: str) -> Path:
    return config.pages / "docs" / "images" / f"robustness_{name}.png"


def _ask_once(
    task: Task, name: str, folder: Path, condition: Condition, config: RobustnessConfig
) -> None:
    """Leave a record of it, unless there is one."""
    file = asked_file(config.records, task, name, condition.name)
    if file.exists():
        return
    logger.info(f"{task}, {name}: asked with {condition.name}")
    said = {"task": task, "run": name, "condition": condition.name}
    said |= {"split": SPLIT, "every": config.every}
    save_record(said | ask(task, folder, condition, config.every), file)


if __name__ == "__main__":
    run_script(lambda: robustness(tyro.cli(RobustnessConfig, description=__doc__)))
