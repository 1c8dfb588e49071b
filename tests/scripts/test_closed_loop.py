"""The closed-loop study: classes of failing, rank correlations, and tables of records alone."""

import importlib
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from world_fixture import TinyRun

from shoot.templates import TemplateSet

ROOT = Path(__file__).parents[2]
TABLES = ("scores", "facts", "failings")


@pytest.fixture
def scripts(monkeypatch: pytest.MonkeyPatch) -> Any:
    """Finds a module of scripts/ by name."""
    monkeypatch.syspath_prepend(ROOT / "scripts")
    return importlib.import_module


class _Templates:
    """One that stands, and one that drives straight on at 6 m/s."""

    dt_s = 0.25
    points = np.stack([np.zeros((20, 2)), np.stack([1.5 * np.arange(1, 21), np.zeros(20)], 1)])


def route(chosen: list[int], speed_mps: float = 6.0, ep: float = 1.0, **facts: float) -> Any:
    """A result, as shoot-simulate writes it, of who drove at one speed."""
    none = dict.fromkeys(
        ("stuck_s", "off_route_m", "off_road_m", "against_m", "red_lights", "collisions_at_fault"),
        0.0,
    )
    return {
        "scores": {"ep": ep},
        "facts": none | facts,
        "ego": {"dt_s": 0.1, "speed_mps": [speed_mps] * 200},
        "plans": {
            "time_s": [2.0 + 0.5 * i for i in range(len(chosen))],
            "template": chosen,
        },
    }


@pytest.mark.parametrize(
    ("made", "expected"),
    [
        (route([1, 1, 1]), set()),
        (route([1, 0, 1]), {"forgets its speed"}),
        (route([1, 1], speed_mps=2.1), set()),
        (route([1], off_route_m=2.0, off_road_m=9.0), {"turns off"}),
        (route([1], off_route_m=1.9, off_road_m=1.0, against_m=1.0), {"drifts"}),
        (route([1], ep=0.5), {"creeps"}),
        (route([1], ep=0.51), set()),
        (route([1], ep=0.1, stuck_s=2.0), {"freezes"}),
        (route([1], ep=0.1, off_route_m=50.0), {"turns off"}),
        (route([1], red_lights=1, collisions_at_fault=2), {"runs a red light", "hits"}),
    ],
)
def test_a_route_fails_in_the_classes_it_is_measured_for(
    scripts: Any, made: Any, expected: set[str]
) -> None:
    failings = scripts("driving_table.failings")
    clear = failings.failings_of(made, failings.speed_jumps_mps(made, _Templates()))
    assert {name for name in clear if clear[name] >= failings.FAILINGS[name].bound} == expected


def test_who_plans_no_templates_cannot_forget_its_speed(scripts: Any) -> None:
    failings = scripts("driving_table.failings")
    jumps_mps = failings.speed_jumps_mps(route([1]) | {"plans": {"template": [None]}}, _Templates())
    assert np.isnan(failings.failings_of(route([1]), jumps_mps)["forgets its speed"])


