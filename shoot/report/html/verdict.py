"""The page's first sentence: what the planner gets right, and which baselines it beats."""

import math
from collections.abc import Mapping, Sequence

from shoot.evaluation.results import KNOWING_SPEED, MODEL, Report
from shoot.metrics.bootstrap import Interval
from shoot.report.html.columns import TOP_10, Column
from shoot.report.html.words import bounds, has_bounds, listed, number, spaced, verdict

Metrics = Mapping[str, Interval]

_RELATIONS = {"better": "better than", "worse": "worse than", "": "not told apart from"}
# Of more than these a sentence says how many; which they are stands in the table.
_MOST_NAMED = 3


def verdict_sentence(report: Report) -> str:
    """In a sentence: the planner's top-10, that of the baselines, and which of them it beats.

    Better or worse is what the interval of the paired difference says; all else is not told apart.
    The planner that was told the speed is no baseline and is not named. A second sentence counts
    the scenes that were seen in training, if any.
    """
    overall = report.overall
    if MODEL not in overall.methods:
        return f"No method is called '{MODEL}', so there is no verdict."
    share = overall.methods[MODEL].get(TOP_10.key)
    if share is None or not math.isfinite(share.value):
        return f"The report has no {TOP_10.name.partition(',')[0]} of {MODEL}: no verdict."
    sentence = (
        "The planner ranks what the driver did among its ten best in "
        f"{_percent(share)} of {overall.num_samples} samples"
    )
    if has_bounds(share):
        sentence += f" {bounds(share, TOP_10.decimals)}"
    sentence += _others(overall.methods, _baselines(overall.differences, TOP_10))
    told = relations(overall.differences, TOP_10)
    if told and overall.num_groups < 2:
        one = report.resampled.removesuffix("s")
        sentence += f": of one {one} there is no interval, so which is better stays open"
    elif told:
        sentence += f": the planner is {told}"
    if report.num_seen_scenes:
        sentence += (
            f". Of these {overall.num_scenes} scenes, {report.num_seen_scenes} were seen in "
            "training"
        )
    return f"{sentence}."


def relations(differences: Mapping[str, Metrics], column: Column) -> str:
    """What the planner is better than, worse than, not told apart from; empty without baselines."""
    names = _baselines(differences, column)
    found: dict[str, list[str]] = {kind: [] for kind in _RELATIONS}
    for name in names:
        found[verdict(differences[name][column.key], column)].append(spaced(name))
    clauses = []
    for kind, members in found.items():
        if len(members) > _MOST_NAMED:
            clauses.append(f"{_RELATIONS[kind]} {len(members)} of {len(names)} baselines")
        elif members:
            clauses.append(f"{_RELATIONS[kind]} {listed(members)}")
    return "; ".join(clauses)


def _baselines(differences: Mapping[str, Metrics], column: Column) -> list[str]:
    """What the planner is compared with by this metric."""
    return [
        name
        for name, metrics in differences.items()
        if name != KNOWING_SPEED
        and column.key in metrics
        and math.isfinite(metrics[column.key].value)
    ]


def _others(methods: Mapping[str, Metrics], baselines: Sequence[str]) -> str:
    """Top-10 of the strongest baseline, and of the prior if that is another."""
    if not baselines:
        return ""
    strongest = max(baselines, key=lambda name: methods[name][TOP_10.key].value)
    which = "only" if len(baselines) == 1 else "strongest"
    text = (
        f"; {spaced(strongest)}, the {which} baseline, does so in "
        f"{_percent(methods[strongest][TOP_10.key])}"
    )
    if "prior" in baselines and strongest != "prior":
        text += f", prior in {_percent(methods['prior'][TOP_10.key])}"
    return text


def _percent(share: Interval) -> str:
    return f"{number(share.value, TOP_10.decimals)} %"
