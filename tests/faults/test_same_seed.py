"""The same seed gives the same bytes; another one, and each pass and draw, others."""

import hashlib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from jobs import make_job, undisturbed
from killing import prepare, run
from resumption import assert_same_run
from tally import throw
from world_fixture import NUM_TEMPLATES, TinyRun, command, train_flags

from shoot.templates import TemplateSet
from shoot.training.data import TaskData
from shoot.training.planning.config import TrainConfig
from shoot.training.planning.data import PlanBatch
from shoot.training.planning.task import Planning

SAME = "the same bytes"


def digests(folder: Path) -> dict[str, str]:
    return {
        str(path.relative_to(folder)): hashlib.sha256(path.read_bytes()).hexdigest()
        for path in folder.rglob("*")
        if path.is_file()
    }


def succeed(name: str, *arguments: object) -> None:
    said = command(name, *arguments)
    assert said.status == 0, said.err


def test_worlds(tiny_run: TinyRun, tmp_path: Path) -> None:
    jobs = (make_job("shoot-make-world", tiny_run, tmp_path, workers) for workers in (0, 1))
    first, second = (digests(undisturbed(job, tiny_run).folder) for job in jobs)
    with throw("worlds of one seed, made with 1 and 2 workers", SAME):
        assert len(first) > 40
        assert second == first
    same = make_job("shoot-make-world", tiny_run, tmp_path / "work")
    job = replace(same, arguments=(*same.arguments, "--seed", "4"))
    prepare(job)
    assert run(job).status == 0
    other = digests(job.out)
    # Names are official ones; what is there to be seen differs.
    images = {name for name in first if name.endswith(".jpg")}
    assert images
    assert not any(other.get(name) == first[name] for name in images)


def test_templates(tiny_run: TinyRun, tmp_path: Path) -> None:
    for name, seed in (("first", 0), ("second", 0), ("other", 1)):
        flags = ["--data.root", tiny_run.root, "--k", NUM_TEMPLATES, "--seed", seed]
        succeed("shoot-fit-templates", *flags, "--out", tmp_path / name / "t.npz")
    with throw("template files of one seed", SAME):
        first = digests(tmp_path / "first")
        assert first.keys() == {"t.npz", "t.json", "t.png"}
        assert digests(tmp_path / "second") == first
    assert digests(tmp_path / "other") != first


def test_trainings(tiny_run: TinyRun, tmp_path: Path) -> None:
    for name, seed in (("first", 5), ("second", 5), ("other", 6)):
        flags = train_flags(tiny_run.root, tiny_run.templates, tmp_path / name, 8, 4)
        # All that is random is on.
        flags += ["--data.image.flip", "--data.image.rotate-rad", "0.1", "--data.drop-cameras", "1"]
        succeed("shoot-train", *flags, "--seed", seed)
    with throw("trainings of one seed", SAME):
        assert_same_run(tmp_path / "second", tmp_path / "first")
        weights = [(tmp_path / n / "weights.safetensors").read_bytes() for n in ("first", "second")]
        assert weights[0] == weights[1]
    assert (tmp_path / "other" / "weights.safetensors").read_bytes() != weights[0]


@pytest.fixture(scope="module")
def config(tiny_run: TinyRun) -> TrainConfig:
    """Of a run whose images are augmented in all ways there are."""
    config = TrainConfig.load(tiny_run.folder / "config.yaml")
    image = replace(config.data.image, flip=True, rotate_rad=0.1, resize=(0.9, 1.1))
    data = replace(config.data, image=image, drop_cameras=1, extrinsic_noise_rad=0.01)
    return replace(config, data=data, val_every=25)


def read(config: TrainConfig, num_workers: int) -> list[PlanBatch]:
    """50 samples in a round of 25 batches: the 20 samples of the set, two and a half times."""
    task = Planning(config, TemplateSet.load(config.templates))
    data = TaskData(replace(config, num_workers=num_workers), task)
    return list(data.train_dataloader())


def test_loaders(config: TrainConfig) -> None:
    alone = read(config, 0)
    for num_workers in (1, 4):
        helped = read(config, num_workers)
        with throw("rounds read by 0, 1 and 4 loader processes", SAME, times=len(alone)):
            assert len(helped) == len(alone) == 25
            for ours, theirs in zip(alone, helped, strict=True):
                for name, value in vars(ours.sensors).items():
                    assert torch.equal(value, getattr(theirs.sensors, name)), name
                assert torch.equal(ours.future, theirs.future)


def test_augmentation_differs_between_passes_and_workers(config: TrainConfig) -> None:
    rounds = read(config, 4)
    row = np.concatenate([batch.sensors.sample_idx.numpy() for batch in rounds])
    matrix = np.concatenate(
        [batch.sensors.pixel_from_camera.flatten(1).numpy() for batch in rounds]
    )
    # Each of 20 samples is seen two or three times, its augmentation drawn anew each time; were
    # workers seeded alike, neighbouring batches would repeat each other's draws.
    counts = np.unique(row, return_counts=True)[1]
    assert (len(counts), counts.min(), counts.max()) == (20, 2, 3)
    assert len(np.unique(matrix.round(4), axis=0)) == len(matrix) == 50
