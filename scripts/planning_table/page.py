"""The tables of docs/results.md, from the records of finished runs and nothing else."""

from collections.abc import Callable, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
from marked_page import fill_page

from planning_table.records import Record
from shoot.bootstrap import interval

# Lang et al.'s PointPillars and the camera planner, on nuScenes (the paper's Table 6).
_PAPER = {
    "camera": "15.52 / 19.94 / 27.99",
    "lidar1": "19.27 / 28.88 / 41.93",
    "lidar10": "24.99 / 35.39 / 49.84",
}
_PLANNERS = {"camera": "camera", "lidar1": "lidar, 1 scan", "lidar10": "lidar, 10 scans"}
_BASELINES = {
    "prior": "prior",
    "blind": "blind planner",
    "standing_still": "standing still",
    "speed_prior": "prior per speed *",
    "constant_velocity": "constant velocity *",
    "constant_yaw_rate": "constant yaw rate *",
    "past_motion": "past motion (MLP) *",
}
_MAIN = {"top5": "top-5, %", "top10": "top-10, %", "top20": "top-20, %", "nll": "NLL, nats"}
_FURTHER = {
    "ece": "ECE, %",
    "brier": "Brier",
    "expected_ade": "expected ADE, m",
    "min_ade_10": "minADE_10, m",
    "l2_upto_3s": "L2 up to 3 s, m",
    "l2_at_3s": "L2 at 3 s, m",
    "collision_3s": "collision 3 s, %",
    "off_road_3s": "off-road 3 s, %",
    "comfort": "comfort, %",
}
_ONE_DIGIT = {"top5", "top10", "top20", "ece", "off_road_3s", "comfort"}


def write_tables(records: Sequence[Record], page: Path) -> None:
    """Put the tables between the page's markers.

    Raises:
        DataError: If the page has no markers.
    """
    made = "\n\n".join(part for part in _tables(records) if part)
    fill_page(page, "table6", made)


def _tables(records: Sequence[Record]) -> list[str]:
    runs = {name: [r for r in records if r["planner"] == name] for name in _PLANNERS}
    runs = {name: own for name, own in runs.items() if own}
    if not runs:
        return ["No run is finished yet."]
    return [
        _setting(runs),
        _planning_table(runs),
        _difference_table(runs),
        _planner_table(runs),
        _further_table(runs),
        _part_table(runs),
        _speed_table(runs),
        _limit_table(records),
    ]


def _setting(runs: dict[str, list[Record]]) -> str:
    every = [record for own in runs.values() for record in own]
    one = every[0]
    world = one["world"]
    seeds = ", ".join(
        f"{_PLANNERS[name]}: {', '.join(str(r['seed']) for r in own)}" for name, own in runs.items()
    )
    minutes = {name: sum(r["train_s"] for r in own) / len(own) / 60.0 for name, own in runs.items()}
    took = ", ".join(f"{_PLANNERS[name]} {value:.0f}" for name, value in minutes.items())
    return (
        f"{world['train_scenes']} training scenes, {one['num_scenes']} validation scenes, "
        f"{one['num_samples']} validation samples; {one['steps']} steps of {one['batch_size']} "
        f"samples. Seeds: {seeds}. Minutes of training a run, {one['runs_side_by_side']} side by "
        f"side on {one['processor']}: {took}."
    )


def _planning_table(runs: dict[str, list[Record]]) -> str:
    rows = []
    for name, own in runs.items():
        cells = [
            _spread(own, lambda r, m=m: r["methods"]["model"][m], m)  # type: ignore[misc]
            for m in _MAIN
        ]
        rows.append([f"**{_PLANNERS[name]}**", *cells, _PAPER[name]])
    one = next(iter(runs.values()))[0]
    for name, label in _BASELINES.items():
        if name in one["methods"]:
            metrics = one["methods"][name]
            rows.append([label, *(_interval(metrics[m], m) for m in _MAIN), ""])
    header = ["planner", *_MAIN.values(), "paper, nuScenes: top-5 / 10 / 20, %"]
    return (
        "Planners: mean over seeds (smallest to largest) [95 % intervals over scenes, from the "
        "lowest end of any seed's to the highest]. Baselines: value [95 % interval]; those with a "
        "* know the car's own motion, which no image shows. The same in all tables.\n\n"
        + _markdown(header, rows)
    )


