"""The closed-loop study: every planner of docs/results.md and simple drivers, on the same routes.

    python scripts/closed_loop.py [FOLDER] [--only camera rule] [--mode reactive]

Drives the runs that `python scripts/table6.py` has trained in the same folder, and who needs none;
hours in all. The first camera planner is the shipped one, where the folder has no other. Run again,
it goes on where it was. Records go to docs/results/closed_loop/, and the tables of
docs/results/closed_loop.md are made from these alone. Filmstrips are of the first camera planner,
one for each way to fail.
"""

import logging
import shutil
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro
from driving_table.drives import MODES, STUDY, Drive
from driving_table.failings import FAILINGS
from driving_table.page import write_tables
from driving_table.records import record_of
from planning_table.experiments import TABLE
from run_queue import (
    Experiment,
    Place,
    Record,
    is_trained,
    load_records,
    read_json,
    run_script,
)

from lss_core.bounds import Bounds, Workers, check_settings
from shoot.cli.simulate import SimulateConfig, simulate
from shoot.simulation.route_log import Mode
from shoot.simulation.routes.result_files import read_object, route_file, strip_file, write_row
from shoot.templates import TemplateSet

logger = logging.getLogger(__name__)

_FILMED = "camera-0-reactive"
# The planner that ship_planner.py made of a run of frustum_study.py, and that run's record: trained
# as the first of Table 6, on the same data.
_SHIPPED = Path("templates/synthetic-1000")
_RECORD_OF_SHIPPED = Path("docs/results/frustum/sampled-0.json")


@dataclass(frozen=True)
class StudyConfig:
    """What to drive, and where.

    Attributes:
        folder: That of table6.py, with its runs; results go to `driven` in it.
        only: Drivers, planners or runs, as `rule`, `camera` or `lidar10-2`; all if not given.
        mode: Traffic; both if not given.
        routes: How many routes each drives.
        duration_s: Length of a route.
        workers: Processes.
        records: Folder of the records.
        pages: Folder of README.md and docs/, where the tables stand between markers.
        tables_only: Make the tables from the records and end.
    """

    folder: Annotated[Path, tyro.conf.Positional] = Path("runs/table6")
    only: tuple[str, ...] = ()
    mode: tuple[Mode, ...] = MODES
    routes: Annotated[int, Bounds(2, 10_000)] = 100
    duration_s: Annotated[float, Bounds(4.0, 60.0)] = 20.0
    workers: Workers = 2
    records: Path = Path("docs/results/closed_loop")
    pages: Path = Path()
    tables_only: bool = False

    def __post_init__(self) -> None:
        check_settings(self)


def closed_loop(config: StudyConfig) -> list[str]:
    """Do what is left to do; returns the names of drives whose run is missing."""
    missing: list[str] = []
    chosen = [drive for drive in STUDY if not config.only or _is_asked(drive, config.only)]
    if not chosen:
        sys.exit(f"Nobody is called {', '.join(config.only)}.")
    for drive in () if config.tables_only else chosen:
        if drive.run is not None and _folder_of(drive.run, config) is None:
            logger.info(f"{drive.name}: {drive.run.name} is not trained; run scripts/table6.py")
            missing.append(drive.name)
            continue
        for mode in config.mode:
            _drive_once(drive, mode, config)
    records = load_records(config.records)
    write_tables(records, config.pages)
    for record in records:
        if record["name"] == _FILMED:
            _copy_strips(record, config)
    return missing


def _is_asked(drive: Drive, only: tuple[str, ...]) -> bool:
    return drive.name in only or drive.who in only


def _folder_of(run: Experiment, config: StudyConfig) -> Path | None:
    """Where the run is; nowhere if it is not trained yet."""
    folder = Place(config.folder, config.records).run(run)
    if is_trained(folder):
        return folder
    return _SHIPPED if run == TABLE[0] else None


def _report_of(folder: Path) -> Record:
    return read_json(_RECORD_OF_SHIPPED if folder == _SHIPPED else folder / "report.json")


def _drive_once(drive: Drive, mode: Mode, config: StudyConfig) -> None:
    """Drive what is left of it and leave a record, unless there is one."""
    name = f"{drive.name}-{mode}"
    file = config.records / f"{name}.json"
    if file.exists():
        return
    logger.info(f"{name}: {config.routes} routes")
    folder = _driven(config, name)
    run = None if drive.run is None else _folder_of(drive.run, config)
    simulate(SimulateConfig(
        run=None if run is None else str(run),
        out=folder,
        driver=drive.driver,
        routes=config.routes,
        mode=mode,
        workers=config.workers,
        choose=drive.choose,
        route_gate=drive.route_gate,
        duration_s=config.duration_s,
    ))  # fmt: skip
    rows = [read_object(route_file(folder, route)) for route in range(config.routes)]
    templates = None if run is None else TemplateSet.load(run / "templates.npz")
    report = _report_of(run) if run is not None and drive.driver == "run" else None
    config.records.mkdir(parents=True, exist_ok=True)
    write_row(file, record_of(drive, mode, folder, rows, templates, report))


def _driven(config: StudyConfig, name: str) -> Path:
    return config.folder / "driven" / name


def _copy_strips(record: Record, config: StudyConfig) -> None:
    """Put the clearest route of each failing on the page, where it was filmed here."""
    for name, clear in record["failings"].items():
        worst = max(range(len(clear)), key=lambda route: clear[route] or 0.0)
        strip = strip_file(_driven(config, record["name"]), worst)
        if strip.exists() and (clear[worst] or 0.0) >= FAILINGS[name].bound:
            picture = f"closed_loop_{name.replace(' ', '_')}.jpg"
            shutil.copyfile(strip, config.pages / "docs" / "images" / picture)


if __name__ == "__main__":
    run_script(lambda: closed_loop(tyro.cli(StudyConfig, description=__doc__)))
