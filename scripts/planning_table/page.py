"""The tables of docs/results/, from the records of finished runs and nothing else."""

from collections.abc import Callable, Collection, Sequence
from pathlib import Path

from marked_page import fill_pages
from run_queue import Record

from planning_table.again import again_tables
from planning_table.cells import PAIRED, markdown, model_spread, paired, spread, value_cell
from planning_table.experiments import MAIN_METRICS, PAIRS, PLANNERS, RIVALS
from planning_table.records import bases_of

# Lang et al.'s PointPillars and the camera planner, on nuScenes (the paper's Table 6).
_PAPER = {
    "camera": "15.52 / 19.94 / 27.99",
    "lidar1": "19.27 / 28.88 / 41.93",
    "lidar10": "24.99 / 35.39 / 49.84",
}
_BASELINES = {
    "prior": "prior",
    "blind": "blind planner",
    "standing_still": "standing still",
    "speed_prior": "prior per speed *",
    "constant_velocity": "constant velocity *",
    "constant_velocity_with_prior": "constant velocity, with prior *",
    "constant_yaw_rate": "constant yaw rate *",
    "constant_yaw_rate_with_prior": "constant yaw rate, with prior *",
    "past_motion": "past motion (MLP) *",
}
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
_NOTHING = "No run of these is finished yet."
_SHORT = ("prior", "blind", "constant_velocity", "past_motion")
_CHANGED = {
    "top10": MAIN_METRICS["top10"],
    "nll": MAIN_METRICS["nll"],
    "min_ade_10": _FURTHER["min_ade_10"],
}


def write_tables(records: Sequence[Record], root: Path, again: Sequence[Record] = ()) -> None:
    """Put each table between the markers `table6-...` of the pages that show it.

    Args:
        records: Of the runs that the tables are about.
        root: Folder of README.md and docs/.
        again: Of the same runs, made a second time.

    Raises:
        DataError: If no page has a table's markers.
    """
    made = all_tables(records, again)
    fill_pages(root, {f"table6-{n}": text or _NOTHING for n, text in made.items()})


def all_tables(records: Sequence[Record], again: Sequence[Record] = ()) -> dict[str, str]:
    """Name to table, which is empty where no run for it is there."""
    runs = {name: [r for r in records if r["planner"] == name] for name in PLANNERS}
    runs = {name: own for name, own in runs.items() if own}
    of_runs: dict[str, Callable[[dict[str, list[Record]]], str]] = {
        "setting": _setting,
        "planners": _planning_table,
        "planners-short": lambda runs: _planning_table(runs, _SHORT),
        "baselines": _difference_table,
        "sensors": _planner_table,
        "further": _further_table,
        "parts": _part_table,
        "speed": _speed_table,
    }
    made = {name: make(runs) if runs else "" for name, make in of_runs.items()}
    rivals = {experiment.planner for experiment in RIVALS}
    made["changes"] = _change_table(records, lambda record: record["planner"] not in rivals)
    made["rivals"] = _change_table(records, lambda record: record["planner"] in rivals)
    return made | again_tables(records, again)


def _setting(runs: dict[str, list[Record]]) -> str:
    every = [record for own in runs.values() for record in own]
    one = every[0]
    world = one["world"]
    seeds = ", ".join(
        f"{PLANNERS[name]}: {', '.join(str(r['seed']) for r in own)}" for name, own in runs.items()
    )
    minutes = {name: sum(r["train_s"] for r in own) / len(own) / 60.0 for name, own in runs.items()}
    took = ", ".join(f"{PLANNERS[name]} {value:.0f}" for name, value in minutes.items())
    return (
        f"{world['train_scenes']} training scenes, {one['num_scenes']} validation scenes, "
        f"{one['num_samples']} validation samples; {one['steps']} steps of {one['batch_size']} "
        f"samples. Seeds: {seeds}. Minutes of training a run, {one['runs_side_by_side']} side by "
        f"side on {one['processor']}: {took}."
    )


def _planning_table(
    runs: dict[str, list[Record]], baselines: Collection[str] = tuple(_BASELINES)
) -> str:
    rows = []
    for name, own in runs.items():
        cells = [model_spread(own, metric) for metric in MAIN_METRICS]
        rows.append([f"**{PLANNERS[name]}**", *cells, _PAPER[name]])
    for name, label in _BASELINES.items():
        metrics = _first(runs)["methods"].get(name)
        if metrics and name in baselines:
            rows.append([label, *(value_cell(metrics[m], m) for m in MAIN_METRICS), ""])
    header = ["planner", *MAIN_METRICS.values(), "paper, nuScenes: top-5 / 10 / 20, %"]
    return markdown(header, rows)


