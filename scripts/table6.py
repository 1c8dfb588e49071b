"""The paper's Table 6 on the synthetic city: camera, one lidar scan, ten; three seeds each.

    python scripts/table6.py [FOLDER] [--only camera lidar10] [--jobs 2]

Makes the data set, trains, evaluates and writes the tables of README.md, docs/results.md and the
pages in docs/results/; hours in all. Run again, it goes on where it was. Each finished run leaves a
record in docs/results/, and the tables are made from these records alone: copied there from other
machines, they count as done here.
"""

import os
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro
from planning_table.experiments import ALL
from planning_table.page import write_tables
from planning_table.work import prepare, run_all
from run_queue import Place, choose, load_records, run_script

from lss_core.bounds import Bounds, Workers, check_settings
from shoot.cli.fit_templates import NumTemplates


@dataclass(frozen=True)
class TableConfig:
    """What to run, and where.

    Attributes:
        folder: For data set, templates and runs; 25 GB.
        only: Planners or runs, as `camera` or `lidar10-2`; all if not given.
        jobs: Runs side by side; each gets its share of the cores.
        records: Folder of the records.
        again: Folder of the records of the same runs made a second time, which the tables compare;
            may be missing.
        pages: Folder of README.md and docs/, where the tables stand between markers.
        tables_only: Make the tables from the records and end.
        train_scenes: Scenes to train on.
        val_scenes: Scenes to evaluate on.
        k: Number of templates.
        flags: More arguments of shoot-train, for trials.
    """

    folder: Annotated[Path, tyro.conf.Positional] = Path("runs/table6")
    only: tuple[str, ...] = ()
    jobs: Workers = 2
    records: Path = Path("docs/results")
    again: Path = Path("docs/results/again")
    pages: Path = Path()
    tables_only: bool = False
    train_scenes: Annotated[int, Bounds(1, 700)] = 700
    val_scenes: Annotated[int, Bounds(1, 150)] = 100
    k: NumTemplates = 1000
    flags: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        check_settings(self)


def table6(config: TableConfig) -> list[str]:
    """Do what is left to do; returns the names of runs that failed."""
    chosen = choose(ALL, config.only)
    failed: list[str] = []
    if not config.tables_only:
        place = Place(config.folder, config.records)
        workers = len(os.sched_getaffinity(0))
        prepare(place, config.train_scenes, config.val_scenes, config.k, workers)
        failed = run_all(chosen, place, config.jobs, config.flags)
    write_tables(load_records(config.records), config.pages, load_records(config.again))
    return failed


if __name__ == "__main__":
    run_script(lambda: table6(tyro.cli(TableConfig, description=__doc__)))