def _difference_table(runs: dict[str, list[Record]]) -> str:
    rows = []
    for name, own in runs.items():
        for baseline in ("prior", "blind", "constant_velocity", "past_motion"):
            cells = []
            for metric, least in (("top10", min), ("nll", max)):
                worst = least(
                    (r["differences"][baseline][metric] for r in own), key=lambda d: d["value"]
                )
                cells.append(_interval(worst, metric, sign=True))
            rows.append([_PLANNERS[name], _BASELINES[baseline], *cells])
    return (
        "Planner minus baseline on the same samples, for the seed in which the planner does worst "
        "(paired 95 % intervals over scenes):\n\n"
        + _markdown(["planner", "minus", "top-10, points", "NLL, nats"], rows)
    )


def _planner_table(runs: dict[str, list[Record]]) -> str:
    rows = []
    for less, more in (("camera", "lidar1"), ("camera", "lidar10"), ("lidar1", "lidar10")):
        if less in runs and more in runs:
            cells = [_paired(runs[more], runs[less], metric) for metric in ("top10", "nll")]
            rows.append([_PLANNERS[more], _PLANNERS[less], *cells])
    if not rows:
        return ""
    return (
        "Planner minus planner on the same samples, means over seeds (paired 95 % intervals over "
        "scenes):\n\n" + _markdown(["planner", "minus", "top-10, points", "NLL, nats"], rows)
    )


def _further_table(runs: dict[str, list[Record]]) -> str:
    shown = {m: label for m, label in _FURTHER.items() if m in _first(runs)["methods"]["model"]}
    rows = []
    for name, own in runs.items():
        rows.append(
            [f"**{_PLANNERS[name]}**"]
            + [_spread(own, lambda r, m=m: r["methods"]["model"][m], m) for m in shown]  # type: ignore[misc]
        )
    one = _first(runs)
    for name, label in _BASELINES.items():
        if name in one["methods"]:
            rows.append([label, *(_interval(one["methods"][name].get(m), m) for m in shown)])
    rows.append(["nearest template", *(_interval(_oracle(one, m), m) for m in shown)])
    rows.append(["the driver", *(_interval(one["driver"].get(m), m) for m in shown)])
    return "Further figures, of the most probable template where one is chosen:\n\n" + _markdown(
        ["planner", *shown.values()], rows
    )


def _oracle(record: Record, metric: str) -> dict[str, float | None] | None:
    """An always-right planner chooses one template: its ADE is its minADE, too."""
    key = {"min_ade_10": "ade"}.get(metric, metric)
    found: dict[str, float | None] | None = record["oracle"].get(key)
    return found


def _part_table(runs: dict[str, list[Record]]) -> str:
    rows = []
    one = _first(runs)
    for kind in ("by_manoeuvre", "by_speed", "by_condition"):
        for part, first in one[kind].items():
            cells = [
                _spread(
                    own,
                    lambda r, k=kind, p=part: r[k][p]["methods"]["model"]["top10"],  # type: ignore[misc]
                    "top10",
                )
                for own in runs.values()
            ]
            baselines = [
                _interval(first["methods"].get(m, {}).get("top10"), "top10")
                for m in ("prior", "speed_prior")
            ]
            rows.append([part, str(first["num_samples"]), *cells, *baselines])
    header = ["part", "samples", *(_PLANNERS[name] for name in runs), "prior", "prior per speed *"]
    return "Top-10 in per cent, part by part:\n\n" + _markdown(header, rows)


