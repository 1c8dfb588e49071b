"""One driver's records as arrays: seeds by routes, and cells of tables made of them."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from run_queue import Record

from driving_table.drives import STUDY, in_words
from driving_table.failings import FAILINGS
from driving_table.records import JUMP
from shoot.metrics.bootstrap import interval
from shoot.metrics.driving_score.route_scores import PROGRESS_AT_LEAST
from shoot.simulation.route_log import Mode

Array = np.ndarray[Any, np.dtype[Any]]


@dataclass(frozen=True)
class Driven:
    """All drives of one driver in one traffic.

    Attributes:
        who: See `Drive.who`.
        records: Of each seed.
    """

    who: str
    records: tuple[Record, ...]

    @property
    def words(self) -> str:
        """Its name in tables."""
        return in_words(self.who)

    @property
    def scores(self) -> Array:
        """[seeds, routes] driving scores."""
        return self.sub_scores("driving_score")

    @property
    def moving(self) -> Array:
        """[seeds, routes] the same, where nuPlan's least progress counts: none below it."""
        return np.where(self.sub_scores("ep") >= PROGRESS_AT_LEAST, self.scores, 0.0)

    @property
    def bench2drive(self) -> Array:
        """[seeds, routes] Bench2Drive's score."""
        return _floats([record["bench2drive"] for record in self.records])

    @property
    def jumps_mps(self) -> Array:
        """[seeds, routes] mean of `speed_jumps_mps`; NaN of who plans no templates."""
        return _floats([record[JUMP] for record in self.records])

    def sub_scores(self, name: str) -> Array:
        """[seeds, routes] one of `SCORES`; NaN where a route has none."""
        return _floats([record["scores"][name] for record in self.records])

    def fails(self, name: str) -> Array:
        """[seeds, routes] whether a route fails so; False where it cannot be told."""
        found = _floats([record["failings"][name] for record in self.records])
        return found >= FAILINGS[name].bound

    def fact(self, name: str) -> float:
        """A mean of facts over seeds."""
        return float(np.mean([record["means"][name]["value"] for record in self.records]))

    def cell(self, values: Array) -> str:
        """Mean, over how many seeds it is spread, and its interval over towns."""
        mean, seeds = interval(values.mean(axis=0), self._towns), values.mean(axis=1)
        spread = f"({seeds.min():.3f} to {seeds.max():.3f}) " if len(seeds) > 1 else ""
        return f"{mean.value:.3f} {spread}[{mean.low:.3f}, {mean.high:.3f}]"

    def minus(self, ours: Array, theirs: Array) -> str:
        """Means over seeds on the same routes, with the paired interval over towns."""
        mean = interval(ours.mean(axis=0) - theirs.mean(axis=0), self._towns)
        return f"{mean.value:+.3f} [{mean.low:+.3f}, {mean.high:+.3f}]"

    @property
    def _towns(self) -> Array:
        return np.array(self.records[0]["towns"])


def by_driver(records: Sequence[Record], mode: Mode) -> dict[str, Driven]:
    """In the order of the study; a planner's seeds together."""
    own = [record for record in records if record["mode"] == mode]
    found = {
        who: tuple(record for record in own if record["who"] == who)
        for who in dict.fromkeys(drive.who for drive in STUDY)
    }
    return {who: Driven(who, of) for who, of in found.items() if of}


def _floats(rows: Sequence[Sequence[float | None]]) -> Array:
    return np.array(rows, dtype=np.float64)