def _difference_table(runs: dict[str, list[Record]]) -> str:
    rows = []
    for name, own in runs.items():
        for baseline in ("prior", "blind", "constant_velocity", "past_motion"):
            cells = []
            for metric, least in (("top10", min), ("nll", max)):
                worst = least(
                    (r["differences"][baseline][metric] for r in own), key=lambda d: d["value"]
                )
                cells.append(value_cell(worst, metric, sign=True))
            rows.append([PLANNERS[name], _BASELINES[baseline], *cells])
    return (
        "Planner minus baseline on the same samples, for the seed in which the planner does worst "
        "(paired 95 % intervals over scenes):\n\n"
        + markdown(["planner", "minus", *PAIRED.values()], rows)
    )


def _planner_table(runs: dict[str, list[Record]]) -> str:
    rows = []
    for less, more in PAIRS:
        if less in runs and more in runs:
            cells = [paired(runs[more], runs[less], metric) for metric in PAIRED]
            rows.append([PLANNERS[more], PLANNERS[less], *cells])
    if not rows:
        return ""
    return (
        "Planner minus planner on the same samples, means over seeds (paired 95 % intervals over "
        "scenes):\n\n" + markdown(["planner", "minus", *PAIRED.values()], rows)
    )


def _further_table(runs: dict[str, list[Record]]) -> str:
    shown = {m: label for m, label in _FURTHER.items() if m in _first(runs)["methods"]["model"]}
    rows = []
    for name, own in runs.items():
        rows.append([f"**{PLANNERS[name]}**", *(model_spread(own, metric) for metric in shown)])
    one = _first(runs)
    for name, label in _BASELINES.items():
        if name in one["methods"]:
            rows.append([label, *(value_cell(one["methods"][name].get(m), m) for m in shown)])
    rows.append(["nearest template", *(value_cell(_oracle(one, m), m) for m in shown)])
    rows.append(["the driver", *(value_cell(one["driver"].get(m), m) for m in shown)])
    return "Further figures, of the most probable template where one is chosen:\n\n" + markdown(
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
                spread(
                    own,
                    lambda r, k=kind, p=part: r[k][p]["methods"]["model"]["top10"],  # type: ignore[misc]
                    "top10",
                )
                for own in runs.values()
            ]
            baselines = [
                value_cell(first["methods"].get(m, {}).get("top10"), "top10")
                for m in ("prior", "speed_prior")
            ]
            rows.append([part, str(first["num_samples"]), *cells, *baselines])
    header = ["part", "samples", *(PLANNERS[name] for name in runs), "prior", "prior per speed *"]
    return "Top-10 in per cent, part by part:\n\n" + markdown(header, rows)


def _speed_table(runs: dict[str, list[Record]]) -> str:
    if "model_knowing_speed" not in _first(runs)["methods"]:
        return ""
    rows = []
    for name, own in runs.items():
        cells = []
        for metric in ("top10", "nll"):
            for method in ("model", "model_knowing_speed"):
                cells.append(
                    spread(own, lambda r, m=method, k=metric: r["methods"][m][k], metric)  # type: ignore[misc]
                )
        rows.append([PLANNERS[name], *cells])
    header = ["planner", "top-10, %", "told the speed", "NLL, nats", "told the speed"]
    return (
        "The same planners, and what they would be if told the car's speed afterwards (their "
        "probabilities times that of each template at this speed, over its probability at any):\n\n"
        + markdown(header, rows)
    )


def _change_table(records: Sequence[Record], is_shown: Callable[[Record], bool]) -> str:
    changed = [record for record in records if record["flags"] and is_shown(record)]
    rows = []
    for preset in dict.fromkeys(record["preset"] for record in changed):
        own = [record for record in changed if record["preset"] == preset]
        bases = bases_of(own[0], records)
        if bases:
            cells = [model_spread(bases, metric) for metric in _CHANGED]
            rows.append([f"`{bases[0]['planner']}`", *cells, "", ""])
        for record in own:
            cells = [model_spread([record], metric) for metric in _CHANGED]
            less = [paired([record], bases, m) if bases else "-" for m in PAIRED]
            rows.append([f"`{record['name']}` ({' '.join(record['flags'])})", *cells, *less])
    if not rows:
        return ""
    return (
        "One thing changed at a time, in one run each; changes are from the mean over the seeds of "
        "the same planner above it, paired over scenes. A single run lies as far from that mean as "
        "its seed takes it:\n\n"
        + markdown(["run", *_CHANGED.values(), "top-10, change", "NLL, change"], rows)
    )


def _first(runs: dict[str, list[Record]]) -> Record:
    return next(iter(runs.values()))[0]