def _speed_table(runs: dict[str, list[Record]]) -> str:
    if "model_knowing_speed" not in _first(runs)["methods"]:
        return ""
    rows = []
    for name, own in runs.items():
        cells = []
        for metric in ("top10", "nll"):
            for method in ("model", "model_knowing_speed"):
                cells.append(
                    _spread(own, lambda r, m=method, k=metric: r["methods"][m][k], metric)  # type: ignore[misc]
                )
        rows.append([_PLANNERS[name], *cells])
    header = ["planner", "top-10, %", "told the speed", "NLL, nats", "told the speed"]
    return (
        "The same planners, and what they would be if told the car's speed afterwards (their "
        "probabilities times that of each template at this speed, over its probability at any):\n\n"
        + _markdown(header, rows)
    )


def _limit_table(records: Sequence[Record]) -> str:
    changed = {record["preset"] for record in records if record["flags"]}
    first = {r["preset"]: r for r in records if not r["flags"] and r["seed"] == 0}
    rows = []
    for record in (r for r in records if r["preset"] in changed):
        model = record["methods"]["model"]
        cells = [_interval(model[m], m) for m in ("top10", "nll", "min_ade_10")]
        if record["flags"] and record["preset"] in first:
            base = [first[record["preset"]]]
            less = [_paired([record], base, metric) for metric in ("top10", "nll")]
            rows.append([f"`{record['name']}` ({' '.join(record['flags'])})", *cells, *less])
        elif not record["flags"] and record["seed"] == 0:
            rows.append([f"`{record['name']}`", *cells, "", ""])
    if not changed:
        return ""
    header = ["run", "top-10, %", "NLL, nats", "minADE_10, m", "top-10, change", "NLL, change"]
    return (
        "One thing changed at a time, seed 0; changes are paired with the same planner's run above "
        "it. Three seeds of one planner differ by as much as the first table says:\n\n"
        + _markdown(header, rows)
    )


def _paired(ours: Sequence[Record], theirs: Sequence[Record], metric: str) -> str:
    """Mean over runs of ours minus that of theirs, with its interval over scenes."""
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
    difference = interval(
        np.repeat(means[0] - means[1], counts), np.repeat(np.arange(len(counts)), counts)
    )
    return _interval(asdict(difference), metric, sign=True)


def _first(runs: dict[str, list[Record]]) -> Record:
    return next(iter(runs.values()))[0]


def _spread(own: Sequence[Record], of: Callable[[Record], dict[str, Any]], metric: str) -> str:
    """Mean over seeds, the smallest and largest, and how far their intervals reach."""
    found = [of(record) for record in own]
    values = [interval["value"] for interval in found]
    if any(value is None for value in values):
        return "-"
    mean = sum(values) / len(values)
    bounds = [interval[end] for interval in found for end in ("low", "high")]
    known = [bound for bound in bounds if bound is not None]
    reach = {"value": mean, "low": min(known, default=None), "high": max(known, default=None)}
    text = _interval(reach, metric)
    if len(values) == 1:
        return text
    seeds = f"({_number(min(values), metric)} to {_number(max(values), metric)})"
    return " ".join((text.split(" ")[0], seeds, *text.split(" ")[1:]))


def _interval(interval: dict[str, float | None] | None, metric: str, sign: bool = False) -> str:
    """The value with its bounds, where it has any."""
    if interval is None or interval["value"] is None:
        return "-"
    value = _number(interval["value"], metric, sign)
    low, high = interval["low"], interval["high"]
    if low is None or high is None:
        return value
    return f"{value} [{_number(low, metric, sign)}, {_number(high, metric, sign)}]"


def _number(value: float, metric: str, sign: bool = False) -> str:
    return f"{value:{'+' if sign else ''}.{1 if metric in _ONE_DIGIT else 2}f}"


def _markdown(header: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    lines = [header, ["---"] * len(header), *rows]
    return "\n".join(f"| {' | '.join(cells)} |" for cells in lines)
