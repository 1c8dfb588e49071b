"""A queue of runs: what is done leaves a record, what was begun goes on, what fails is named."""

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
from typing import Annotated, Any, NoReturn

import tyro
from benchmarks.machine import processor_name

from lss_core.bounds import Bounds, Workers, check_settings
from lss_core.files import write_atomically

logger = logging.getLogger(__name__)

Record = dict[str, Any]

_STATUS_S = 60.0


@dataclass(frozen=True)
class Experiment:
    """One training run.

    Attributes:
        planner: Name in the tables; runs that differ in the seed only share it.
        preset: Of shoot-train.
        seed: Of training.
        flags: What else shoot-train is told.
    """

    planner: str
    preset: str
    seed: int
    flags: tuple[str, ...] = ()

    @property
    def name(self) -> str:
        """Of its run folder and of its record."""
        return f"{self.planner}-{self.seed}"


@dataclass(frozen=True)
class Place:
    """Where everything is.

    Attributes:
        folder: World, and what else all runs need.
        records: What finished runs leave behind.
        group: Folder of the runs inside it.
    """

    folder: Path
    records: Path
    group: str = ""

    @property
    def world(self) -> Path:
        """The data set."""
        return self.folder / "world"

    def run(self, experiment: Experiment) -> Path:
        """The run's folder."""
        return self.folder / self.group / experiment.name

    def record(self, experiment: Experiment) -> Path:
        """The record of a run."""
        return self.records / f"{experiment.name}.json"


@dataclass(frozen=True)
class Kind:
    """What a queue must be told of its runs.

    Attributes:
        train_flags: More arguments of shoot-train, by where everything is.
        evaluate_flags: More arguments of shoot-evaluate, by the run's folder.
        record_of: What is worth keeping of a finished run: of it, in its folder, with so many side
            by side.
        told: What to say of a record, in a few words.
    """

    train_flags: Callable[[Place], Sequence[str]]
    evaluate_flags: Callable[[Path], Sequence[str]]
    record_of: Callable[[Experiment, Path, int], Record]
    told: Callable[[Record], str]


@dataclass(frozen=True)
class QueueConfig:
    """Where a queue of runs works, and how large its data set is.

    Attributes:
        folder: For data set and runs.
        jobs: Runs side by side; each gets its share of the cores.
        pages: Folder of README.md and docs/, where the tables stand between markers.
        tables_only: Make the tables from the records and end.
        train_scenes: Scenes to train on.
        val_scenes: Scenes to evaluate on.
        flags: More arguments of shoot-train, for trials.
    """

    folder: Annotated[Path, tyro.conf.Positional] = Path("runs/table6")
    jobs: Workers = 2
    pages: Path = Path()
    tables_only: bool = False
    train_scenes: Annotated[int, Bounds(1, 700)] = 700
    val_scenes: Annotated[int, Bounds(1, 150)] = 100
    flags: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        check_settings(self)


def choose(experiments: Sequence[Experiment], only: Sequence[str]) -> list[Experiment]:
    """Those of some planners (or methods) or of some names; all if none is asked for.

    Raises:
        SystemExit: If there are no such.
    """
    chosen = [e for e in experiments if not only or e.planner in only or e.name in only]
    if not chosen:
        raise SystemExit(
            f"No run is called {', '.join(only)}; there are "
            f"{', '.join(e.name for e in experiments)}."
        )
    return chosen


def facts_of(experiment: Experiment, folder: Path, root: str, jobs: int) -> Record:
    """What is kept of every finished run: what it was told, where it ran, and how long it took.

    Args:
        experiment: The run.
        folder: Its folder.
        root: Of its data set, which has a card.
        jobs: How many ran side by side.
    """
    return {
        "preset": experiment.preset,
        "seed": experiment.seed,
        "flags": list(experiment.flags),
        "train_s": read_json(folder / "training_time.json")["train_s"],
        "evaluate_s": read_json(folder / "evaluation_time.json")["evaluate_s"],
        "runs_side_by_side": jobs,
        "processor": processor_name(),
        "environment": read_json(folder / "environment.json"),
        "world": read_json(Path(root) / "world.json"),
    }


