"""Means, intervals and differences of results that are written by hand."""

import json
from pathlib import Path
from typing import Any

import pytest

from lss_core.errors import DataError
from lss_core.strict_json import save_json
from shoot.report.route_table import format_routes
from shoot.simulation.routes.orders import RouteOrder
from shoot.simulation.routes.result import failure_of
from shoot.simulation.routes.result_files import route_file, write_row
from shoot.simulation.routes.summary import sum_up

SETTINGS = {"driver": "run", "mode": "reactive", "score": "rules", "duration_s": 20.0}
NAMES = ("driving_score", "nc", "dac", "ddc", "tlc", "ep", "ttc", "lk", "hc", "ec")


def row(route: int, score: float, ec: float | None = 1.0, **facts: float) -> dict[str, Any]:
    return {
        **failure_of(RouteOrder(route, route // 2, 100 + route // 2, route), "reactive", ""),
        "error": None,
        "scores": {**dict.fromkeys(NAMES, score), "ec": ec},
        "facts": facts,
    }


def failure(route: int) -> dict[str, Any]:
    order = RouteOrder(route, route // 2, 100 + route // 2, route)
    return failure_of(order, "reactive", "It fell asleep.")


def write(folder: Path, rows: list[dict[str, Any]], **settings: Any) -> Path:
    save_json({**SETTINGS, **settings}, folder / "settings.json")
    for one in rows:
        write_row(route_file(folder, one["route"]), one)
    return folder


def test_a_failure_counts_in_scores_and_not_in_facts() -> None:
    summary = sum_up([row(0, 0.9, stuck_s=2.0), row(1, 0.6, stuck_s=4.0), failure(2)], SETTINGS)
    said = summary.to_json()
    assert said["driving_score"]["value"] == pytest.approx(0.5)
    assert said["facts"]["stuck_s"]["value"] == pytest.approx(3.0)
    assert said["failures"] == {"2": "It fell asleep."}
    assert (said["num_routes"], said["num_towns"]) == (3, 2)


def test_what_a_route_does_not_have_is_left_out() -> None:
    said = sum_up([row(0, 1.0, ec=None), row(1, 1.0, ec=0.5)], SETTINGS).to_json()
    assert said["sub_scores"]["ec"]["value"] == 0.5


def test_intervals_are_over_towns() -> None:
    """Four routes of two towns, each town of one mind: draws have means of 0, 1/2 and 1."""
    rows = [row(0, 0.0), row(1, 0.0), row(2, 1.0), row(3, 1.0)]
    total = sum_up(rows, SETTINGS).means["scores"]["driving_score"]
    assert (total.low, total.value, total.high) == (0.0, 0.5, 1.0)


def test_summary_has_the_names_that_are_fixed(tmp_path: Path) -> None:
    sum_up([row(0, 0.9), row(2, 0.7)], SETTINGS).save(tmp_path)
    said = json.loads((tmp_path / "summary.json").read_text())
    assert (said["driver"], said["mode"], said["num_routes"]) == ("run", "reactive", 2)
    assert set(said["driving_score"]) == {"value", "low", "high"}
    assert tuple(said["sub_scores"]) == NAMES[1:]
    sum_up([row(0, 0.9)], SETTINGS).save(tmp_path)
    alone = json.loads((tmp_path / "summary.json").read_text())["driving_score"]
    assert alone == {"value": 0.9, "low": None, "high": None}


def test_differences_are_on_the_routes_of_both(tmp_path: Path) -> None:
    beside = write(tmp_path / "rule", [row(0, 1.0), row(1, 1.0), row(3, 0.0)])
    rows = [row(0, 0.5), row(2, 0.9), row(3, 0.1)]
    summary = sum_up(rows, SETTINGS, [beside])
    difference = summary.differences["rule"]
    assert difference.num_routes == 2
    assert difference.means["scores"]["driving_score"].value == pytest.approx((-0.5 + 0.1) / 2)
    text = format_routes(summary)
    assert max(len(line) for line in text.splitlines()) <= 80
    assert "-0.200" in text
    assert "minus" in text


def test_other_routes_are_not_compared(tmp_path: Path) -> None:
    rows = [row(0, 0.5)]
    with pytest.raises(DataError, match="same --seed"):
        sum_up(rows, SETTINGS, [write(tmp_path / "a", [{**row(0, 1.0), "seed": 5}])])
    with pytest.raises(DataError, match="another length"):
        sum_up(rows, SETTINGS, [write(tmp_path / "b", [row(0, 1.0)], duration_s=10.0)])
    with pytest.raises(DataError, match="cannot be read"):
        sum_up(rows, SETTINGS, [tmp_path / "nowhere"])
    twice = [write(tmp_path / name / "c", [row(0, 1.0)]) for name in ("x", "y")]
    with pytest.raises(DataError, match="names of their own"):
        sum_up(rows, SETTINGS, twice)


def test_the_table_names_failures() -> None:
    text = format_routes(sum_up([row(0, 0.9), *map(failure, range(1, 9))], SETTINGS))
    assert "Route 1 failed and counts 0: It fell asleep." in text
    assert "8 routes failed in all." in text
    assert "not comparable with NAVSIM" in text
