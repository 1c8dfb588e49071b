"""Cells of the tables: values with their intervals, spreads over seeds, paired differences."""

import math
from collections.abc import Callable, Sequence
from dataclasses import asdict
from typing import Any

import numpy as np
from run_queue import Record

from shoot.metrics.bootstrap import interval

# What records have scene by scene, so that differences of it can be paired.
PAIRED = {"top10": "top-10, points", "nll": "NLL, nats"}
_ONE_DIGIT = {"top5", "top10", "top20", "ece", "off_road_3s", "comfort"}


def paired(ours: Sequence[Record], theirs: Sequence[Record], metric: str) -> str:
    """Mean over runs of ours minus that of theirs, with its interval over scenes (or logs)."""
    scenes = theirs[0]["by_scene"]
    counts = [scene["num_samples"] for scene in scenes.values()]
    if any(
        [run["by_scene"][name]["num_samples"] for name in scenes] != counts
        for run in (*ours, *theirs)
    ):
        return "-"
    means = [
        np.mean([[run["by_scene"][name][metric] for name in scenes] for run in runs], axis=0)
        for runs in (ours, theirs)
    ]
    # Every sample stands for its scene's mean: the sums over scenes are the same.
    groups = [scene.get("log", name) for name, scene in scenes.items()]
    difference = interval(np.repeat(means[0] - means[1], counts), np.repeat(groups, counts))
    return value_cell(asdict(difference), metric, sign=True)


def spread(own: Sequence[Record], of: Callable[[Record], dict[str, Any]], metric: str) -> str:
    """Mean over seeds, the smallest and largest, and how far their intervals reach."""
    found = [of(record) for record in own]
    values = [interval["value"] for interval in found]
    if any(value is None for value in values):
        return "-"
    mean = sum(values) / len(values)
    bounds = [interval[end] for interval in found for end in ("low", "high")]
    known = [bound for bound in bounds if bound is not None]
    reach = {"value": mean, "low": min(known, default=None), "high": max(known, default=None)}
    text = value_cell(reach, metric)
    if len(values) == 1:
        return text
    seeds = f"({_number(min(values), metric)} to {_number(max(values), metric)})"
    return " ".join((text.split(" ")[0], seeds, *text.split(" ")[1:]))


def model_spread(own: Sequence[Record], metric: str) -> str:
    """`spread` of the planner itself, on all samples."""
    return spread(own, lambda record: record["methods"]["model"][metric], metric)


def value_cell(interval: dict[str, float | None] | None, metric: str, sign: bool = False) -> str:
    """The value with its bounds, where it has any."""
    if interval is None or interval["value"] is None:
        return "-"
    value = _number(interval["value"], metric, sign)
    low, high = interval["low"], interval["high"]
    if low is None or high is None or math.isnan(low):
        return value
    return f"{value} [{_number(low, metric, sign)}, {_number(high, metric, sign)}]"


def _number(value: float, metric: str, sign: bool = False) -> str:
    return f"{value:{'+' if sign else ''}.{1 if metric in _ONE_DIGIT else 2}f}"


def markdown(header: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """A table."""
    lines = [header, ["---"] * len(header), *rows]
    return "\n".join(f"| {' | '.join(cells)} |" for cells in lines)
