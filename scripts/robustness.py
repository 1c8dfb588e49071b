"""Robustness: noisy mountings, dead cameras, new ones (the paper's Figures 6 and 7, Table 3).

    python scripts/robustness.py [FOLDER] [--task segmentation] [--jobs 2]

Trains a segmentation and a planner as usual, with noise, with dropped cameras and with four of the
six, asks each of them under all conditions, and writes tables and pictures of
docs/results/robustness.md; hours in all. Those trained as usual are taken from
segmentation_tables.py and table6.py, where these have run in the same folder. Run again, it goes on
where it was. Records go to docs/results/robustness/, and what the page shows is made from these
alone, all but one picture of what a run sees.
"""

import logging
import os
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Literal

import tyro
from data_set import make_data
from planning_table.work import PLANNERS, prepare
from robustness_table.asking import ask
from robustness_table.conditions import PLAIN, Condition, conditions_of, runs_of
from robustness_table.curves_figure import draw_curves
from robustness_table.missing_figure import draw_missing
from robustness_table.page import write_tables
from robustness_table.rig_figure import draw_rig
from run_queue import Place, QueueConfig, is_trained, load_records, run_all, run_script, save_record
from segmentation_table.records import SEGMENTATIONS

from lss_core.bounds import Count

logger = logging.getLogger(__name__)

Task = Literal["segmentation", "planning"]
_KINDS = {"segmentation": SEGMENTATIONS, "planning": PLANNERS}
# Groups of the runs of segmentation_tables.py and of table6.py.
_TABLES = {"segmentation": "segmentation", "planning": ""}


@dataclass(frozen=True)
class RobustnessConfig(QueueConfig):
    """What to run, and where.

    Attributes:
        folder: For data set and runs; that of table6.py has the data set.
        task: Which runs; both if not given.
        every: Every so many validation samples are asked about.
        records: Folder of the records.
    """

    folder: Annotated[Path, tyro.conf.Positional] = Path("runs/table6")
    task: tuple[Task, ...] = ("segmentation", "planning")
    every: Count = 3
    records: Path = Path("docs/results/robustness")


def robustness(config: RobustnessConfig) -> list[str]:
    """Do what is left to do; returns the names of runs that failed."""
    failed: list[str] = []
    for task in () if config.tables_only else config.task:
        sizes = config.train_scenes, config.val_scenes
        workers = len(os.sched_getaffinity(0))
        own = _own_place(task, config)
        if task == "planning":
            prepare(own, *sizes, k=1000, workers=workers)
        else:
            make_data(own.world, *sizes, workers)
        runs = runs_of(task)
        to_train = [run for name, run in runs.items() if _place_of(task, name, config) == own]
        failed += run_all(to_train, own, _KINDS[task], config.jobs, config.flags)
        for name, run in runs.items():
            folder = _place_of(task, name, config).run(run)
            if is_trained(folder):
                for condition in conditions_of(name):
                    _ask_once(task, name, folder, condition, config)
                if (task, name) == ("segmentation", PLAIN):
                    draw_missing(folder, _picture(config, "missing"))
    records = load_records(config.records)
    write_tables(records, config.pages)
    draw_curves(records, _picture(config, "curves"))
    draw_rig(records, _picture(config, "rig"))
    return failed


def _picture(config: RobustnessConfig, name: str) -> Path:
    return config.pages / "docs" / "images" / f"robustness_{name}.png"


def _own_place(task: Task, config: RobustnessConfig) -> Place:
    return Place(config.folder, config.records / "runs" / task, f"robustness-{task}")


def _place_of(task: Task, name: str, config: RobustnessConfig) -> Place:
    """Where a run is: the plain one with those of the tables, if it has been trained there."""
    own = _own_place(task, config)
    tables = replace(own, group=_TABLES[task])
    shared = name == PLAIN and is_trained(tables.run(runs_of(task)[name]))
    return tables if shared else own


def _ask_once(
    task: Task, name: str, folder: Path, condition: Condition, config: RobustnessConfig
) -> None:
    """Leave a record of it, unless there is one."""
    file = config.records / f"{task}-{name}-{condition.name.replace(' ', '')}.json"
    if file.exists():
        return
    logger.info(f"{task}, {name}: asked with {condition.name}")
    scores = ask(task, folder, condition, config.every)
    said = {"task": task, "run": name, "condition": condition.name, "every": config.every}
    save_record(said | {"scores": scores}, file)


if __name__ == "__main__":
    run_script(lambda: robustness(tyro.cli(RobustnessConfig, description=__doc__)))
