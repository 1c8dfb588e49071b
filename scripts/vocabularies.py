"""Vocabularies: five methods at five sizes, beside held-out drives and under the same planner.

    python scripts/vocabularies.py [FOLDER] [--part coverage planners] [--jobs 2]

Fits every vocabulary and measures how near it comes to what was driven (minutes), then trains the
camera planner of table6.py in half of its steps on each method at K = 1000 and on K-Means at each
K, three seeds each (hours), and writes the tables of docs/templates.md. Run again, it goes on where
it was. What is done leaves a record in docs/results/vocabularies/, and the tables are made from
these alone.
"""

import logging
import os
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import tyro
from data_set import make_data
from marked_page import fill_pages
from run_queue import Place, QueueConfig, choose, load_records, run_all, run_script, save_record
from vocabulary_table.coverage import measure, read_drives
from vocabulary_table.page import all_tables
from vocabulary_table.planners import ON_VOCABULARIES, make_file
from vocabulary_table.vocabularies import ALL, TRAINED, runs_on

from shoot.world.config import VERSION

logger = logging.getLogger(__name__)


@dataclass(frozen=True)
class VocabulariesConfig(QueueConfig):
    """What to run, and where.

    Attributes:
        folder: For data set, template files and runs; 10 GB. A data set that is there (`world`) is
            taken as it is.
        part: Coverage, which needs tables only, or planners.
        only: Vocabularies or runs on them, as `cover-1000` or `kmeans-250-0`; all if not given.
        records: Folder of the records.
    """

    folder: Annotated[Path, tyro.conf.Positional] = Path("runs/vocabularies")
    part: tuple[Literal["coverage", "planners"], ...] = ("coverage", "planners")
    only: tuple[str, ...] = ()
    records: Path = Path("docs/results/vocabularies")


def vocabularies(config: VocabulariesConfig) -> list[str]:
    """Do what is left to do; returns the names of runs that failed."""
    failed: list[str] = []
    place = Place(config.folder, config.records / "planners", "runs")
    coverage = config.records / "coverage"
    if not config.tables_only:
        if not (place.world / VERSION / "scene.json").exists():
            workers = len(os.sched_getaffinity(0))
            sizes = config.train_scenes, config.val_scenes
            make_data(place.world, *sizes, workers, "keyframes")
        if "coverage" in config.part:
            cover_all(place.world, coverage, config.only)
        if "planners" in config.part:
            runs = choose(runs_on(TRAINED, place), config.only)
            names = {run.planner for run in runs}
            for vocabulary in TRAINED:
                if vocabulary.name in names:
                    make_file(vocabulary, place)
            failed = run_all(runs, place, ON_VOCABULARIES, config.jobs, config.flags)
    fill_pages(config.pages, all_tables(load_records(coverage), load_records(place.records)))
    return failed


def cover_all(world: Path, records: Path, only: tuple[str, ...]) -> None:
    """Leave a record of each vocabulary that has none."""
    chosen = [v for v in ALL if not only or v.name in only or v.method in only]
    left = [v for v in chosen if not (records / f"{v.name}.json").exists()]
    logger.info(f"{len(chosen) - len(left)} of {len(chosen)} vocabularies are measured.")
    drives = read_drives(world) if left else None
    for vocabulary in left:
        logger.info(f"{vocabulary.name}: fitting")
        record = measure(vocabulary, drives)
        save_record(record, records / f"{vocabulary.name}.json")
        metres, took_s = record["coverage"]["val"]["mean_m"], record["fit_cpu_s"]
        logger.info(f"{vocabulary.name}: {metres:.2f} m from held-out drives, {took_s:.0f} s")


if __name__ == "__main__":
    run_script(lambda: vocabularies(tyro.cli(VocabulariesConfig, description=__doc__)))
