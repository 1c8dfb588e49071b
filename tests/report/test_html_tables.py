"""The tables of the page: every number of the report stands in its row, below its header."""

import math
import re

import numpy as np
import pytest
from html_fixture import KEYS, METHODS, Node, make_report, page_of, rows_of, section_of

from shoot.evaluation.report import evaluate
from shoot.evaluation.results import Report
from shoot.metrics.bootstrap import Interval
from shoot.report.html.columns import GROUPS, MAIN, NLL, TOP_10, Column
from shoot.report.html.words import DASH, bounds, number, verdict

COLUMNS = {
    column.key: column for columns in (MAIN, *(g.columns for g in GROUPS)) for column in columns
}


@pytest.fixture(scope="module")
def report() -> Report:
    return make_report()


@pytest.fixture(scope="module")
def page(report: Report) -> Node:
    return page_of(report)


@pytest.mark.parametrize("method", METHODS)
def test_every_metric_of_every_method_stands_in_its_row_with_its_interval(
    report: Report, page: Node, method: str
) -> None:
    rows = rows_of(page, method.replace("_", " "), "method")
    lines = [line for row in rows for line in row.lines]
    for key, interval in report.overall.methods[method].items():
        decimals = COLUMNS[key].decimals
        assert number(interval.value, decimals) in lines, key
        assert bounds(interval, decimals) in lines, key


@pytest.mark.parametrize("method", METHODS[1:])
def test_every_difference_stands_in_its_row_with_its_sign(
    report: Report, page: Node, method: str
) -> None:
    rows = rows_of(page, method.replace("_", " "), "model minus")
    lines = [line for row in rows for line in row.lines]
    for key, interval in report.overall.differences[method].items():
        assert number(interval.value, COLUMNS[key].decimals, signed=True) in lines, key
        assert f"+{interval.value:.{COLUMNS[key].decimals}f}" in lines, key


def test_driver_and_oracle_have_rows_of_their_own(report: Report, page: Node) -> None:
    driver = [line for row in rows_of(page, "driven path") for line in row.lines]
    for key, interval in report.overall.driver.items():
        assert number(interval.value, COLUMNS[key].decimals) in driver, key
    (oracle,) = rows_of(page, "nearest template")
    cells = [cell.lines[0] for cell in oracle.all("td")]
    at_one = [cells[0], cells[4], cells[8]]  # k = 1 of minADE, minFDE and misses
    assert at_one == [
        number(report.overall.oracle["ade"].value, 2),
        number(report.overall.oracle["fde"].value, 2),
        number(report.overall.oracle["miss_rate"].value, 1),
    ]


def test_headers_stand_above_their_numbers(report: Report, page: Node) -> None:
    """Each row is as wide as the header, and the columns are in the header's order."""
    for table in page.all("table"):
        upper, *lower = table.all("thead")[0].all("tr")
        width = sum(int(th.attributes.get("colspan") or 1) for th in upper.all("th"))
        for row in table.all("tbody")[0].all("tr"):
            assert len(row.all("td", "th")) == width
        spans = [
            int(th.attributes["colspan"]) for th in upper.all("th") if "colspan" in th.attributes
        ]  # type: ignore[arg-type]
        assert sum(spans) == sum(len(line.all("th")) for line in lower)
    ranking = section_of(page, "methods").all("table")[0]
    assert [th.text for th in ranking.all("th")[:7]] == [
        "method", "Top-k, %", "NLL, nats", "k = 1", "k = 5", "k = 10", "k = 20",
    ]  # fmt: skip
    model = rows_of(ranking, "model")[0]
    metrics = report.overall.methods["model"]
    assert [cell.lines[0] for cell in model.all("td")] == [
        *(f"{metrics[f'top{k}'].value:.1f}" for k in (1, 5, 10, 20)),
        f"{metrics['nll'].value:.2f}",
    ]


def test_every_part_is_there_with_every_method(report: Report, page: Node) -> None:
    for parts in (report.by_manoeuvre, report.by_condition, report.by_speed):
        for name, results in parts.items():
            (row,) = rows_of(page, name)
            assert [cell.text for cell in row.all("td")[:2]] == ["12", "3"]
            values = [cell.lines[0] for cell in row.all("td")[2:]]
            assert values == [
                text
                for metrics in results.methods.values()
                for text in (number(metrics["top10"].value, 1), number(metrics["nll"].value, 2))
            ]


def test_a_metric_no_table_knows_is_not_lost() -> None:
    page = page_of(make_report(keys=(*KEYS, "energy_score")))
    (table,) = [
        t for t in page.all("table") if "energy_score" in t.text and not t.text.count("minus")
    ]
    assert len(rows_of(table, "model")) == 1
    assert DASH not in rows_of(table, "model")[0].text


