"""The page: it holds every number of the report, nothing of it can act, and it needs nothing."""

import math
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from html_fixture import (
    HOSTILE,
    KEYS,
    METHODS,
    Node,
    Numbers,
    hostile_page,
    make_card,
    make_report,
    read_page,
)

from shoot.evaluation.report import Report, evaluate
from shoot.metrics.bootstrap import Interval
from shoot.report.html import PageDetails, render_page, write_page
from shoot.report.html.columns import GROUPS, MAIN, NLL, TOP_10, Column
from shoot.report.html.figures import plotted_methods
from shoot.report.html.words import DASH, bounds, number, verdict

DETAILS = PageDetails("runs/small", "synthetic city", "2024-05-06 07:08", "best", 40)
CARDS = {"best": [make_card()], "worst": [make_card(token="0b-other", nll=9.0, rank=39)]}
COLUMNS = {
    column.key: column for columns in (MAIN, *(g.columns for g in GROUPS)) for column in columns
}


def page_of(report: Report, **changed: object) -> Node:
    return read_page(render_page(report, CARDS, PageDetails(**vars(DETAILS) | changed)))  # type: ignore[arg-type]


def rows_of(page: Node, name: str, corner: str | None = None) -> list[Node]:
    """Rows whose first cell says this, in tables whose corner says that, if it matters."""
    return [
        row
        for table in page.all("table")
        if corner in (None, table.all("th")[0].text)
        for row in table.all("tr")
        if row.all("th") and row.all("th")[0].text == name
    ]


@pytest.fixture(scope="module")
def report() -> Report:
    return make_report()


@pytest.fixture(scope="module")
def text(report: Report) -> str:
    return render_page(report, CARDS, DETAILS)


@pytest.fixture(scope="module")
def page(text: str) -> Node:
    return read_page(text)


def test_it_says_what_was_evaluated(page: Node) -> None:
    (title,), (facts,) = page.all("h1"), page.all("dl")
    assert "runs/small" in title.text
    assert "val" in title.text
    shown = dict(
        zip((n.text for n in facts.all("dt")), (n.text for n in facts.all("dd")), strict=True)
    )
    assert shown["Run"] == "runs/small, checkpoint best"
    assert shown["Data set"] == "synthetic city"
    assert shown["Samples"] == "12 of 3 scenes"
    assert shown["Date"] == "2024-05-06 07:08"
    assert shown["Templates"] == "40"


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
    ranking = page.all("table")[0]
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
    ranking = page.all("table")[0]
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


def test_times_that_no_template_has_stand_nowhere() -> None:
    keys = ("top10", "nll", "l2_at_1s", "l2_at_2s", "collision_1s", "collision_2s")
    labels = {cell.text for cell in page_of(make_report(keys=keys)).all("th")}
    assert {"1 s", "2 s"} <= labels
    assert not {"3 s", "5 s"} & labels


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


def test_one_scene_shows_means_without_intervals() -> None:
    page = page_of(make_report(has_bounds=False))
    assert not [node for node in page if node.attributes.get("class") in ("range", "verdict")]
    assert not [node for row in page.all("tr") for node in row.all("strong")]
    assert "one scene only" in page.text
    assert len(rows_of(page, "model")) > 3


def test_without_a_model_the_page_says_so() -> None:
    page = page_of(make_report(methods=("prior", "blind")))
    assert "No method is called 'model'" in page.text


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
    assert "In NLL the model is better than prior; worse than constant velocity." in page.text
    assert (
        "In top-10 the model is better than constant velocity; not told apart from prior."
        in page.text
    )


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


def test_cards_say_which_sample_and_how_sure(page: Node) -> None:
    best, worst = (node for node in page.all("figure") if node.attributes.get("class") == "card")
    caption = best.all("figcaption")[0].text
    for said in ("3f2a-token", "scene-0103", "Night, big street", "rank 4 of 40", "28.7 %", "1.25"):
        assert said in caption
    assert "rank 40 of 40, probability below 0.1 %" in worst.all("figcaption")[0].text
    (picture,) = best.all("img")
    assert (picture.attributes["width"], picture.attributes["height"]) == ("60", "40")
    assert [n.text for n in page.all("h3")][-2:] == ["Best", "Worst"]
    with pytest.raises(ValueError, match="'3f2a-token' must be a PNG"):
        make_card(picture=b"\xff\xd8 a JPEG")


def test_without_cards_there_is_no_empty_section(report: Report) -> None:
    page = read_page(render_page(report, {"best": []}, DETAILS))
    assert "Samples" not in [node.text for node in page.all("h2")]
    assert "#samples" not in [node.attributes["href"] for node in page.all("a")]