def test_the_first_camera_planner_is_the_shipped_one(
    scripts: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(ROOT)
    script, first = scripts("closed_loop"), scripts("planning_table.experiments").TABLE[0]
    shipped = script._folder_of(first, script.StudyConfig(tmp_path))
    templates = TemplateSet.load(shipped / "templates.npz")
    assert script._report_of(shipped)["templates_sha256"] == templates.sha256
    others = (drive.run for drive in script.STUDY if drive.run not in (None, first))
    assert not any(script._folder_of(run, script.StudyConfig(tmp_path)) for run in others)


def test_ranks_agree_as_spearman_says(scripts: Any) -> None:
    correlation = scripts("driving_table.correlation")
    x, y = np.array([1.0, 2.0, 3.0, 4.0, 5.0]), np.array([1.0, 10.0, 3.0, 50.0, 4.0])
    # Sum of squared differences of ranks: 0 + 4 + 1 + 1 + 4 = 10, so 1 - 6 * 10 / (5 * 24).
    assert correlation.rank_correlation(x, y) == pytest.approx(0.5)
    assert correlation.rank_correlation(x, -np.exp(x)) == pytest.approx(-1.0)
    assert np.isnan(correlation.rank_correlation(x, np.ones(5)))


def test_the_interval_is_wide_where_planners_or_towns_disagree(scripts: Any) -> None:
    correlate = scripts("driving_table.correlation").correlate
    figures, groups = [1.0, 2.0, 3.0, 4.0, 5.0], list("abcde")
    towns = [0, 0, 1, 1, 2, 2]
    same = np.outer(figures, np.ones(6))
    sure = correlate(figures, same, towns, groups, 200)
    assert (sure.value, sure.high) == pytest.approx((1.0, 1.0))
    assert sure.low > 0.99
    # In one town the order is the other way round.
    torn = np.where(np.array(towns) == 2, -2.5 * same, same)
    unsure = correlate(figures, torn, towns, groups, 200)
    assert unsure.low < 0.0 < unsure.high
    # Seeds of one planner are drawn together: some draws are of this planner alone, whose own order
    # is the other way round.
    turned = np.outer([4.0, 3.0, 2.0, 1.0, 5.0], np.ones(6))
    together = correlate(figures, turned, towns, ["a", "a", "a", "a", "b"], 200)
    assert together.low == pytest.approx(-1.0)
    assert correlate(figures, turned, towns, groups, 200).value == pytest.approx(together.value)


def record(scripts: Any, drive: Any, mode: str, level: float) -> dict[str, Any]:
    """Of four routes in two towns."""
    page, records = scripts("driving_table.page"), scripts("driving_table.records")
    spread = [level, level, level - 0.1, level + 0.1]
    facts = {name: {"value": level} for name in page._FACTS}
    figures = dict.fromkeys(page._FIGURES, level)
    failings = scripts("driving_table.failings").FAILINGS
    is_run = drive.driver == "run"
    return {
        "name": f"{drive.name}-{mode}", "who": drive.who, "mode": mode, "means": facts,
        "run": None if drive.run is None else drive.run.name, "towns": [0, 0, 1, 1],
        "scores": dict.fromkeys(records.SCORES, spread), "bench2drive": spread,
        records.JUMP: [0.5] * 4 if is_run else [None] * 4,
        "failings": {name: [0.0, 0.0, 0.0, 9.0] for name in failings},
        "open_loop": figures if is_run else None,
    }  # fmt: skip


def test_tables_say_what_the_records_say(scripts: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    drives, page = scripts("driving_table.drives"), scripts("driving_table.page")
    monkeypatch.setattr(page, "correlate", partial(page.correlate, num_draws=20))
    empty = page.all_tables([])
    assert empty.pop("classes")  # says what is measured, not what came out
    assert not any(empty.values())
    records = [
        record(scripts, drive, mode, 0.9 - 0.01 * place - (0.1 if mode == "replay" else 0.0))
        for place, drive in enumerate(drives.STUDY)
        for mode in drives.MODES
    ]
    assert len({made["name"] for made in records}) == len(records) == 2 * len(drives.STUDY)
    tables = page.all_tables(records)
    assert all(tables.values())
    whole = {name: text.splitlines()[2:] for name, text in tables.items()}
    drivers = dict.fromkeys(drive.who for drive in drives.STUDY)
    for name in TABLES:
        assert len(whole[f"{name}-reactive"]) == len(drivers)
    assert whole["scores-reactive"][0].startswith("| rule driver | 0.900 [0.900, 0.900] |")
    # Three seeds of the camera planner, the first three places apart: 0.84, 0.81, 0.78.
    assert any("| camera | 0.810 (0.780 to 0.840)" in row for row in whole["scores-reactive"])
    assert all("+0.100 [+0.100, +0.100]" in row for row in whole["modes"])
    assert any(row.startswith("| reactive | camera | rule driver |") for row in whole["pairs"])
    # Here every figure falls as the score does.
    assert all("+1.00" in row or "-1.00" in row for row in whole["open-loop"])


def test_the_page_holds_what_the_records_say(scripts: Any) -> None:
    results = ROOT / "docs" / "results"
    records = scripts("run_queue").load_records(results / "closed_loop")
    text = (results / "closed_loop.md").read_text(encoding="utf-8")
    for name, table in scripts("driving_table.page").all_tables(records).items():
        held = table or "Nothing of this has been driven yet."
        assert f"<!-- driving-{name} -->\n\n{held}\n\n<!-- /driving-{name} -->" in text, name


@pytest.mark.slow
def test_a_trained_run_is_driven_once_and_put_on_the_page(
    scripts: Any, tiny_run: TinyRun, tmp_path: Path
) -> None:
    page = tmp_path / "docs" / "results" / "closed_loop.md"
    page.parent.mkdir(parents=True)
    names = scripts("driving_table.page").all_tables([])
    page.write_text("".join(f"<!-- driving-{n} -->\n<!-- /driving-{n} -->\n" for n in names))
    folder = tmp_path / "runs"
    folder.mkdir()
    (folder / "camera-0").symlink_to(tiny_run.folder)
    script = scripts("closed_loop")
    config = script.StudyConfig(
        folder, ("prior", "lidar1"), ("replay",), routes=2, duration_s=4.0, workers=1,
        records=tmp_path / "records", pages=tmp_path,
    )  # fmt: skip
    missing = script.closed_loop(config)
    assert missing == [f"lidar1-{seed}" for seed in range(3)]
    (found,) = scripts("run_queue").load_records(tmp_path / "records")
    assert found["name"] == "prior-replay"
    assert len(found["scores"]["driving_score"]) == 2
    assert "| prior |" in page.read_text()
    before = (folder / "driven" / "prior-replay" / "summary.json").stat().st_mtime_ns
    script.closed_loop(config)
    assert (folder / "driven" / "prior-replay" / "summary.json").stat().st_mtime_ns == before
