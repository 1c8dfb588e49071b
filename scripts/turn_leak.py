"""Does a trained planner know where the ego will turn? Report and figure for docs/results/turns.md.

    python scripts/turn_leak.py RUN --split val --out leak.json --figure leak.png

The towns and their traffic are made again from the seed in the data set's world.json, also with the
ego on each other way it could have taken, to know from when on its way could show at all. That
takes several seconds a scene.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import tyro

from lss_core.bounds import Workers, check_settings
from shoot.cli.app import run
from shoot.prediction.run import open_run, predict
from shoot.rendering import save_figure
from shoot.studies.turn_leak.answers import answer
from shoot.studies.turn_leak.figure import render_leak
from shoot.studies.turn_leak.intersections import find_questions
from shoot.studies.turn_leak.report import LeakReport, format_leak, report
from shoot.training.planning.data import load_split


@dataclass(frozen=True)
class TurnLeakConfig:
    """Ask a planner before each intersection which way the ego will go.

    Attributes:
        run: Run folder of a planner trained on a synthetic world.
        split: Scenes to ask about.
        checkpoint: `last`, or `best` by validation top-10.
        out: Report to write, JSON.
        figure: Picture to write.
        root: Data root, if not the run's own.
        workers: Processes that make traffic again.
    """

    run: Annotated[str, tyro.conf.Positional]
    split: str = "val"
    checkpoint: Literal["last", "best"] = "last"
    out: str = "leak.json"
    figure: str = "leak.png"
    root: str | None = None
    workers: Workers = 2

    def __post_init__(self) -> None:
        check_settings(self)


def turn_leak(config: TurnLeakConfig) -> LeakReport:
    """Ask, print the table and save report and picture."""
    trained = open_run(config.run, config.checkpoint, config.root)
    split = load_split(trained.config.data, config.split, trained.templates)
    questions = find_questions(split, Path(trained.config.data.root), config.workers)
    log_probs = predict(trained, split)
    answers = answer(questions, log_probs, trained.templates.points, split.futures.xy_m)
    leak = report(answers, Path(config.run).name, config.split, trained.templates.horizon_s)
    leak.save(Path(config.out))
    save_figure(render_leak(leak), config.figure)
    print(format_leak(leak))
    print(f"Report: {config.out}  Picture: {config.figure}")
    return leak


if __name__ == "__main__":
    run(TurnLeakConfig, turn_leak, "Does a planner know where the ego will turn?")
