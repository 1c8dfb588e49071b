"""Disks that are full or only for reading: one sentence, nothing half there, and it can go on."""

from itertools import count
from pathlib import Path
from typing import Any

import pytest
import tally
from jobs import COMMANDS, make_job, undisturbed
from killing import (
    Job,
    Moment,
    Undisturbed,
    assert_whole,
    finish,
    leftovers,
    prepare,
    run,
    start,
)
from small_disk import filled, read_only, small_disk
from world_fixture import TinyRun, complaint

OUTCOME = (
    "one sentence that names the file, status 2, no half file; with room again the same command "
    "ends with the same bytes"
)
CHECKPOINT = "checkpoints/last.ckpt"


def every_time(*names: str) -> list[Any]:
    """All commands, those not named in the long form only."""
    return [
        pytest.param(name, marks=[] if name in names else pytest.mark.full) for name in COMMANDS
    ]


def fail(job: Job, expected: Undisturbed, says: str, max_bytes: int | None = None) -> None:
    """Let it meet a disk that does not take what it writes."""
    sentence = complaint(run(job, max_bytes))
    assert "out" in Path(sentence.split("'")[1]).parts  # workers are given the whole path
    assert says in sentence
    assert_whole(job, expected)


def meet_full_disk(job: Job, data: TinyRun, room: float) -> None:
    """Leave room for a share of what it writes."""
    expected = undisturbed(job, data)
    num_bytes = sum(path.stat().st_size for path in expected.folder.rglob("*"))
    with small_disk(job.folder) as disk, tally.throw(f"{job.name} on a full disk", OUTCOME):
        prepare(job)
        with filled(disk, int(room * num_bytes)):
            fail(job, expected, "No space left on device; make room there")
            assert not leftovers(job.out)
        finish(job, expected)


@pytest.mark.parametrize("name", every_time("shoot-train", "shoot-fit-templates"))
def test_full_disk(name: str, tiny_run: TinyRun, tmp_path: Path) -> None:
    job = make_job(name, tiny_run, tmp_path / "disk", workers=int(name == "shoot-make-world"))
    meet_full_disk(job, tiny_run, 0.6)


@pytest.mark.full
@pytest.mark.parametrize("room", [0.0, 0.01, 0.1, 0.3, 0.5, 0.8, 0.9])
@pytest.mark.parametrize("name", COMMANDS)
def test_fuller_disks(name: str, room: float, tiny_run: TinyRun, tmp_path: Path) -> None:
    meet_full_disk(make_job(name, tiny_run, tmp_path / "disk"), tiny_run, room)


@pytest.mark.parametrize("name", every_time("shoot-train"))
def test_files_that_may_not_become_so_large(name: str, tiny_run: TinyRun, tmp_path: Path) -> None:
    """What can be tried without a disk of its own."""
    job = make_job(name, tiny_run, tmp_path / "work")
    expected = undisturbed(job, tiny_run)
    largest = max(path.stat().st_size for path in expected.folder.rglob("*"))
    with tally.throw(f"{job.name} under a limit for the size of files", OUTCOME):
        prepare(job)
        fail(job, expected, "File too large; raise the limit", max_bytes=largest // 2)
        finish(job, expected)


def begin_run(job: Job) -> None:
    """Train to the first checkpoint, then be killed."""
    prepare(job)
    for nth in count(8):  # files that are put into place; it is among the first ones
        process = start(job, Moment(point="after replace", nth=nth))
        process.join()
        assert process.exitcode
        if (job.out / CHECKPOINT).exists():
            return


@pytest.mark.parametrize("trouble", ["full", pytest.param("read-only", marks=pytest.mark.full)])
def test_checkpoint_outlives_the_disk(trouble: str, tiny_run: TinyRun, tmp_path: Path) -> None:
    job = make_job("shoot-train", tiny_run, tmp_path / "disk", workers=1)
    expected = undisturbed(job, tiny_run)
    row = "shoot-train --resume on a disk that is " + trouble
    with (
        small_disk(job.folder) as disk,
        tally.throw(row, f"the checkpoint is as it was; {OUTCOME}"),
    ):
        begin_run(job)
        before = (job.out / CHECKPOINT).read_bytes()
        if trouble == "full":
            with filled(disk, len(before) // 2):
                fail(job, expected, "No space left on device; make room there")
        else:
            with read_only(disk):
                fail(job, expected, "Read-only file system; name a place that can be written")
        assert (job.out / CHECKPOINT).read_bytes() == before
        finish(job, expected)


@pytest.mark.full
@pytest.mark.parametrize("name", COMMANDS)
def test_read_only_disk(name: str, tiny_run: TinyRun, tmp_path: Path) -> None:
    job = make_job(name, tiny_run, tmp_path / "disk")
    expected = undisturbed(job, tiny_run)
    with small_disk(job.folder) as disk, tally.throw(f"{name} on a read-only disk", OUTCOME):
        prepare(job)
        with read_only(disk):
            fail(job, expected, "Read-only file system; name a place that can be written")
        finish(job, expected)
