"""A trained planner asked about samples of a split: what the scripts of single studies share."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Protocol, TypeVar

import tyro

from lss_core.bounds import Count, check_settings
from shoot.prediction.run import TrainedRun, open_run
from shoot.training.planning.data import LabelledSplit, load_split


class Study(Protocol):
    """What a study comes to."""

    def save(self, path: Path) -> None:
        """Write it as JSON."""


StudyT = TypeVar("StudyT", bound=Study)


@dataclass(frozen=True)
class AskedRun:
    """Whom to ask about what.

    Attributes:
        run: Run folder.
        split: Scenes to ask about.
        num_samples: Samples, evenly spread.
        out: Report to write, JSON.
        root: Data root, if not the run's own.
    """

    run: Annotated[str, tyro.conf.Positional]
    split: str = "val"
    num_samples: Count = 400
    out: str = "study.json"
    root: str | None = None

    def __post_init__(self) -> None:
        check_settings(self)


def ask(
    config: AskedRun,
    study: Callable[[TrainedRun, LabelledSplit, int], StudyT],
    form: Callable[[StudyT], str],
) -> StudyT:
    """Ask, print what came out and save it."""
    trained = open_run(config.run, root=config.root)
    split = load_split(trained.config.data, config.split, trained.templates)
    found = study(trained, split, config.num_samples)
    found.save(Path(config.out))
    print(form(found))
    print(f"Report: {config.out}")
    return found
