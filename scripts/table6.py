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
from run_queue import Place, QueueConfig, choose, load_records, run_script

from shoot.cli.fit_templates import NumTemplates


@dataclass(frozen=True)
class TableConfig(QueueConfig):
    """What to run, and where.

    Attributes:
        folder: For data set, templates and runs; 25 GB.
        only: Planners or runs, as `camera` or `lidar10-2`; all if not given.
        records: Folder of the records.
        again: Folder of the records of the same runs made a second time, which the tables compare;
            may be missing.
        k: Number of templates.
    """

    folder: Annotated[Path, tyro.conf.Positional] = Path("runs/table6")
    only: tuple[str, ...] = ()
    records: Path = Path("docs/results")
    again: Path = Path("docs/results/again")
    k: NumTemplates = 1000


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