def test_what_is_missing_or_no_number_is_a_dash() -> None:
    report = make_report(keys=("top1", "top10", "nll", "min_ade_1"))
    nan = float("nan")
    report.overall.methods["prior"]["nll"] = Interval(nan, nan, nan)
    page = page_of(report)
    ranking = section_of(page, "methods").all("table")[0]
    metrics = report.overall.methods["prior"]
    texts = [cell.lines[0] for cell in rows_of(ranking, "prior")[0].all("td")]
    assert texts == [
        f"{metrics['top1'].value:.1f}",
        DASH,
        f"{metrics['top10'].value:.1f}",
        DASH,
        DASH,
    ]
    assert not re.search(r"\b(nan|inf|None)\b", " ".join(page.lines))


def test_a_report_of_todays_evaluation_makes_a_page() -> None:
    """Without driver, speeds and reliability, or with them: whatever `evaluate` gives."""
    generator = np.random.default_rng(0)
    templates = generator.normal(size=(6, 20, 2)).cumsum(axis=1).astype(np.float32)
    labels = generator.integers(0, 6, 12)
    more = {"speed_mps": np.linspace(0.0, 12.0, 12)}
    known = evaluate.__annotations__
    report = evaluate(
        {"model": np.full((12, 6), -np.log(6.0)), "prior": np.full(6, -np.log(6.0))},
        labels,
        templates[labels],
        templates,
        np.repeat([0, 1, 2], 4),
        ["day"] * 12,
        "val",
        **{name: value for name, value in more.items() if name in known},  # type: ignore[arg-type]
    )
    page = page_of(report)
    assert "1.79" in [line for row in rows_of(page, "model") for line in row.lines]


def test_times_that_no_template_has_stand_nowhere() -> None:
    keys = ("top10", "nll", "l2_at_1s", "l2_at_2s", "collision_1s", "collision_2s")
    labels = {cell.text for cell in page_of(make_report(keys=keys)).all("th")}
    assert {"1 s", "2 s"} <= labels
    assert not {"3 s", "5 s"} & labels


def test_one_scene_shows_means_without_intervals() -> None:
    page = page_of(make_report(has_bounds=False))
    assert not [node for node in page if node.attributes.get("class") in ("range", "verdict")]
    assert not [node for row in page.all("tr") for node in row.all("strong")]
    assert "one scene only" in page.text
    assert len(rows_of(page, "model")) > 3


@pytest.mark.parametrize(
    ("column", "interval", "said"),
    [
        (TOP_10, Interval(3.0, 1.0, 5.0), "better"),
        (TOP_10, Interval(-3.0, -5.0, -1.0), "worse"),
        (NLL, Interval(-3.0, -5.0, -1.0), "better"),
        (NLL, Interval(3.0, 1.0, 5.0), "worse"),
        (NLL, Interval(3.0, -1.0, 5.0), ""),
        (NLL, Interval(3.0, float("nan"), float("nan")), ""),
        (Column("x", "x", high_is_good=None), Interval(3.0, 1.0, 5.0), ""),
    ],
)
def test_verdict_follows_the_good_end(column: Column, interval: Interval, said: str) -> None:
    assert verdict(interval, column) == said


def test_bold_is_what_excludes_zero_and_only_that() -> None:
    report = make_report()
    differences = report.overall.differences["prior"]
    differences["top10"] = Interval(4.0, -1.0, 9.0)
    differences["nll"] = Interval(-0.5, -0.75, -0.25)
    page = page_of(report)
    row = rows_of(page, "prior", "model minus")[0]
    top10, nll = row.all("td")[2], row.all("td")[4]
    assert top10.lines == ["+4.0", "[−1.0, +9.0]"]
    assert not top10.all("strong")
    assert nll.lines == ["−0.50", "[−0.75, −0.25]", "better"]
    assert nll.all("strong")[0].text == "−0.50"
    assert "In NLL the planner is better than prior; worse than constant velocity." in page.text
    # The short table above says the same.
    (short,) = (row for row in page.all("table")[0].all("tr") if row.all("th")[0].text == "prior")
    assert [cell.lines for cell in short.all("td")][1::2] == [top10.lines, nll.lines]


@pytest.mark.parametrize(
    ("value", "decimals", "plain", "signed"),
    [
        (1.25, 1, "1.2", "+1.2"),
        (-1.26, 1, "−1.3", "−1.3"),
        (-0.001, 2, "0.00", "0.00"),
        (0.0, 0, "0", "0"),
        (-0.5, 0, "0", "0"),
        (-10.0, 0, "−10", "−10"),
        (math.nan, 2, DASH, DASH),
        (-math.inf, 2, DASH, DASH),
    ],
)
def test_numbers(value: float, decimals: int, plain: str, signed: str) -> None:
    assert number(value, decimals) == plain
    assert number(value, decimals, signed=True) == signed
