"""The queue of runs: what is done leaves a record, what was begun goes on, what fails is named."""

import json
import logging
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, NoReturn

from lss_core.data.splits import official_scenes
from lss_core.files import write_atomically
from planning_table.experiments import HALF, Experiment
from planning_table.records import record_of, save_record
from shoot.cli.fit_templates import DataSource, FitTemplatesConfig, fit
from shoot.world.config import VERSION, MakeWorldConfig
from shoot.world.writer import make_world

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


def prepare(
    place: Place,
    train_scenes: int,
    val_scenes: int,
    k: int,
    workers: int,
    sweeps: Literal["keyframes", "all"] = "all",
) -> None:
    """Make the data set, its splits and the templates, unless they are there.

    Args:
        place: Where to.
        train_scenes: Scenes to train on.
        val_scenes: Scenes to evaluate on.
        k: Number of templates.
        workers: Processes.
        sweeps: Which sweeps get files; planners that read several scans need all.
    """
    make_world(
        MakeWorldConfig(
            out=place.world,
            train_scenes=train_scenes,
            val_scenes=val_scenes,
            image_scale=0.11,
            scenes_per_town=2,
            tail_s=5.0,
            sweeps=sweeps,
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
    """Train and evaluate what has no record yet; returns the names of runs that failed.

    What ends it, as Ctrl-C, ends the runs under way too, each after its step; next time they go on.
    """
    waiting = [e for e in experiments if not place.record(e).exists()]
    logger.info(f"{len(experiments) - len(waiting)} of {len(experiments)} runs are done.")
    queue = _Queue(place, jobs, flags)
    with ThreadPoolExecutor(jobs) as pool:
        results = pool.map(queue.run, waiting)
        try:
            return [e.name for e, is_done in zip(waiting, results, strict=True) if not is_done]
        except BaseException:
            pool.shutdown(wait=False, cancel_futures=True)
            queue.terminate()
            raise


def run_script(do: Callable[[], list[str]]) -> NoReturn:
    """Run a queue as a script, which ends well only if no run failed, and orderly on a signal."""
    logging.basicConfig(level=logging.INFO, format="%(asctime)s %(message)s", datefmt="%H:%M:%S")
    for number in (signal.SIGTERM, signal.SIGHUP):
        if signal.getsignal(number) != signal.SIG_IGN:
            signal.signal(number, lambda number, _: sys.exit(128 + number))
    failed = do()
    sys.exit(f"These runs failed: {', '.join(failed)}." if failed else 0)


class _Queue:
    """Does runs, each in processes of its own."""

    def __init__(self, place: Place, jobs: int, flags: Sequence[str]) -> None:
        self._place, self._jobs, self._flags = place, jobs, flags
        self._under_way: set[subprocess.Popen[bytes]] = set()

    def run(self, experiment: Experiment) -> bool:
        """Train and evaluate, as far as that is left to do; whether it went well."""
        place = self._place
        folder = place.folder / experiment.name
        folder.mkdir(parents=True, exist_ok=True)
        trained_in, evaluated_in = folder / "training_time.json", folder / "evaluation_time.json"
        if not trained_in.exists():
            logger.info(f"{experiment.name}: training")
            train = [
                "train", experiment.preset, "--data.root", str(place.world),
                "--templates", str(place.templates), "--out", str(folder),
                "--seed", str(experiment.seed), "--resume", *experiment.flags, *self._flags,
            ]  # fmt: skip
            # Written at the last step only: a run that was ended from outside is not done.
            if not self._call(train, folder) or not trained_in.exists():
                return False
        if not evaluated_in.exists():
            logger.info(f"{experiment.name}: evaluation")
            started = time.monotonic()
            report, page = str(folder / "report.json"), str(folder / "report.html")
            if not self._call(["evaluate", str(folder), "--out", report, "--html", page], folder):
                return False
            with write_atomically(evaluated_in) as stream:
                stream.write(json.dumps({"evaluate_s": time.monotonic() - started}).encode())
        record = record_of(experiment, folder, self._jobs)
        save_record(record, place.record(experiment))
        top10 = record["methods"]["model"]["top10"]["value"]
        logger.info(f"{experiment.name}: top-10 {top10:.1f} %")
        return True

    def terminate(self) -> None:
        """Ask what is under way to end."""
        for process in list(self._under_way):
            process.terminate()

    def _call(self, command: Sequence[str], folder: Path) -> bool:
        """Run a console command of ours; what it says goes to the run's log, the end of it here."""
        name, *arguments = command
        code = f"from shoot.cli.{name} import main; main()"
        threads = max(1, len(os.sched_getaffinity(0)) // self._jobs)
        log = folder / f"{name}.log"
        with log.open("ab") as stream:
            process = subprocess.Popen(
                [sys.executable, "-c", code, *arguments],
                stdout=stream,
                stderr=stream,
                env={**os.environ, "OMP_NUM_THREADS": str(threads)},
                start_new_session=True,  # else Ctrl-C reaches it twice: the second ends at once
            )
            self._under_way.add(process)
            while (status := _wait(process)) is None:
                logger.info(f"{folder.name}: {name}, {_progress(folder)}")
            self._under_way.remove(process)
        if status:
            last = log.read_text(errors="replace").strip().splitlines()[-1:]
            logger.info(f"{folder.name}: {name} failed ({status}): {''.join(last)}; see {log}")
        return status == 0


def _wait(process: "subprocess.Popen[bytes]") -> int | None:
    """Its exit status; None if it goes on for long."""
    try:
        return process.wait(timeout=_STATUS_S)
    except subprocess.TimeoutExpired:
        return None


def _progress(folder: Path) -> str:
    """The step a run has come to, from what it has logged."""
    try:
        lines = (folder / "metrics.csv").read_text().splitlines()
        return f"step {lines[-1].split(',')[lines[0].split(',').index('step')]}"
    except (OSError, ValueError, IndexError):
        return "beginning"