def test_it_needs_nothing_and_runs_nothing(text: str, page: Node) -> None:
    assert not re.search(r"https?:|//[a-z]|@import|javascript:", re.sub(r"base64,[^\"]*", "", text))
    assert not page.all(
        "script", "link", "iframe", "object", "embed", "base", "form", "foreignobject"
    )
    (policy,) = [n for n in page.all("meta") if n.attributes.get("http-equiv")]
    assert policy.attributes["http-equiv"] == "Content-Security-Policy"
    assert policy.attributes["content"] == (
        "default-src 'none'; img-src data:; style-src 'unsafe-inline'"
    )
    head = page.all("head")[0].all("meta", "style", "title")
    assert head.index(policy) < head.index(page.all("style")[0])  # it holds for what comes after
    assert len(page.all("style")) == 1
    for node in page:
        assert not [name for name in node.attributes if name.startswith("on")]
        for name in ("src", "href", "xlink:href"):
            value = node.attributes.get(name) or "#"
            assert value.startswith(("#", "data:image/png;base64,"))


def test_ids_are_unique_and_references_lead_somewhere(page: Node) -> None:
    ids = [node.attributes["id"] for node in page if "id" in node.attributes]
    assert len(ids) == len(set(ids))
    used = [
        reference
        for node in page
        for name, value in node.attributes.items()
        for reference in re.findall(
            r"^#(.+)$" if name == "href" else r"url\(#([^)]+)\)", value or ""
        )
    ]
    assert len(used) > 20
    assert set(used) <= set(ids)


def test_every_picture_says_what_it_shows(page: Node) -> None:
    assert len(page.all("svg")) > 8
    assert all(node.attributes["role"] == "img" for node in page.all("svg"))
    assert all(node.attributes["aria-label"] for node in page.all("svg"))
    assert all(node.attributes["alt"] for node in page.all("img"))
    (html,) = page.all("html")
    assert html.attributes["lang"] == "en"
    regions = [n for n in page.all("div") if n.attributes.get("class") == "scroll"]
    assert len(regions) == len(page.all("table"))


@pytest.fixture(scope="module")
def harmless() -> Node:
    return read_page(hostile_page("harmless"))


@pytest.mark.filterwarnings("ignore:Glyph")
@pytest.mark.parametrize("text", HOSTILE)
def test_text_from_outside_stays_text(text: str, harmless: Node) -> None:
    """Everywhere at once; the page has the elements it has with harmless texts, and says them."""
    written = hostile_page(text).encode().decode()
    assert not re.search("[\x00-\x08\x0b-\x1f\x7f]", written)
    page = read_page(written)
    assert [(node.tag, sorted(node.attributes)) for node in page] == [
        (node.tag, sorted(node.attributes)) for node in harmless
    ]
    shown = re.sub("[\x00\x07\udc80]", "\ufffd", text)
    assert [node.text for node in page.all("code")] == [f"best {shown}", shown]
    assert [node.text for node in page.all("dd")][:2] == [f"{shown}, checkpoint {shown}", shown]
    assert shown in page.all("title")[0].text
    assert rows_of(page, shown)


def test_the_same_input_gives_the_same_bytes_and_the_date_is_in_it(
    report: Report, text: str, tmp_path: Path
) -> None:
    first, second = tmp_path / "new" / "a.html", tmp_path / "new" / "b.html"
    write_page(make_report(), CARDS, DETAILS, first)
    assert first.read_bytes() == text.encode()
    later = PageDetails(**vars(DETAILS) | {"date": "2031-01-01"})
    write_page(report, CARDS, later, second)
    assert first.read_text(encoding="utf-8").replace(
        DETAILS.date, "2031-01-01"
    ) == second.read_text(encoding="utf-8")
    assert sorted(path.name for path in first.parent.iterdir()) == ["a.html", "b.html"]


def test_of_many_methods_the_plots_show_model_prior_and_the_best() -> None:
    numbers = Numbers()
    names = [f"m{idx}" for idx in range(8)]
    methods = {
        name: numbers.metrics(("nll",)) for name in (*names[:4], "prior", *names[4:], "model")
    }
    assert plotted_methods(methods) == ["m0", "m1", "m2", "m3", "prior", "model"]
    methods["m0"] = {"nll": Interval(float("nan"), 0.0, 0.0)}
    methods["m1"] = {}
    assert plotted_methods(methods) == ["m2", "m3", "prior", "m4", "m5", "model"]


def test_boxes_left_out_are_counted_on_the_page() -> None:
    page = render_page(make_report(), {}, DETAILS)
    assert "Left out: 7 boxes, at 5 of 12 samples." in page
    none = replace(make_report(), num_boxes_left_out=0, num_samples_with_boxes_left_out=0)
    assert "Left out:" not in render_page(none, {}, DETAILS)
