"""Another rig: segmentations of nuScenes' cameras, asked with Lyft's (the paper's Table 4).

    python scripts/transfer.py [FOLDER] [--jobs 2]

Makes the validation towns once more, as a car with the cameras of Lyft Level 5 sees them, asks the
runs of segmentation_tables.py there, which it trains if they are not, and writes the tables of
docs/results/transfer.md. Run again, it goes on where it was. Records go to docs/results/transfer/,
and the tables are made from these and from those of segmentation_tables.py alone.
"""

import logging
import os
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro
from data_set import HALF_SCENES, make_data
from marked_page import fill_pages
from planning_table.cells import markdown, spread
from run_queue import (
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
from segmentation_table.experiments import ALL, CAMERAS, OURS
from segmentation_table.page import paired_rows
from segmentation_table.records import SEGMENTATIONS

from lss_core.bounds import Bounds
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
_NOTHING = "No run of these is finished yet."
# Those of the paper, and ours without learned depth.
_METHODS = (OURS, "cnn", "frozen", "oft", "uniform")
RUNS = tuple(run for run in ALL if run.planner in _METHODS)


@dataclass(frozen=True)
class TransferConfig(QueueConfig):
    """What to run, and where.

    Attributes:
        folder: For data sets of both rigs, and runs; that of segmentation_tables.py has all but the
            other rig's.
        train_scenes: Scenes to train on.
        records: Folder of the records.
        home: Folder of the records of segmentation_tables.py.
    """

    folder: Annotated[Path, tyro.conf.Positional] = Path("runs/half")
    train_scenes: Annotated[int, Bounds(1, 700)] = HALF_SCENES
    records: Path = Path("docs/results/transfer")
    home: Path = Path("docs/results/segmentation")


def transfer(config: TransferConfig) -> list[str]:
    """Do what is left to do; returns the names of runs that failed."""
    failed: list[str] = []
    home = Place(config.folder, config.home, "segmentation")
    away = Place(config.folder, config.records, "segmentation")
    if not config.tables_only:
        workers = len(os.sched_getaffinity(0))
        sizes = config.train_scenes, config.val_scenes
        make_data(home.world, *sizes, workers)
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
    tables = all_tables(config.records, config.home)
    fill_pages(config.pages, {name: text or _NOTHING for name, text in tables.items()})
    return failed


def ask(folder: Path, root: Path, method: str, seed: int) -> Record:
    """What a run scores on other cameras of the names it knows."""
    run = open_segmenter(folder, root=str(root))
    report = score_segmentation(run, run.task.load_split(run.config.data, "val"), "val")
    return {"name": f"{method}-{seed}", "method": method, "seed": seed, **report.to_json()}


def all_tables(folder: Path, at_home: Path) -> dict[str, str]:
    """The tables, by the names of their markers, from records with the other rig and at home."""
    away = load_records(folder)
    asked = {record["name"] for record in away}
    home = [record for record in load_records(at_home) if record["name"] in asked]
    of_method = {method: [r for r in away if r["method"] == method] for method in CAMERAS}
    runs = {method: own for method, own in of_method.items() if own}
    rows = []
    for method, there in runs.items():
        here = [record for record in home if record["method"] == method]
        cells = [
            spread(own, lambda r, c=c: r["classes"][c]["iou"], "iou") if own else "-"  # type: ignore[misc]
            for c in _CLASSES
            for own in (here, there)
        ]
        paper = [f"{value:.2f}" for value in _PAPER.get(method, {}).values()] or ["", ""]
        label = CAMERAS[method]
        rows.append([f"**{label}**" if method == OURS else label, *cells, *paper])
    header = [
        "method", "car: own rig", "car: Lyft's", "vehicle: own rig", "vehicle: Lyft's",
        "paper, Lyft's: car", "vehicle",
    ]  # fmt: skip
    paired = paired_rows(runs, folder, _CLASSES)
    return {
        "transfer-setting": budget_of(home),
        "transfer-table4": markdown(header, rows) if rows else "",
        "transfer-paired": markdown(["with Lyft's rig, Lift-Splat minus", *_CLASSES], paired)
        if paired
        else "",
    }


if __name__ == "__main__":
    run_script(lambda: transfer(tyro.cli(TransferConfig, description=__doc__)))
