"""Another rig: segmentations of nuScenes' cameras, asked with Lyft's (the paper's Table 4).

    python scripts/transfer.py [FOLDER] [--jobs 2]

Trains the methods that see images, makes the validation towns once more, as a car with the cameras
of Lyft Level 5 sees them, asks each method there, and writes the table of docs/results/transfer.md;
hours in all. Run again, it goes on where it was. Records go to docs/results/transfer/, and the
table is made from these alone.
"""

import logging
import os
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated

import tyro
from data_set import HALF_SCENES, make_data
from marked_page import fill_pages
from planning_table.cells import markdown, spread, value_cell
from run_queue import (
    Experiment,
    Place,
    QueueConfig,
    Record,
    budget_of,
    is_trained,
    load_records,
    run_all,
    run_script,
    save_record,
)
from segmentation_table.experiments import CAMERAS, FLAGS, HALF_STEPS, OURS
from segmentation_table.records import SEGMENTATIONS

from lss_core.bounds import Bounds
from shoot.evaluation.segmentation.paired import load_overlaps, paired_iou
from shoot.evaluation.segmentation.scoring import score_segmentation
from shoot.prediction.segmenter import open_segmenter
from shoot.world.config import MakeWorldConfig
from shoot.world.writer import make_world

logger = logging.getLogger(__name__)

# Philion and Fidler's table, IoU in per cent: trained on nuScenes, tested on Lyft.
_PAPER = {
    "cnn": {"car": 7.00, "vehicle": 8.06},
    "frozen": {"car": 15.08, "vehicle": 15.82},
    "oft": {"car": 16.25, "vehicle": 16.27},
    OURS: {"car": 21.35, "vehicle": 22.59},
}
_CLASSES = ("car", "vehicle")
_AT_HOME = "at_home"  # folder of the records with the own rig
_NOTHING = "No run of these is finished yet."
# Those of the paper, and ours without learned depth.
RUNS = tuple(
    Experiment(method, "segment", 0, (*FLAGS[method], *HALF_STEPS))
    for method in (OURS, "cnn", "frozen", "oft", "uniform")
)


@dataclass(frozen=True)
class TransferConfig(QueueConfig):
    """What to run, and where.

    Attributes:
        folder: For data sets of both rigs, and runs; that of robustness.py has the first.
        train_scenes: Scenes to train on.
        records: Folder of the records.
    """

    folder: Annotated[Path, tyro.conf.Positional] = Path("runs/robustness")
    train_scenes: Annotated[int, Bounds(1, 700)] = HALF_SCENES
    records: Path = Path("docs/results/transfer")


def transfer(config: TransferConfig) -> list[str]:
    """Do what is left to do; returns the names of runs that failed."""
    failed: list[str] = []
    home = Place(config.folder, config.records / _AT_HOME, "transfer")
    away = Place(config.folder, config.records, "transfer")
    if not config.tables_only:
        workers = len(os.sched_getaffinity(0))
        sizes = config.train_scenes, config.val_scenes
        make_data(home.world, *sizes, workers, sweeps="keyframes")
        other = config.folder / "lyft"
        make_world(
            MakeWorldConfig(
                out=other,
                train_scenes=0,
                val_scenes=config.val_scenes,
                image_scale=0.11,
                scenes_per_town=2,
                tail_s=5.0,
                rig="lyft",
                workers=workers,
            )
        )
        failed = run_all(RUNS, home, SEGMENTATIONS, config.jobs, config.flags)
        for run in RUNS:
            if is_trained(home.run(run)) and not away.record(run).exists():
                logger.info(f"{run.name}: asked with the other rig")
                save_record(ask(home.run(run), other, run.planner, run.seed), away.record(run))
    tables = all_tables(config.records)
    fill_pages(config.pages, {name: text or _NOTHING for name, text in tables.items()})
    return failed


def ask(folder: Path, root: Path, method: str, seed: int) -> Record:
    """What a run scores on other cameras of the names it knows."""
    run = open_segmenter(folder, root=str(root))
    report = score_segmentation(run, run.task.load_split(run.config.data, "val"), "val")
    return {"name": f"{method}-{seed}", "method": method, "seed": seed, **report.to_json()}


def all_tables(folder: Path) -> dict[str, str]:
    """The tables, by the names of their markers, from the records in a folder."""
    away, home = load_records(folder), load_records(folder / _AT_HOME)
    rows = []
    for method, label in CAMERAS.items():
        there = [record for record in away if record["method"] == method]
        here = [record for record in home if record["method"] == method]
        if there:
            cells = [
                spread(runs, lambda r, c=c: r["classes"][c]["iou"], "iou") if runs else "-"  # type: ignore[misc]
                for c in _CLASSES
                for runs in (here, there)
            ]
            paper = [f"{value:.2f}" for value in _PAPER.get(method, {}).values()] or ["", ""]
            rows.append([f"**{label}**" if method == OURS else label, *cells, *paper])
    header = [
        "method", "car: own rig", "car: Lyft's", "vehicle: own rig", "vehicle: Lyft's",
        "paper, Lyft's: car", "vehicle",
    ]  # fmt: skip
    return {
        "transfer-setting": budget_of(home),
        "transfer-table4": markdown(header, rows) if rows else "",
        "transfer-paired": _paired(folder, away),
    }


def _paired(folder: Path, away: Sequence[Record]) -> str:
    """What ours has over the others with the other rig."""
    seen = {record["method"]: load_overlaps(folder / f"{record['name']}.json") for record in away}
    rows = []
    for method, label in CAMERAS.items():
        if method != OURS and {method, OURS} <= seen.keys():
            found = paired_iou([seen[OURS]], [seen[method]])
            rows.append(
                [label, *(value_cell(asdict(found[c]), "iou", sign=True) for c in _CLASSES)]
            )
    return markdown(["with Lyft's rig, Lift-Splat minus", *_CLASSES], rows) if rows else ""


if __name__ == "__main__":
    run_script(lambda: transfer(tyro.cli(TransferConfig, description=__doc__)))
