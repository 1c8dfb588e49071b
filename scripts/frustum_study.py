"""Where should features be put: at their cells' centres, or where the network looks?

    python scripts/frustum_study.py [FOLDER] [--jobs 2]

Trains the camera planner of table6.py with both, three seeds each, and writes the tables of
docs/results/features.md and docs/results.md; hours in all. Run again, it goes on where it was. Each
finished run leaves a record in docs/results/frustum/, and the tables are made from these alone.
"""

import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro
from marked_page import fill_pages
from planning_table.cells import PAIRED, markdown, model_spread, paired, value_cell
from planning_table.experiments import MAIN_METRICS, SEEDS
from planning_table.work import prepare, run_all
from run_queue import Experiment, Place, Record, load_records, run_script

from lss_core.bounds import Bounds, Workers, check_settings
from shoot.cli.fit_templates import NumTemplates

_WAYS = ("cell", "sampled")
RUNS = tuple(
    Experiment(way, "small", seed, ("--model.frustum", way)) for seed in SEEDS for way in _WAYS
)


@dataclass(frozen=True)
class StudyConfig:
    """What to run, and where.

    Attributes:
        folder: For data set, templates and runs; 10 GB.
        jobs: Runs side by side; each gets its share of the cores.
        records: Folder of the records.
        pages: Folder of README.md and docs/, where the tables stand between markers.
        table_only: Make the tables from the records and end.
        train_scenes: Scenes to train on.
        val_scenes: Scenes to evaluate on.
        k: Number of templates.
        flags: More arguments of shoot-train, for trials.
    """

    folder: Annotated[Path, tyro.conf.Positional] = Path("runs/frustum")
    jobs: Workers = 2
    records: Path = Path("docs/results/frustum")
    pages: Path = Path()
    table_only: bool = False
    train_scenes: Annotated[int, Bounds(1, 700)] = 700
    val_scenes: Annotated[int, Bounds(1, 150)] = 100
    k: NumTemplates = 1000
    flags: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        check_settings(self)


def study(config: StudyConfig) -> list[str]:
    """Do what is left to do; returns the names of runs that failed."""
    failed: list[str] = []
    if not config.table_only:
        place = Place(config.folder, config.records)
        workers = len(os.sched_getaffinity(0))
        prepare(place, config.train_scenes, config.val_scenes, config.k, workers, "keyframes")
        failed = run_all(RUNS, place, config.jobs, config.flags)
    fill_pages(config.pages, tables(load_records(config.records)))
    return failed


def tables(records: Sequence[Record]) -> dict[str, str]:
    """Both ways and their difference, once alone and once beside baselines."""
    ways = _ways(records)
    if not ways:
        return dict.fromkeys(("frustum", "frustum-short"), "No run is finished yet.")
    baselines = []
    for name in ("prior", "blind", "past_motion"):
        beside = records[0]["methods"][name]
        cells = (value_cell(beside[m], m) for m in MAIN_METRICS)
        baselines.append([name.replace("_", " "), *cells])
    one = records[0]
    setting = (
        f"{one['num_samples']} validation samples, {one['num_scenes']} scenes; {one['steps']} "
        f"steps of {one['batch_size']} samples, {one['precision']}, on {one['processor']}."
    )
    header = ["frustum: seeds", *MAIN_METRICS.values()]
    return {
        "frustum": f"{setting}\n\n{markdown(header, ways + baselines)}",
        "frustum-short": markdown(header, ways),
    }


def _ways(records: Sequence[Record]) -> list[list[str]]:
    """A row for each way, and for their difference where both have the same seeds."""
    by_way = {way: [r for r in records if r["planner"] == way] for way in _WAYS}
    rows = []
    for way, own in by_way.items():
        if own:
            seeds = ", ".join(str(record["seed"]) for record in own)
            rows.append([f"`{way}`: {seeds}", *(model_spread(own, m) for m in MAIN_METRICS)])
    both = [
        [r for r in by_way[way] if r["seed"] in {other["seed"] for other in by_way[than]}]
        for way, than in (_WAYS, _WAYS[::-1])
    ]
    if both[0]:
        less = [paired(both[1], both[0], m) if m in PAIRED else "" for m in MAIN_METRICS]
        rows.append(["`sampled` minus `cell`", *less])
    return rows


if __name__ == "__main__":
    run_script(lambda: study(tyro.cli(StudyConfig, description=__doc__)))
