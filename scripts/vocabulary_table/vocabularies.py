"""Which vocabularies are made, and which planners are trained on them."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import get_args

from planning_table.experiments import HALF_STEPS
from run_queue import Experiment, Place

from shoot.templates.methods import Method

METHODS: tuple[Method, ...] = get_args(Method)
SIZES = (250, 500, 1000, 2000, 4000)
SIZE = 1000  # at which planners are trained on every method
SEEDS = (0, 1, 2)


@dataclass(frozen=True)
class Vocabulary:
    """A method at a size."""

    method: Method
    k: int

    @property
    def name(self) -> str:
        """Of its record, and in the names of the runs on it."""
        return f"{self.method}-{self.k}"

    def file(self, place: Place) -> Path:
        """The template file that planners are trained with."""
        return place.folder / "vocabularies" / f"{self.name}.npz"


ALL = tuple(Vocabulary(method, k) for k in SIZES for method in METHODS)
TRAINED = tuple(v for v in ALL if v.k == SIZE or v.method == "kmeans")


def runs_on(vocabularies: Sequence[Vocabulary], place: Place) -> list[Experiment]:
    """The planner `small`, half its steps, on each of some vocabularies, seed by seed."""
    return [
        Experiment(one.name, "small", seed, ("--templates", str(one.file(place)), *HALF_STEPS))
        for seed in SEEDS
        for one in vocabularies
    ]
