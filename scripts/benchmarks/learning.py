"""Whether the fast ways learn and plan the same: short trainings, and two planners compared."""

import csv
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from shoot.cli.fit_templates import DataSource, FitTemplatesConfig, fit
from shoot.prediction.run import open_run, predict
from shoot.training.config import Precision
from shoot.training.planning.config import DEMO, PAPER, TrainConfig
from shoot.training.planning.data import load_split
from shoot.training.planning.task import train
from shoot.world.config import VERSION, MakeWorldConfig
from shoot.world.writer import make_world

STEPS = 200
SEEDS = (0, 1, 2)


@dataclass(frozen=True)
class Agreement:
    """Two planners on the same samples.

    Attributes:
        overlap: Share of the ten most probable templates that they have in common.
        largest_change: Largest difference of a template's probability.
        num_samples: Samples compared.
    """

    overlap: float
    largest_change: float
    num_samples: int


def make_data(folder: Path) -> None:
    """A small city and its templates; left as they are if they are there."""
    make_world(
        MakeWorldConfig(
            out=folder / "world",
            train_scenes=40,
            val_scenes=10,
            image_scale=0.11,
            scenes_per_town=4,
            tail_s=5.0,
        )
    )
    templates = folder / "templates.npz"
    if not templates.exists():
        fit(FitTemplatesConfig(DataSource(str(folder / "world"), VERSION), str(templates)))


def loss_after(folder: Path, precision: Precision, seed: int) -> float:
    """Validation loss after 200 steps of the `demo` preset, on all samples of ten unseen towns."""
    out = folder / f"{precision}-{seed}"
    config = _config(DEMO, folder, out, seed)
    optim = replace(DEMO.optim, steps=STEPS, warmup_steps=20)
    train(replace(config, optim=optim, precision=precision, val_every=STEPS, val_samples=0))
    with (out / "metrics.csv").open() as stream:
        (loss,) = [float(row["val_nll"]) for row in csv.DictReader(stream) if row["val_nll"]]
    return loss


def train_paper_size(folder: Path, precision: Precision, steps: int = 40) -> Path:
    """A planner of the paper's size after some steps; it has begun to rank templates."""
    out = folder / "paper"
    config = _config(PAPER, folder, out, 0)
    model = replace(config.model, pretrained="none")
    optim = replace(config.optim, steps=steps)
    config = replace(config, model=model, optim=optim, precision=precision)
    return train(replace(config, val_every=steps, num_workers=0))


def _config(preset: TrainConfig, folder: Path, out: Path, seed: int) -> TrainConfig:
    data = replace(preset.data, root=str(folder / "world"), version=VERSION)
    return replace(
        preset,
        templates=str(folder / "templates.npz"),
        out=str(out),
        data=data,
        seed=seed,
        accelerator="cpu",
        val_samples=16,
        resume=True,
    )


def agreement(run_folder: Path, num_samples: int) -> Agreement:
    """`FastPlanner` against float32 on a run's validation samples, evenly spread."""
    run = open_run(run_folder)
    split = load_split(run.config.data, "val", run.templates)
    num = len(split.labels)
    chosen = np.unique(np.linspace(0, num - 1, min(num_samples, num)).round().astype(int))
    mask = np.isin(np.arange(num), chosen)
    split = replace(split, futures=split.futures.select(mask), labels=split.labels[mask])
    return compare(predict(run, split), predict(run, split, fast=True))


def compare(one: NDArray[np.float32], other: NDArray[np.float32]) -> Agreement:
    """Two sets of [S, K] log-probabilities."""
    best = [np.argsort(-log_prob, axis=1, kind="stable")[:, :10] for log_prob in (one, other)]
    shared = [np.isin(a, b).mean() for a, b in zip(*best, strict=True)]
    change = np.abs(np.exp(one) - np.exp(other)).max()
    return Agreement(float(np.mean(shared)), float(change), len(one))