def budget_of(trained: Sequence[Record]) -> str:
    """What runs had that are alike in it, in words; nothing of no runs."""
    if not trained:
        return ""
    one = trained[0]
    minutes = sum(record["train_s"] for record in trained) / len(trained) / 60.0
    where = "; ".join(sorted({f"{r['processor']} ({r['precision']})" for r in trained}))
    return (
        f"{one['world']['train_scenes']} training scenes, {one['num_scenes']} validation scenes; "
        f"{one['steps']} steps of {one['batch_size']} samples; {minutes:.0f} minutes of training a "
        f"run, {one['runs_side_by_side']} side by side on {where}."
    )


def is_trained(folder: Path) -> bool:
    """Whether a run has come to its last step: one that was ended from outside has not."""
    return (folder / "training_time.json").exists()


def run_all(
    experiments: Sequence[Experiment],
    place: Place,
    kind: Kind,
    jobs: int,
    flags: Sequence[str] = (),
) -> list[str]:
    """Train and evaluate what has no record yet; returns the names of runs that failed.

    Args:
        experiments: The runs.
        place: Where they are.
        kind: What their commands are told, and what is kept of them.
        jobs: Runs side by side.
        flags: More arguments of shoot-train, for all of them.

    What ends it, as Ctrl-C, ends the runs under way too, each after its step; next time they go on.
    """
    waiting = [e for e in experiments if not place.record(e).exists()]
    logger.info(f"{len(experiments) - len(waiting)} of {len(experiments)} runs are done.")
    queue = _Queue(place, kind, jobs, flags)
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

    def __init__(self, place: Place, kind: Kind, jobs: int, flags: Sequence[str]) -> None:
        self._place, self._kind, self._jobs, self._flags = place, kind, jobs, flags
        self._under_way: set[subprocess.Popen[bytes]] = set()

    def run(self, experiment: Experiment) -> bool:
        """Train and evaluate, as far as that is left to do; whether it went well."""
        place = self._place
        folder = place.run(experiment)
        folder.mkdir(parents=True, exist_ok=True)
        evaluated_in = folder / "evaluation_time.json"
        if not is_trained(folder):
            logger.info(f"{experiment.name}: training")
            train = [
                "train", experiment.preset, "--data.root", str(place.world),
                *self._kind.train_flags(place), "--out", str(folder),
                "--seed", str(experiment.seed), "--resume", *experiment.flags, *self._flags,
            ]  # fmt: skip
            if not self._call(train, folder) or not is_trained(folder):
                return False
        if not evaluated_in.exists():
            logger.info(f"{experiment.name}: evaluation")
            started = time.monotonic()
            report = str(folder / "report.json")
            more = self._kind.evaluate_flags(folder)
            if not self._call(["evaluate", str(folder), "--out", report, *more], folder):
                return False
            with write_atomically(evaluated_in) as stream:
                stream.write(json.dumps({"evaluate_s": time.monotonic() - started}).encode())
        record = self._kind.record_of(experiment, folder, self._jobs)
        save_record(record, place.record(experiment))
        logger.info(f"{experiment.name}: {self._kind.told(record)}")
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


def save_record(record: Record, path: Path) -> None:
    """Write a record, a line for each of its fields.

    Numbers get four digits: more is noise, and the files are under git.
    """
    fields = (f"{json.dumps(key)}: {json.dumps(_rounded(value))}" for key, value in record.items())
    with write_atomically(path) as stream:
        stream.write(("{\n" + ",\n".join(fields) + "\n}\n").encode())


def load_records(folder: Path) -> list[Record]:
    """All records of a folder, by name."""
    return [read_json(path) for path in sorted(folder.glob("*.json"))]


def _rounded(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _rounded(item) for key, item in value.items()}
    if isinstance(value, list):
        return [_rounded(item) for item in value]
    return float(f"{value:.4g}") if isinstance(value, float) else value


def read_json(path: Path) -> Record:
    """A JSON object from a file."""
    loaded: Record = json.loads(path.read_text(encoding="utf-8"))
    return loaded
