"""Commands that are killed at any moment lose nothing: called again, they end as undisturbed."""

import random
from collections.abc import Iterator
from pathlib import Path

import pytest
from jobs import COMMANDS, make_job, undisturbed
from killing import POINTS, Job, Moment, kill_again_and_again
from world_fixture import TinyRun

EVERY_DAY, FULL = 2, 25  # kills of a command
IN_A_ROW = 6  # kills before it may finish


def at_random(seed: int, lasts_s: float) -> Iterator[Moment]:
    rng = random.Random(seed)
    while True:
        yield Moment(after_s=rng.uniform(0.0, lasts_s))


def at_points(seed: int, num_files: int) -> Iterator[Moment]:
    """Points in turn, at any of the files that are put into place."""
    rng = random.Random(seed)
    while True:
        for point in rng.sample(POINTS, len(POINTS)):
            yield Moment(point=point, nth=rng.randint(1, num_files))


def kill(job: Job, data: TinyRun, moments: Iterator[Moment], kills: int, row: str) -> None:
    """Sequences of kills, each to its end, until there were so many."""
    expected = undisturbed(job, data)
    done = 0
    for _ in range(4 * kills):
        few = min(IN_A_ROW, kills - done)
        done += kill_again_and_again(job, expected, moments, few, row)
        if done == kills:
            return
    raise AssertionError(f"{job.name} has come to its end too often: {done} kills")


def kill_at_random(job: Job, data: TinyRun, seed: int, kills: int) -> None:
    moments = at_random(seed, undisturbed(job, data).lasts_s)
    kill(job, data, moments, kills, f"SIGKILL of {job.name} at a random moment")


def kill_at_points(job: Job, data: TinyRun, seed: int, kills: int) -> None:
    moments = at_points(seed, undisturbed(job, data).num_files)
    kill(job, data, moments, kills, f"SIGKILL of {job.name} while it puts a file into place")


@pytest.mark.parametrize("seed", [1])
@pytest.mark.parametrize("name", COMMANDS)
def test_killed_at_random_moments(name: str, seed: int, tiny_run: TinyRun, tmp_path: Path) -> None:
    workers = int(name == "shoot-train")
    job = make_job(name, tiny_run, tmp_path / "work", workers)
    kill_at_random(job, tiny_run, seed, EVERY_DAY)


@pytest.mark.parametrize("seed", [2])
@pytest.mark.parametrize("name", COMMANDS)
def test_killed_where_files_are_written(
    name: str, seed: int, tiny_run: TinyRun, tmp_path: Path
) -> None:
    job = make_job(name, tiny_run, tmp_path / "work")
    kill_at_points(job, tiny_run, seed, EVERY_DAY)


@pytest.mark.full
@pytest.mark.parametrize("seed", [11])
@pytest.mark.parametrize("workers", [0, 1])
@pytest.mark.parametrize("name", COMMANDS)
def test_killed_at_random_moments_often(
    name: str, workers: int, seed: int, tiny_run: TinyRun, tmp_path: Path
) -> None:
    if workers and name not in ("shoot-make-world", "shoot-train"):
        pytest.skip("It has no workers.")
    job = make_job(name, tiny_run, tmp_path / "work", workers)
    kill_at_random(job, tiny_run, seed + workers, FULL)


@pytest.mark.full
@pytest.mark.parametrize("seed", [31])
@pytest.mark.parametrize("name", COMMANDS)
def test_killed_at_random_moments_from_the_first_import_on(
    name: str, seed: int, tiny_run: TinyRun, tmp_path: Path
) -> None:
    job = make_job(name, tiny_run, tmp_path / "work", fresh=True)
    kill_at_random(job, tiny_run, seed, EVERY_DAY)


@pytest.mark.full
@pytest.mark.parametrize("seed", [51])
@pytest.mark.parametrize("name", COMMANDS)
def test_killed_often_where_files_are_written(
    name: str, seed: int, tiny_run: TinyRun, tmp_path: Path
) -> None:
    job = make_job(name, tiny_run, tmp_path / "work")
    kill_at_points(job, tiny_run, seed, FULL)
