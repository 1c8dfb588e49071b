"""Long work takes no more memory, open files or processes at its end than at its beginning."""

import contextlib
import csv
import io
import os
import time
from dataclasses import dataclass
from multiprocessing.process import BaseProcess
from pathlib import Path
from statistics import median, mode

import pytest
from tally import throw
from world_fixture import TinyRun, start_beside, start_command, train_flags

from shoot.cli.evaluate import EvaluateConfig, evaluate

FLAT = "no growth in memory, open files or processes"
# What loader processes hand over are files until it has arrived, some 20 at a time. One that is
# left open at each step would be 80 between the times that are compared.
FILES_ON_THE_WAY = 20
# What an allocator keeps back differs from time to time; a tenth of a kB a step would be 10 MB.
NOISE_MB = 12.0


@dataclass(frozen=True)
class Load:
    """What a process and its helpers hold at one time.

    Memory is what is theirs, not that of mapped files. What a fork shares counts with each of them:
    shares of it would change when some other test's process ends.
    """

    memory_mb: float
    files: int
    processes: int


def load_of(pid: int) -> Load:
    tree = [pid]
    for parent in tree:
        with contextlib.suppress(FileNotFoundError):
            listed = Path(f"/proc/{parent}/task/{parent}/children").read_text()
            tree += [int(child) for child in listed.split()]
    memory_kb, files = 0, 0
    for process in tree:
        # One may have ended meanwhile; what is left of it until its parent asks has no memory.
        with contextlib.suppress(OSError, IndexError):
            status = Path(f"/proc/{process}/status").read_text()
            memory_kb += int(status.partition("\nRssAnon:")[2].split()[0])
            files += len(os.listdir(f"/proc/{process}/fd"))  # noqa: PTH208
    return Load(memory_kb / 1024.0, files, len(tree))


def watch(process: BaseProcess, begun: Path, every_s: float) -> list[Load]:
    """What it holds, time and again until it ends; from the time on when a file is there."""
    assert process.pid is not None
    loads = []
    while process.is_alive():
        if begun.exists():
            with contextlib.suppress(FileNotFoundError, ProcessLookupError):
                loads.append(load_of(process.pid))
        time.sleep(every_s)
    assert process.exitcode == 0
    return loads


def check_flat(loads: list[Load], figures: dict[str, str], files_on_the_way: int = 0) -> None:
    """Compare the last quarter with the second: the first is still filling caches."""
    quarter = len(loads) // 4
    assert quarter >= 3
    early, late = loads[quarter : 2 * quarter], loads[-quarter:]
    memory_mb = [median(load.memory_mb for load in part) for part in (early, late)]
    # Files are opened and closed all the time; what is never closed is there at every moment.
    files = [min(load.files for load in part) for part in (early, late)]
    processes = [min(load.processes for load in part) for part in (early, late)]
    for name, (before, after), unit in (
        ("memory", memory_mb, " MB"),
        ("open files", files, ""),
        ("processes", processes, ""),
    ):
        figures[name] = f"{before:.0f} to {after:.0f}{unit}"
    assert memory_mb[1] - memory_mb[0] < NOISE_MB
    assert files[1] - files[0] <= files_on_the_way
    assert processes[1] <= processes[0]


@pytest.mark.parametrize(
    ("steps", "every"), [(160, 20), pytest.param(10_000, 500, marks=pytest.mark.full)]
)
def test_training(steps: int, every: int, tiny_run: TinyRun, tmp_path: Path) -> None:
    flags = train_flags(tiny_run.root, tiny_run.templates, tmp_path / "run", steps, every)
    flags += ["--num-workers", "1"]
    with throw("training steps, one run", FLAT, times=steps) as figures:
        process = start_command("shoot-train", *flags, log=tmp_path / "log")
        # After the first validation all helpers are there; at the very end they leave.
        try:
            loads = watch(process, tmp_path / "run" / "checkpoints" / "best.ckpt", every_s=0.1)
        finally:
            process.kill()
        usual = mode(load.processes for load in loads)
        steady = [load for load in loads if load.processes == usual]
        check_flat(steady, figures, FILES_ON_THE_WAY)


def evaluate_often(run: str, times: int, out: str) -> None:
    """Evaluate a run time and again in this process, and write down what it holds."""
    config = EvaluateConfig(run, out=f"{out}.json", html=None)
    with Path(out).open("w") as stream:
        rows = csv.writer(stream)
        for _ in range(times):
            with contextlib.redirect_stdout(io.StringIO()):
                evaluate(config)
            load = load_of(os.getpid())
            rows.writerow([load.memory_mb, load.files, load.processes])


@pytest.mark.parametrize("times", [12, pytest.param(2_000, marks=pytest.mark.full)])
def test_evaluations(times: int, tiny_run: TinyRun, tmp_path: Path) -> None:
    with throw("evaluations, in one process", FLAT, times=times) as figures:
        process = start_beside(
            evaluate_often,
            str(tiny_run.folder),
            times,
            str(tmp_path / "loads"),
            log=tmp_path / "log",
        )
        process.join()
        assert process.exitcode == 0, (tmp_path / "log").read_text()
        with (tmp_path / "loads").open() as stream:
            loads = [Load(float(m), int(f), int(p)) for m, f, p in csv.reader(stream)]
        assert len(loads) == times
        check_flat(loads, figures)
