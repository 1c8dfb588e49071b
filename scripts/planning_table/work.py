"""The queue of runs: what is done leaves a record, what was begun goes on, what fails is named."""

import json
import logging
import os
import subprocess
import sys
import time
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

from lss_core.data.splits import official_scenes
from lss_core.files import write_atomically
from planning_table.experiments import HALF, Experiment
from planning_table.records import record_of, save_record
from shoot.cli.fit_templates import DataSource, FitTemplatesConfig, fit
from shoot.world.writer import VERSION, MakeWorldConfig, make_world

logger = logging.getLogger(__name__)

_STATUS_S = 60.0


@dataclass(frozen=True)
class Place:
    """Where everything is.

    Attributes:
        folder: World, templates and runs.
        records: What finished runs leave behind.
    """

    folder: Path
    records: Path

    @property
    def world(self) -> Path:
        """The data set."""
        return self.folder / "world"

    @property
    def templates(self) -> Path:
        """The template file."""
        return self.folder / "templates.npz"

    def record(self, experiment: Experiment) -> Path:
        """The record of a run."""
        return self.records / f"{experiment.name}.json"


def prepare(place: Place, train_scenes: int, val_scenes: int, k: int, workers: int) -> None:
    """Make the data set, its splits and the templates, unless they are there."""
    make_world(
        MakeWorldConfig(
            out=place.world,
            train_scenes=train_scenes,
            val_scenes=val_scenes,
            image_scale=0.11,
            scenes_per_town=2,
            tail_s=5.0,
            sweeps="all",
            lidar_azimuths=128,
            workers=workers,
        )
    )
    train = official_scenes(VERSION, "train")[:train_scenes]
    splits = {
        "train": train,
        "val": official_scenes(VERSION, "val")[:val_scenes],
        HALF: train[: -(-train_scenes // 2)],
    }
    with write_atomically(place.world / VERSION / "splits.json") as stream:
        stream.write(json.dumps(splits).encode())
    if not place.templates.exists():
        fit(FitTemplatesConfig(DataSource(str(place.world), VERSION), str(place.templates), k=k))


def run_all(
    experiments: Sequence[Experiment], place: Place, jobs: int, flags: Sequence[str] = ()
) -> list[str]:
    """Train and evaluate what has no record yet; returns the names of runs that failed."""
    waiting = [e for e in experiments if not place.record(e).exists()]
    logger.info(f"{len(experiments) - len(waiting)} of {len(experiments)} runs are done.")
    with ThreadPoolExecutor(jobs) as pool:
        results = pool.map(lambda e: (e.name, _run(e, place, jobs, flags)), waiting)
        return [name for name, is_done in results if not is_done]


def _run(experiment: Experiment, place: Place, jobs: int, flags: Sequence[str]) -> bool:
    folder = place.folder / experiment.name
    folder.mkdir(parents=True, exist_ok=True)
    report, evaluated_in = folder / "report.json", folder / "evaluation_time.json"
    if not (folder / "training_time.json").exists():
        logger.info(f"{experiment.name}: training")
        train = [
            "train", experiment.preset, "--data.root", str(place.world),
            "--templates", str(place.templates), "--out", str(folder),
            "--seed", str(experiment.seed), "--resume", *experiment.flags, *flags,
        ]  # fmt: skip
        # Written at the last step only: a run that was ended from outside is not done.
        if not _call(train, folder, jobs) or not (folder / "training_time.json").exists():
            return False
    if not evaluated_in.exists():
        logger.info(f"{experiment.name}: evaluation")
        started = time.monotonic()
        page = str(folder / "report.html")
        if not _call(["evaluate", str(folder), "--out", str(report), "--html", page], folder, jobs):
            return False
        with write_atomically(evaluated_in) as stream:
            stream.write(json.dumps({"evaluate_s": time.monotonic() - started}).encode())
    record = record_of(experiment, folder, jobs)
    save_record(record, place.record(experiment))
    logger.info(f"{experiment.name}: top-10 {record['methods']['model']['top10']['value']:.1f} %")
    return True


def _call(command: Sequence[str], folder: Path, jobs: int) -> bool:
    """Run a console command of ours; what it says goes to the run's log, and the end of it here."""
    name, *arguments = command
    code = f"from shoot.cli.{name} import main; main()"
    threads = max(1, len(os.sched_getaffinity(0)) // jobs)
    log = folder / f"{name}.log"
    with log.open("ab") as stream:
        process = subprocess.Popen(
            [sys.executable, "-c", code, *arguments],
            stdout=stream,
            stderr=stream,
            env={**os.environ, "OMP_NUM_THREADS": str(threads)},
        )
        try:
            while True:
                try:
                    status = process.wait(timeout=_STATUS_S)
                    break
                except subprocess.TimeoutExpired:
                    logger.info(f"{folder.name}: {name}, {_progress(folder)}")
        except BaseException:
            process.terminate()
            raise
    if status:
        last = log.read_text(errors="replace").strip().splitlines()[-1:]
        logger.info(f"{folder.name}: {name} failed ({status}): {''.join(last)}; see {log}")
    return status == 0


def _progress(folder: Path) -> str:
    """The step a run has come to, from what it has logged."""
    try:
        lines = (folder / "metrics.csv").read_text().splitlines()
        return f"step {lines[-1].split(',')[lines[0].split(',').index('step')]}"
    except (OSError, ValueError, IndexError):
        return "beginning"
