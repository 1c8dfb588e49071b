"""shoot-demo: the whole thing on the synthetic world, in minutes, on a laptop."""

import time
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.rule import Rule

from shoot.cli.app import run
from shoot.cli.fit_templates import DataSource, FitTemplatesConfig, fit
from shoot.comparison import compare
from shoot.config import DEMO
from shoot.datamodule import LabelledSplit, load_split
from shoot.evaluation import condition_of
from shoot.manoeuvres import classify_manoeuvres
from shoot.metrics import negative_log_likelihood
from shoot.prediction import TrainedRun, open_run, predict
from shoot.rendering import render_sample, save_figure
from shoot.report_table import format_table
from shoot.sample_views import view_sample
from shoot.training import train
from shoot.world.writer import VERSION, MakeWorldConfig, make_world


@dataclass(frozen=True)
class DemoConfig:
    """Make a small city, fit templates, train, evaluate, draw; run again, it goes on.

    The city has a keyframe a second, half as many as nuScenes: neighbours look alike, so that more
    scenes teach more than more keyframes. It has none in the last 5 s of a scene, which have no
    whole future.

    Attributes:
        out: Folder for everything.
        train_scenes: Scenes to train on, four in each town.
        val_scenes: Scenes to evaluate on, each in a town of its own that training never saw.
        k: Number of templates.
        steps: Optimiser steps.
        seed: Of city, templates and training.
        image_scale: Size of the city's images as a share of 1600 x 900.
        workers: Processes that make the city.
    """

    out: Path = Path("demo")
    train_scenes: int = 160
    val_scenes: int = 60
    k: int = 1000
    steps: int = DEMO.optim.steps
    seed: int = 0
    image_scale: float = 0.11
    workers: int = 2


def demo(config: DemoConfig) -> None:
    """Do all of it.

    Raises:
        DataError: If the folder holds something else.
    """
    console = Console()
    started = time.monotonic()

    def announce(what: str) -> None:
        console.print(Rule(f"{what} ({time.monotonic() - started:.0f} s so far)", align="left"))

    world, templates = config.out / "world", config.out / "templates.npz"
    folder, report_file = config.out / "run", config.out / "report.json"
    announce(f"1/5 A city: {config.train_scenes} + {config.val_scenes} scenes")
    make_world(
        MakeWorldConfig(
            out=world,
            train_scenes=config.train_scenes,
            val_scenes=config.val_scenes,
            seed=config.seed,
            image_scale=config.image_scale,
            workers=config.workers,
            scenes_per_town=4,
            keyframe_s=1.0,
            tail_s=5.0,
        )
    )
    announce(f"2/5 {config.k} templates of how its ego drives")
    if not templates.exists():
        source = DataSource(str(world), VERSION)
        fit(FitTemplatesConfig(source, str(templates), k=config.k, seed=config.seed))
    announce(f"3/5 Training, {config.steps} steps")
    train(
        replace(
            DEMO,
            templates=str(templates),
            out=str(folder),
            data=replace(DEMO.data, root=str(world), version=VERSION),
            optim=replace(DEMO.optim, steps=config.steps),
            val_every=min(DEMO.val_every, config.steps),
            seed=config.seed,
            resume=True,
        )
    )
    announce("4/5 Evaluation")
    trained = open_run(folder)
    report = compare(trained, "val")
    report.save(report_file)
    announce("5/5 A picture")
    picture = _draw(trained, config.out)
    announce("Done")
    print(format_table(report))
    print(f"Report:  {report_file}")
    print(f"Picture: {picture}")


def _draw(trained: TrainedRun, out: Path) -> Path:
    """Draw the turn by day whose NLL is the median: neither the best nor the worst."""
    split = load_split(trained.config.data, "val", trained.templates)
    chosen = _typical_turn(trained, split)
    figure = render_sample(view_sample(trained, split, chosen))
    return save_figure(figure, out / "planned.png", dpi=110.0)


def _typical_turn(trained: TrainedRun, split: LabelledSplit) -> int:
    descriptions = split.index.scene_description[split.futures.scene]
    is_day = np.asarray([condition_of(str(text)) == "day" for text in descriptions])
    length_m = np.linalg.norm(split.futures.xy_m[:, -1], axis=-1)
    turns = np.isin(classify_manoeuvres(split.futures.xy_m), ["left", "right"])
    candidates = np.flatnonzero(is_day & turns & (length_m > 15.0))
    if not len(candidates):
        candidates = np.arange(len(split.labels))
    few = candidates[np.linspace(0, len(candidates) - 1, min(40, len(candidates))).astype(int)]
    few_split = replace(
        split,
        futures=split.futures.select(np.isin(np.arange(len(split.labels)), few)),
        labels=split.labels[few],
    )
    nll = negative_log_likelihood(predict(trained, few_split), few_split.labels)
    return int(few[np.argsort(nll, kind="stable")[len(nll) // 2]])


def main() -> None:
    """Entry point of `shoot-demo`."""
    run(DemoConfig, demo, "The whole Shoot pipeline on a synthetic city, in minutes.")
