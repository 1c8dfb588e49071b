"""All routes summed up: means with intervals over towns, and differences on the same routes."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from lss_core.errors import DataError
from lss_core.strict_json import save_json
from shoot.metrics.bootstrap import GroupBootstrap, Interval
from shoot.simulation.routes.result_files import SETTINGS, SUMMARY, Row, read_object, route_file

SECTIONS = ("scores", "strict_route", "bench2drive", "facts")
TOTAL = "driving_score"

# Section -> name -> mean.
Means = dict[str, dict[str, Interval]]


@dataclass(frozen=True)
class Difference:
    """These routes against the same ones, driven otherwise.

    Attributes:
        num_routes: How many are in both.
        means: These minus those, with paired intervals.
    """

    num_routes: int
    means: Means


@dataclass(frozen=True)
class Summary:
    """What many routes say of a driver.

    Attributes:
        settings: Of all routes, as `RouteSettings.card` has them.
        num_routes: Those that failed included: they count 0 in scores, and not in facts.
        num_towns: What intervals are over.
        failures: Number of each route that failed -> why.
        means: Over routes; EC is of those with two plans at least.
        differences: Name of other results -> what these have more.
    """

    settings: Row
    num_routes: int
    num_towns: int
    failures: dict[int, str]
    means: Means
    differences: dict[str, Difference] = field(default_factory=dict)

    def to_json(self) -> Row:
        """Plain values; an interval that does not exist is null."""
        return {
            "driver": self.settings["driver"],
            "mode": self.settings["mode"],
            "score": self.settings["score"],
            "num_routes": self.num_routes,
            "num_towns": self.num_towns,
            "failures": {str(route): error for route, error in self.failures.items()},
            **_plain(self.means),
            "minus": {
                name: {"num_routes": difference.num_routes, **_plain(difference.means)}
                for name, difference in self.differences.items()
            },
            "settings": self.settings,
        }

    def save(self, folder: Path) -> None:
        """Write `summary.json`, whole or not at all."""
        save_json(self.to_json(), folder / SUMMARY)


def sum_up(rows: Sequence[Row], settings: Row, beside: Sequence[Path] = ()) -> Summary:
    """Sum up results.

    Args:
        rows: Of one folder.
        settings: Its settings.
        beside: Folders of results to compare with, on the routes that are in both.

    Raises:
        DataError: If there are no results to compare with.
    """
    values = {key: np.array([_value(row, *key) for row in rows]) for key in _keys(rows)}
    towns = np.array([row["town"] for row in rows])
    names = [folder.resolve().name for folder in beside]
    if len(set(names)) < len(names):
        raise DataError("Folders to compare with must have names of their own: rename one.")
    return Summary(
        settings=settings,
        num_routes=len(rows),
        num_towns=len(set(towns.tolist())),
        failures={row["route"]: row["error"] for row in rows if row["error"] is not None},
        means=_means(values, towns),
        differences={
            name: _compare(rows, settings, folder)
            for name, folder in zip(names, beside, strict=True)
        },
    )


def _compare(rows: Sequence[Row], settings: Row, folder: Path) -> Difference:
    theirs = read_object(folder / SETTINGS)
    if (
        theirs.get("duration_s") != settings["duration_s"]
        or theirs.get("score") != settings["score"]
    ):
        raise DataError(f"The routes in '{folder}' have another length or score: drive them anew.")
    pairs = []
    for row in rows:
        path = route_file(folder, row["route"])
        other = read_object(path) if path.exists() else {}
        if all(other.get(name) == row[name] for name in ("town_seed", "seed")):
            pairs.append((row, other))
    if not pairs:
        raise DataError(f"'{folder}' holds none of these routes: use the same --seed.")
    ours, others = ([pair[i] for pair in pairs] for i in (0, 1))
    values = {
        key: np.array([_value(a, *key) - _value(b, *key) for a, b in pairs])
        for key in _keys(ours)
        if key in _keys(others)
    }
    return Difference(len(pairs), _means(values, np.array([row["town"] for row in ours])))


def _keys(rows: Sequence[Row]) -> list[tuple[str, str]]:
    """(section, name) of all numbers, in the order of the first route that has them."""
    found = {
        (section, name): None
        for row in rows
        for section in SECTIONS
        for name in row.get(section, ())
    }
    return sorted(found, key=lambda key: SECTIONS.index(key[0]))


def _value(row: Row, section: str, name: str) -> float:
    """NaN where a route does not have it."""
    value = row.get(section, {}).get(name)
    return math.nan if value is None else float(value)


def _means(values: Mapping[tuple[str, str], Any], towns: Any) -> Means:
    bootstrap = GroupBootstrap(towns)
    intervals = bootstrap.intervals(np.stack(list(values.values()), axis=1))
    means: Means = {section: {} for section in SECTIONS}
    for (section, name), interval in zip(values, intervals, strict=True):
        means[section][name] = interval
    return means


def _plain(means: Means) -> dict[str, Any]:
    """The names that summary.json has: `driving_score`, then sections."""
    plain = {
        section: {name: asdict(mean) for name, mean in one.items()}
        for section, one in means.items()
    }
    scores = plain.pop("scores")
    return {TOTAL: scores.pop(TOTAL), "sub_scores": scores, **plain}
