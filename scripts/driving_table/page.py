"""The tables of docs/results/closed_loop.md, from the records of drives and nothing else."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from marked_page import fill_pages
from planning_table.cells import markdown
from run_queue import Record

from driving_table.correlation import correlate
from driving_table.driven import Array, Driven, by_driver
from driving_table.drives import MODES, PLANNED
from driving_table.failings import FAILINGS
from driving_table.records import SCORES
from shoot.metrics.driving_score.route_scores import PROGRESS_AT_LEAST
from shoot.simulation.route_log import Mode

_NOTHING = "Nothing of this has been driven yet."
# Fact of shoot-simulate -> in words, and its digits.
_FACTS = {
    "collisions_at_fault": ("collisions at fault", 2),
    "red_lights": ("red lights run", 2),
    "off_road_m": ("off the road, m", 1),
    "against_m": ("in no lane, m", 1),
    "off_route_m": ("off the route, m", 1),
    "progress_m": ("progress, m", 0),
    "stuck_s": ("stuck, s", 1),
}
# Figure of shoot-evaluate -> in words, and 1 if high is good, -1 if low.
_FIGURES = {
    "top1": ("top-1", 1),
    "top10": ("top-10", 1),
    "nll": ("NLL", -1),
    "brier": ("Brier", -1),
    "expected_ade": ("expected ADE", -1),
    "min_ade_10": ("minADE_10", -1),
    "l2_upto_3s": ("L2 up to 3 s", -1),
    "l2_at_3s": ("L2 at 3 s", -1),
    "collision_3s": ("collision 3 s", -1),
    "off_road_3s": ("off-road 3 s", -1),
    "jerk_mps3": ("jerk", -1),
}
_PAIRS = (
    ("camera", "rule"),
    ("camera", "still"),
    ("camera", "prior"),
    ("camera", "prior-expected"),
    ("camera", "constant_velocity"),
    ("lidar1", "camera"),
    ("lidar10", "camera"),
    ("lidar10", "rule"),
    ("oracle", "rule"),
    ("camera-expected", "camera"),
    ("camera-free", "camera"),
    ("camera-free", "rule"),
    ("camera-free", "prior-expected-free"),
)
_MOVING = f"the same, 0 where EP is below {PROGRESS_AT_LEAST:g}"
# Fewer planners than this have no rank correlation worth the name.
_FEW = 4


def write_tables(records: Sequence[Record], root: Path) -> None:
    """Put each table between the markers `driving-...` of the pages that show it.

    Raises:
        DataError: If no page has a table's markers.
    """
    made = all_tables(records)
    fill_pages(root, {f"driving-{name}": text or _NOTHING for name, text in made.items()})


def all_tables(records: Sequence[Record]) -> dict[str, str]:
    """Name to table, which is empty where nothing for it has been driven."""
    of_modes = {mode: by_driver(records, mode) for mode in MODES}
    tables = {
        f"{name}-{mode}": make(drives) if drives else ""
        for name, make in (
            ("scores", _score_table),
            ("facts", _fact_table),
            ("failings", _failing_table),
        )
        for mode, drives in of_modes.items()
    }
    return tables | {
        "pairs": _pair_table(of_modes),
        "classes": "\n".join(f"- *{name}*: {one.words}." for name, one in FAILINGS.items()),
        "modes": _mode_table(of_modes),
        "open-loop": _correlation_table(of_modes),
    }


def _score_table(drives: Mapping[str, Driven]) -> str:
    sub_scores = SCORES[1:]
    rows = [
        [
            one.words,
            *(one.cell(values) for values in (one.scores, one.moving, one.bench2drive)),
            *(f"{np.nanmean(one.sub_scores(name)):.2f}" for name in sub_scores),
        ]
        for one in drives.values()
    ]
    names = (name.upper() for name in sub_scores)
    return markdown(["driver", "driving score", _MOVING, "Bench2Drive", *names], rows)


def _fact_table(drives: Mapping[str, Driven]) -> str:
    rows = []
    for one in drives.values():
        jumps_mps = one.jumps_mps
        jump = "" if np.isnan(jumps_mps).all() else f"{np.nanmean(jumps_mps):.2f}"
        facts = (f"{one.fact(name):.{digits}f}" for name, (_, digits) in _FACTS.items())
        rows.append([one.words, *facts, jump])
    words = (word for word, _ in _FACTS.values())
    return markdown(["driver", *words, "speed jumps, m/s"], rows)


def _failing_table(drives: Mapping[str, Driven]) -> str:
    """Per cent of routes, and the score of those on which nothing of it happened."""
    rows = []
    for one in drives.values():
        fails = {name: one.fails(name) for name in FAILINGS}
        none = ~np.any(list(fails.values()), axis=0)
        left = one.scores[none]
        rows.append([
            one.words,
            *(f"{100.0 * is_so.mean():.0f}" for is_so in fails.values()),
            f"{100.0 * none.mean():.0f}",
            f"{left.mean():.2f}" if len(left) else "",
        ])  # fmt: skip
    return markdown(["driver", *FAILINGS, "none of these", "driving score of these"], rows)


def _pair_table(of_modes: Mapping[Mode, Mapping[str, Driven]]) -> str:
    rows = []
    for mode, drives in of_modes.items():
        for ours, theirs in _PAIRS:
            if ours in drives and theirs in drives:
                a, b = _same_seeds(drives[ours], drives[theirs])
                pairs = (a.scores, b.scores), (a.moving, b.moving), (a.bench2drive, b.bench2drive)
                rows.append([mode, a.words, b.words, *(a.minus(*pair) for pair in pairs)])
    header = ["traffic", "driver", "minus", "driving score", _MOVING, "Bench2Drive"]
    return markdown(header, rows) if rows else ""


def _same_seeds(ours: Driven, theirs: Driven) -> tuple[Driven, Driven]:
    """Of a planner driven in two ways, the runs that were driven in both."""
    runs = [{record["run"] for record in one.records} for one in (ours, theirs)]
    both = runs[0] & runs[1] - {None}
    if not both:
        return ours, theirs
    kept = (tuple(r for r in one.records if r["run"] in both) for one in (ours, theirs))
    a, b = (replace(one, records=of) for one, of in zip((ours, theirs), kept, strict=True))
    return a, b


def _mode_table(of_modes: Mapping[Mode, Mapping[str, Driven]]) -> str:
    """Traffic that answers against traffic that does not, for the same drivers."""
    reactive, replay = (of_modes[mode] for mode in MODES)
    rows = []
    for who in reactive:
        if who in replay:
            a, b = _same_seeds(reactive[who], replay[who])
            hits = (f"{one.fact('collisions_at_fault'):.2f}" for one in (a, b))
            rows.append([a.words, a.minus(a.scores, b.scores), *hits])
    first, second = MODES
    header = [
        "driver", f"driving score, {first} minus {second}", f"collisions at fault, {first}", second,
    ]  # fmt: skip
    return markdown(header, rows) if rows else ""


def _correlation_table(of_modes: Mapping[Mode, Mapping[str, Driven]]) -> str:
    """Over runs of planners, seeds and siblings of all kinds."""
    planners = {drive.who for drive in PLANNED}
    header = ["open-loop figure"]
    columns: list[tuple[list[Driven], Callable[[Driven], Array]]] = []
    for mode, drives in of_modes.items():
        own = [one for one in drives.values() if one.who in planners]
        if len(own) >= _FEW:
            num = sum(len(one.records) for one in own)
            header += [f"driving score, {mode} (n = {num})", f"Bench2Drive, {mode}"]
            columns += [(own, lambda one: one.scores), (own, lambda one: one.bench2drive)]
    if not columns:
        return ""
    rows = []
    for key, (words, sign) in _FIGURES.items():
        cells = []
        for own, of in columns:
            runs = [record for one in own for record in one.records]
            found = correlate(
                [sign * record["open_loop"][key] for record in runs],
                np.concatenate([of(one) for one in own]),
                runs[0]["towns"],
                [record["who"] for record in runs],
            )
            cells.append(f"{found.value:+.2f} [{found.low:+.2f}, {found.high:+.2f}]")
        rows.append([words, *cells])
    return markdown(header, rows)
