"""Another rig: segmentations of nuScenes' cameras, asked with Lyft's (the paper's Table 4).

    python scripts/transfer.py [FOLDER]

Makes the validation towns once more, as a car with the cameras of Lyft Level 5 sees them, asks each
segmentation that segmentation_tables.py has trained in the same folder, and writes the table of
docs/results/transfer.md. Run again, it goes on where it was. Records go to docs/results/transfer/,
and the table is made from these alone.
"""

import logging
import os
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro
from marked_page import fill_pages
from planning_table.cells import markdown, spread
from run_queue import Place, Record, is_trained, load_records, run_script, save_record
from segmentation_table.experiments import ALL, CAMERAS, OURS

from lss_core.bounds import Bounds, Workers, check_settings
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
_NOTHING = "No run of these is finished yet."


@dataclass(frozen=True)
class TransferConfig:
    """What to run, and where.

    Attributes:
        folder: That of segmentation_tables.py; the other rig's towns go there, too, 2 GB.
        workers: Processes that make them; one a core if 0.
        records: Folder of the records.
        at_home: Folder of the records of segmentation_tables.py.
        pages: Folder of README.md and docs/, where the table stands between markers.
        tables_only: Make the table from the records and end.
        val_scenes: Scenes to ask about.
    """

    folder: Annotated[Path, tyro.conf.Positional] = Path("runs/table6")
    workers: Annotated[int, Bounds(0, 65_536)] = 0
    records: Path = Path("docs/results/transfer")
    at_home: Path = Path("docs/results/segmentation")
    pages: Path = Path()
    tables_only: bool = False
    val_scenes: Annotated[int, Bounds(1, 150)] = 100

    def __post_init__(self) -> None:
        check_settings(self)


def transfer(config: TransferConfig) -> list[str]:
    """Do what is left to do; returns the names of runs that are not trained yet."""
    waiting: list[str] = []
    if not config.tables_only:
        other = config.folder / "lyft"
        workers: Workers = config.workers or len(os.sched_getaffinity(0))
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
        place = Place(config.folder, config.records, "segmentation")
        for run in ALL:
            if run.planner in CAMERAS and not place.record(run).exists():
                if not is_trained(place.run(run)):
                    waiting.append(run.name)
                    continue
                logger.info(f"{run.name}: asked with the other rig")
                save_record(ask(place.run(run), other, run.planner, run.seed), place.record(run))
    tables = all_tables(load_records(config.records), load_records(config.at_home))
    fill_pages(config.pages, {name: text or _NOTHING for name, text in tables.items()})
    return waiting


def ask(folder: Path, root: Path, method: str, seed: int) -> Record:
    """What a run scores on other cameras of the names it knows."""
    run = open_segmenter(folder, root=str(root))
    report = score_segmentation(run, run.task.load_split(run.config.data, "val"), "val")
    return {"name": f"{method}-{seed}", "method": method, "seed": seed, **report.to_json()}


def all_tables(away: list[Record], at_home: list[Record]) -> dict[str, str]:
    """The table, by the name of its markers."""
    rows = []
    for method, label in CAMERAS.items():
        there = [record for record in away if record["method"] == method]
        here = [record for record in at_home if record["method"] == method]
        if there:
            cells = [
                spread(runs, lambda r, c=c: r["classes"][c]["iou"], "iou") if runs else "-"  # type: ignore[misc]
                for c in ("car", "vehicle")
                for runs in (here, there)
            ]
            paper = [f"{value:.2f}" for value in _PAPER.get(method, {}).values()] or ["", ""]
            rows.append([f"**{label}**" if method == OURS else label, *cells, *paper])
    header = [
        "method", "car: own rig", "car: Lyft's", "vehicle: own rig", "vehicle: Lyft's",
        "paper, Lyft's: car", "vehicle",
    ]  # fmt: skip
    return {"transfer-table4": markdown(header, rows) if rows else ""}


if __name__ == "__main__":
    run_script(lambda: transfer(tyro.cli(TransferConfig, description=__doc__)))
