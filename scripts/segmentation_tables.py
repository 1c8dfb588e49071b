"""The paper's Tables 1, 2 and 5 on the synthetic city: one map of four classes, from all methods.

    python scripts/segmentation_tables.py [FOLDER] [--only ours lidar10] [--jobs 2]

Makes a data set, trains, evaluates and writes the tables of docs/results/segmentation.md; hours in
all. Run again, it goes on where it was. robustness.py and transfer.py go on with its folder. Each
finished run leaves a record in docs/results/segmentation/, and the tables are made from these
records alone: copied there from other machines, they count as done here.
"""

import os
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro
from data_set import HALF_SCENES, make_data
from run_queue import Place, QueueConfig, choose, load_records, run_all, run_script
from segmentation_table.experiments import ALL
from segmentation_table.page import write_tables
from segmentation_table.records import SEGMENTATIONS

from lss_core.bounds import Bounds


@dataclass(frozen=True)
class TablesConfig(QueueConfig):
    """What to run, and where.

    Attributes:
        folder: For data set and runs; 14 GB.
        only: Methods or runs, as `oft` or `ours-2`; all if not given.
        train_scenes: Scenes to train on: half of table6.py's, for half of the preset's steps.
        records: Folder of the records.
    """

    folder: Annotated[Path, tyro.conf.Positional] = Path("runs/half")
    only: tuple[str, ...] = ()
    train_scenes: Annotated[int, Bounds(1, 700)] = HALF_SCENES
    records: Path = Path("docs/results/segmentation")


def segmentation_tables(config: TablesConfig) -> list[str]:
    """Do what is left to do; returns the names of runs that failed."""
    chosen = choose(ALL, config.only)
    failed: list[str] = []
    if not config.tables_only:
        place = Place(config.folder, config.records, "segmentation")
        workers = len(os.sched_getaffinity(0))
        make_data(place.world, config.train_scenes, config.val_scenes, workers)
        failed = run_all(chosen, place, SEGMENTATIONS, config.jobs, config.flags)
    write_tables(config.records, load_records(config.records), config.pages)
    return failed


if __name__ == "__main__":
    run_script(lambda: segmentation_tables(tyro.cli(TablesConfig, description=__doc__)))
