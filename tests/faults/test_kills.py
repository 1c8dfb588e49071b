"""Commands that are killed at any moment lose nothing: called again, they end as undisturbed."""

import random
from collections.abc import Iterator
from pathlib import Path

import pytest
from jobs import COMMANDS, make_job, undisturbed
from killing import POINTS, Job, Moment, Undisturbed, kill_again_and_again
from world_fixture import TinyRun

OFTEN = 25  # kills of a command of each kind
IN_A_ROW = 6  # kills before it may finish


def at_random(seed: int, expected: Undisturbed) -> Iterator[Moment]:
    """Moments spread evenly over the life of a command."""
    rng = random.Random(seed)
    while True:
        yield Moment(after_s=rng.uniform(0.0, expected.lasts_s))


def at_points(seed: int, expected: Undisturbed) -> Iterator[Moment]:
    """Points in turn, at any of the files that are put into place."""
    rng = random.Random(seed)
    while True:
        for point in rng.sample(POINTS, len(POINTS)):
            yield Moment(point=point, nth=rng.randint(1, expected.num_files))


def kill_often(
    job: Job, expected: Undisturbed, moments: Iterator[Moment], kills: int = OFTEN
) -> None:
    """Sequences of kills, each to its end, until there were so many."""
    done = 0
    for _ in range(4 * kills):
        few = min(IN_A_ROW, kills - done)
        done += kill_again_and_again(job, expected, moments, few)
        if done == kills:
            return
    raise AssertionError(f"{job.name} has come to its end too often: {done} kills")


@pytest.mark.parametrize("seed", [1])
@pytest.mark.parametrize("name", COMMANDS)
def test_killed_and_called_again(name: str, seed: int, tiny_run: TinyRun, tmp_path: Path) -> None:
    job = make_job(name, tiny_run, tmp_path / "work", workers=int(name == "shoot-train"))
    expected = undisturbed(job, tiny_run)
    moments = [next(kind(seed, expected)) for kind in (at_random, at_points)]
    kill_again_and_again(job, expected, iter(moments), len(moments))


@pytest.mark.full
@pytest.mark.parametrize("seed", [11])
@pytest.mark.parametrize(
    ("name", "workers", "kills"),
    [
        ("shoot-make-world", 1, 8),  # whose starts take most of the time
        ("shoot-make-world", 0, OFTEN - 8),
        ("shoot-fit-templates", 0, OFTEN),
        ("shoot-train", 1, OFTEN),
        ("shoot-evaluate", 0, OFTEN),
    ],
)
def test_killed_at_random_moments(
    name: str, workers: int, kills: int, seed: int, tiny_run: TinyRun, tmp_path: Path
) -> None:
    job = make_job(name, tiny_run, tmp_path / "work", workers)
    expected = undisturbed(job, tiny_run)
    kill_often(job, expected, at_random(seed, expected), kills)


@pytest.mark.full
@pytest.mark.parametrize("seed", [31])
@pytest.mark.parametrize("name", COMMANDS)
def test_killed_from_the_first_import_on(
    name: str, seed: int, tiny_run: TinyRun, tmp_path: Path
) -> None:
    job = make_job(name, tiny_run, tmp_path / "work", fresh=True)
    expected = undisturbed(job, tiny_run)
    kill_often(job, expected, at_random(seed, expected), kills=3)


@pytest.mark.full
@pytest.mark.parametrize("seed", [51])
@pytest.mark.parametrize("name", COMMANDS)
def test_killed_where_files_are_written(
    name: str, seed: int, tiny_run: TinyRun, tmp_path: Path
) -> None:
    job = make_job(name, tiny_run, tmp_path / "work")
    expected = undisturbed(job, tiny_run)
    kill_often(job, expected, at_points(seed, expected))
