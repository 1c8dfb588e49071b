"""What a row of the table is, and what makers of rows are given."""

from dataclasses import dataclass, field
from pathlib import Path

from benchmarks.machine import Machine
from benchmarks.measuring import Pair


@dataclass(frozen=True)
class Check:
    """Something beside the ratio that must hold.

    Attributes:
        what: In words, with the number that was found.
        holds: Whether it does.
    """

    what: str
    holds: bool


@dataclass(frozen=True)
class Row:
    """One row of the table.

    Attributes:
        name: What is done.
        plain: What the plain side is.
        fast: What the fast side is.
        pair: Times, their ratio and memory.
        required: The least ratio.
        floor_s: Least time the fast side could take on this machine, where that can be stated.
        checks: What else must hold.
    """

    name: str
    plain: str
    fast: str
    pair: Pair
    required: float
    floor_s: float | None = None
    checks: tuple[Check, ...] = field(default=())

    @property
    def holds(self) -> bool:
        """Whether ratio and checks do."""
        return self.pair.ratio.median >= self.required and all(c.holds for c in self.checks)


@dataclass(frozen=True)
class Setting:
    """What the rows are given.

    Attributes:
        folder: For worlds, runs and tables; what lies there is used again.
        machine: Its limits.
        repeats: Of every pair.
        images: Data root with 1600 x 900 images; None: made.
        images_version: Its version.
    """

    folder: Path
    machine: Machine
    repeats: int
    images: Path | None
    images_version: str
