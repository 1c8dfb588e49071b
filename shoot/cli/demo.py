"""shoot-demo: the shipped planner at once, then the whole thing in minutes, on a laptop."""

import time
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated

import numpy as np
from rich.console import Console
from rich.rule import Rule

from lss_core.bounds import Bounds, Count, Seed, Workers, check_settings
from shoot.cli.app import run
from shoot.cli.fit_templates import DataSource, FitTemplatesConfig, NumTemplates, fit
from shoot.evaluation.comparison import compare, score, sum_up
from shoot.evaluation.report import condition_of
from shoot.evaluation.results import Report
from shoot.metrics.manoeuvres import classify_manoeuvres
from shoot.metrics.ranks import negative_log_likelihood
from shoot.prediction.run import TrainedRun, open_run, predict
from shoot.prediction.shipped import shipped_run
from shoot.rendering import render_sample, save_figure
from shoot.report.sample_views import view_sample
from shoot.report.terminal import format_table
from shoot.training.planning.config import DEMO
from shoot.training.planning.data import LabelledSplit, load_split
from shoot.training.planning.task import train
from shoot.world.config import (
    MAX_TRAIN_SCENES,
    MAX_VAL_SCENES,
    VERSION,
    ImageScale,
    MakeWorldConfig,
)
from shoot.world.writer import make_world

SHIPPED_PLANNER = "shipped_planner"


@dataclass(frozen=True)
class DemoConfig:
    """Look at the shipped planner in towns it has not seen, then train one; run again, it goes on.

    The shipped planner comes first: a few towns, one picture, one table. Then a small city,
    templates of how its ego drives, a short training of a planner of one's own, and both planners
    in one table. They choose among the same templates, the shipped ones: else their ranks could not
    be compared.

    The city has a keyframe a second, half as many as nuScenes: neighbours look alike, so that more
    scenes teach more than more keyframes. It has none in the last 5 s of a scene, which have no
    whole future.

    Attributes:
        out: Folder for everything.
        first_scenes: Scenes to look at the shipped planner in, each in a town of its own; they are
            the first of those evaluated on.
        train_scenes: Scenes to train on, four in each town.
        val_scenes: Scenes to evaluate on, each in a town of its own that training never saw.
        k: Number of templates fitted to the city.
        steps: Optimiser steps.
        seed: Of city, templates and training.
        image_scale: Size of the city's images as a share of 1600 x 900.
        workers: Processes that make the city.
    """

    out: Path = Path("demo")
    first_scenes: Annotated[int, Bounds(1, MAX_VAL_SCENES)] = 12
    train_scenes: Annotated[int, Bounds(1, MAX_TRAIN_SCENES)] = 120
    val_scenes: Annotated[int, Bounds(1, MAX_VAL_SCENES)] = 48
    k: NumTemplates = 1000
    steps: Count = DEMO.optim.steps
    seed: Seed = 0
    image_scale: ImageScale = 0.11
    workers: Workers = 2

    def __post_init__(self) -> None:
        check_settings(self)


def demo(config: DemoConfig) -> None:
    """Do all of it.

    Raises:
        DataError: If the folder holds something else.
    """
    console = Console()
    started = time.monotonic()

    def announce(what: str) -> None:
        console.print(Rule(f"{what} ({time.monotonic() - started:.0f} s so far)", align="left"))

    announce(f"1/5 The shipped planner in {config.first_scenes} towns it has not seen")
    towns = config.out / "towns"
    make_world(_city(config, towns, 0, config.first_scenes))
    shipped = open_run(shipped_run(), root=str(towns))
    _show(shipped, compare(shipped, "val"), config.out / "shipped")
    world, templates = config.out / "world", config.out / "templates.npz"
    announce(f"2/5 A city: {config.train_scenes} + {config.val_scenes} scenes")
    make_world(_city(config, world, config.train_scenes, config.val_scenes))
    announce(f"3/5 {config.k} templates of how its ego drives")
    if not templates.exists():
        source = DataSource(str(world), VERSION)
        fit(FitTemplatesConfig(source, str(templates), k=config.k, seed=config.seed))
    announce(f"4/5 Training, {config.steps} steps, with the shipped templates")
    folder = config.out / "run"
    train(
        replace(
            DEMO,
            templates=str(shipped_run() / "templates.npz"),
            out=str(folder),
            data=replace(DEMO.data, root=str(world), version=VERSION),
            optim=replace(DEMO.optim, steps=config.steps),
            val_every=min(DEMO.val_every, config.steps),
            seed=config.seed,
            resume=True,
        )
    )
    announce("5/5 Evaluation and a picture")
    trained = open_run(folder)
    scored = score(trained, "val")
    beside = predict(open_run(shipped_run(), root=str(world)), scored.samples)
    scored = replace(scored, log_probs=scored.log_probs | {SHIPPED_PLANNER: beside})
    _show(trained, sum_up(trained, scored, "val"), config.out / "trained")
    announce("Done")


def _city(config: DemoConfig, out: Path, train_scenes: int, val_scenes: int) -> MakeWorldConfig:
    return MakeWorldConfig(
        out=out,
        train_scenes=train_scenes,
        val_scenes=val_scenes,
        seed=config.seed,
        image_scale=config.image_scale,
        workers=config.workers,
        scenes_per_town=4,
        keyframe_s=1.0,
        tail_s=5.0,
    )


def _show(trained: TrainedRun, report: Report, out: Path) -> None:
    report.save(out.with_suffix(".json"))
    picture = _draw(trained, out.with_suffix(".png"))
    print(format_table(report))
    print(f"Report:  {out.with_suffix('.json')}")
    print(f"Picture: {picture}")


def _draw(trained: TrainedRun, out: Path) -> Path:
    """Draw the turn by day whose NLL is the median: neither the best nor the worst."""
    split = load_split(trained.config.data, "val", trained.templates)
    chosen = _typical_turn(trained, split)
    figure = render_sample(view_sample(trained, split, chosen))
    return save_figure(figure, out, dpi=110.0)


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
