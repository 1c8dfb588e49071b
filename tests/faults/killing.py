"""Commands that are killed and called again, and what must hold after each kill and at the end."""

import io
import json
import os
import re
import resource
import shutil
import signal
import sys
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack
from dataclasses import dataclass
from multiprocessing.process import BaseProcess
from pathlib import Path
from typing import Any, Literal

import tally
import torch
from resumption import assert_same_run
from tensorboard.backend.event_processing.event_accumulator import EventAccumulator
from world_fixture import Said, call_command, start_beside

from lss_core.files import sole_writer

Point = Literal["in a write", "before fsync", "before replace", "after replace"]
OLDER = b"what was here before\n"
POINTS: tuple[Point, ...] = ("in a write", "before fsync", "before replace", "after replace")


@dataclass(frozen=True)
class Moment:
    """When a process is killed: after a time, or where it comes to a point for the nth time."""

    after_s: float = 0.0
    point: Point | None = None
    nth: int = 0

    def __str__(self) -> str:
        return f"{self.point}, time {self.nth}" if self.point else f"after {self.after_s:.3f} s"


@dataclass(frozen=True)
class Job:
    """A command and how to judge its work.

    Attributes:
        name: Of the command.
        arguments: Its arguments; it writes into the folder `out` of its working directory.
        folder: Its working directory, with nothing else in it.
        older: Files that lie in `out` before.
        in_fresh_python: Start it in an interpreter that has imported nothing yet.
    """

    name: str
    arguments: tuple[str, ...]
    folder: Path
    older: tuple[str, ...] = ()
    in_fresh_python: bool = False

    @property
    def out(self) -> Path:
        """Folder it writes into, and nobody else."""
        return self.folder / "out"

    @property
    def log(self) -> Path:
        """Standard output of all its processes; standard error beside it."""
        return self.folder.with_name(f"{self.folder.name}-log")


@dataclass(frozen=True)
class Undisturbed:
    """What a job writes when it is left alone.

    Attributes:
        folder: What was in `out`.
        lasts_s: How long it took.
        num_files: How many files it itself put into place, some of them more than once; 0 if it
            was started in a fresh interpreter.
    """

    folder: Path
    lasts_s: float
    num_files: int


# Starting


def start(job: Job, moment: Moment | None = None, max_bytes: int | None = None) -> BaseProcess:
    """Start it as the leader of a session of its own.

    Args:
        job: What to start.
        moment: When it kills itself, if at a point.
        max_bytes: Limit for the size of its files.
    """
    return start_beside(_lead, job, moment, max_bytes, log=job.log)


def run(job: Job, max_bytes: int | None = None, moment: Moment | None = None) -> Said:
    """Start it and wait for its end."""
    for log in (job.log, job.log.with_suffix(".err")):
        log.unlink(missing_ok=True)
    process = start(job, moment, max_bytes)
    process.join(timeout=600)
    assert process.exitcode is not None, f"{job.name} does not end"
    return Said(process.exitcode, job.log.read_text(), job.log.with_suffix(".err").read_text())


def _lead(job: Job, moment: Moment | None, max_bytes: int | None) -> None:
    os.setsid()
    os.chdir(job.folder)
    with job.log.with_suffix(".err").open("ab") as stream:
        os.dup2(stream.fileno(), 2)
    if max_bytes is not None:
        resource.setrlimit(resource.RLIMIT_FSIZE, (max_bytes, max_bytes))
    passed: dict[Point, int] = {}
    if moment is not None and moment.point is not None:
        passed = _die_at(moment.point, moment.nth)
    if job.in_fresh_python:
        code = f"from world_fixture import call_command; call_command({job.name!r}, "
        code += f"{list(job.arguments)!r})"
        where = {"PYTHONPATH": os.pathsep.join(filter(None, sys.path))}
        os.execve(sys.executable, [sys.executable, "-c", code], {**os.environ, **where})
    call_command(job.name, job.arguments)
    job.log.with_suffix(".count").write_text(str(passed.get("after replace", 0)))


def _die_at(point: Point, nth: int) -> dict[Point, int]:
    """Have this process kill itself where it puts its nth file into place.

    Returns:
        Counts how often it has come to each point.
    """
    passed = dict.fromkeys(POINTS, 0)
    real_fsync, real_replace, real_open = os.fsync, Path.replace, os.fdopen

    def is_due(here: Point) -> bool:
        passed[here] += 1
        return here == point and passed[here] == nth

    def die() -> None:
        os.kill(os.getpid(), signal.SIGKILL)

    class Stream(io.BufferedWriter):
        is_new = True

        def write(self, content: Any) -> int:
            if self.is_new and is_due("in a write"):
                whole = memoryview(content).cast("B")
                super().write(whole[: len(whole) // 2])
                self.flush()
                die()
            self.is_new = False
            return super().write(content)

    def fdopen(handle: int, mode: str = "r", *more: Any, **named: Any) -> Any:
        if mode != "wb":
            return real_open(handle, mode, *more, **named)
        return Stream(io.FileIO(handle, mode))

    def fsync(handle: int) -> None:
        if is_due("before fsync"):
            die()
        real_fsync(handle)

    def put_into_place(path: Path, target: Path) -> Path:
        if is_due("before replace"):
            die()
        result = real_replace(path, target)
        if is_due("after replace"):
            die()
        return result

    os.fsync, Path.replace, os.fdopen = fsync, put_into_place, fdopen  # type: ignore[assignment]
    return passed


# Judging


def make_undisturbed(job: Job, aside: Path) -> Undisturbed:
    """Let it do its work once, and move that away."""
    prepare(job)
    start_beside(os.getpid, log=job.log).join()  # the first start is slow
    started_s = time.monotonic()
    said = run(job, moment=Moment(point="after replace"))  # never the 0th time: it counts
    lasts_s = time.monotonic() - started_s
    assert said.status == 0, said.err
    shutil.move(job.out, aside)
    num_files = 0
    if not job.in_fresh_python:
        num_files = int(job.log.with_suffix(".count").read_text())
        assert num_files > 0
    return Undisturbed(aside, lasts_s, num_files)


def prepare(job: Job) -> None:
    """Have `out` as it is before the job."""
    job.folder.mkdir(parents=True, exist_ok=True)
    shutil.rmtree(job.out, ignore_errors=True)
    for name in job.older:
        job.out.mkdir(parents=True, exist_ok=True)
        (job.out / name).write_bytes(OLDER)


def finish(job: Job, undisturbed: Undisturbed) -> None:
    """Call it once more, and check that all is as if it had not been disturbed."""
    said = run(job)
    assert said.status == 0, said.out + said.err
    assert_same(job.out, undisturbed.folder)
    with sole_writer(job.out):
        pass


def kill_again_and_again(
    job: Job, undisturbed: Undisturbed, moments: Iterator[Moment], kills: int
) -> int:
    """Kill it, call it again, kill it, ...; then let it finish, and compare.

    Args:
        job: What to kill; only the process itself is killed, its workers have to end by themselves.
        undisturbed: What must come of it.
        moments: When.
        kills: How often; it may come to its end before.

    Returns:
        How often it was killed.
    """
    sessions: list[int] = []
    with ExitStack() as thrown:
        prepare(job)
        for moment in moments:
            process = start(job, moment)
            process.join(timeout=600 if moment.point else moment.after_s)
            process.kill()
            process.join()
            print(f"{job.name}, {moment}: exit code {process.exitcode}")
            if process.exitcode != -signal.SIGKILL:
                said = job.log.with_suffix(".err").read_text()
                assert process.exitcode == 0, said
                break
            assert process.pid is not None
            sessions.append(process.pid)
            when = "while it puts a file into place" if moment.point else "at a random moment"
            row = tally.throw(f"SIGKILL of {job.name} {when}", OUTCOME)
            figures = thrown.enter_context(row)
            figures["undisturbed, it lasts"] = f"{undisturbed.lasts_s:.1f} s"
            assert_whole(job, undisturbed)
            if len(sessions) == kills:
                break
        finish(job, undisturbed)
        assert_none_left(sessions)
    return len(sessions)


OUTCOME = (
    "every file is whole, no lock and no worker stays; the same command ends with the same bytes"
)


def assert_whole(job: Job, undisturbed: Undisturbed) -> None:
    """Check that every file that can be seen is whole: its older, its last, or a loadable form."""
    for name, path in _visible(job.out).items():
        load = _loader(path)
        if load is not None:
            load(path)
        else:
            wholes = [_settled(undisturbed.folder / name)]
            wholes += [OLDER] if name in job.older else []
            assert _settled(path) in wholes, f"{name} is not whole"


def assert_same(folder: Path, expected: Path) -> None:
    """Check that two finished folders hold the same, and no leftovers."""
    ours, theirs = _visible(folder), _visible(expected)
    assert {name for name in ours if "tfevents" not in name} == {
        name for name in theirs if "tfevents" not in name
    }
    assert {path for path in folder.rglob("*") if path.is_file()} == set(ours.values())
    for name, path in ours.items():
        if _loader(path) is None or path.suffix == ".csv":
            assert _settled(path) == _settled(theirs[name]), f"{name} differs"
    if (expected / "checkpoints").exists():  # two trainings
        assert_same_run(folder, expected)
        assert _events(folder / "tensorboard") == _events(expected / "tensorboard")


def leftovers(folder: Path) -> set[Path]:
    """Files that are not whole."""
    return set(folder.rglob(".*.part"))


def assert_none_left(sessions: list[int]) -> None:
    """Wait until no process of these sessions is left."""
    for _ in range(600):
        left = [pid for pid, session in _sessions().items() if session in sessions]
        if not left:
            return
        time.sleep(0.1)
    for pid in left:
        os.kill(pid, signal.SIGKILL)
    raise AssertionError(f"{len(left)} processes of killed ones have not ended")


def _sessions() -> Mapping[int, int]:
    """Session of each living process."""
    found = {}
    for path in Path("/proc").glob("[0-9]*/stat"):
        try:
            state, _, _, session, *_ = path.read_text().rpartition(")")[2].split()
        except OSError:  # has ended
            continue
        if state != "Z":
            found[int(path.parent.name)] = int(session)
    return found


def _visible(folder: Path) -> dict[str, Path]:
    """All files whose path has no hidden part, by their name in the folder."""
    files = {str(p.relative_to(folder)): p for p in folder.rglob("*") if p.is_file()}
    return {
        name: path
        for name, path in files.items()
        if not any(part.startswith(".") for part in Path(name).parts)
    }


def _settled(path: Path) -> bytes:
    """A file's bytes; pages without the time of day at which they were made."""
    content = path.read_bytes()
    if path.suffix == ".html":
        content = re.sub(rb"<dt>Date</dt><dd>[^<]*</dd>", b"", content)
    return content


def _loader(path: Path) -> Callable[[Path], object] | None:
    """Reads a file whose contents grow with the work or hang on time; None for all others."""
    if "tfevents" in path.name:
        return lambda path: _events(path)
    if path.name == "training_time.json":
        return lambda path: json.loads(path.read_text())["train_s"]
    return {".ckpt": _load_checkpoint, ".csv": _load_metrics}.get(path.suffix)


def _load_checkpoint(path: Path) -> None:
    assert torch.load(path, weights_only=True)["state_dict"]


def _load_metrics(path: Path) -> None:
    header, *rows = path.read_text().split("\n")
    assert rows.pop() == ""
    assert all(row.count(",") == header.count(",") for row in rows)


def _events(path: Path) -> dict[str, list[tuple[int, float]]]:
    """Scalars as TensorBoard shows them: by name, step and value."""
    read = EventAccumulator(str(path)).Reload()
    return {
        tag: [(event.step, event.value) for event in read.Scalars(tag)]
        for tag in read.Tags()["scalars"]
    }
