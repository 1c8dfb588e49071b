"""The page opens with its verdict, two pictures and a table; what words mean is folded away."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import pairwise

import pytest
from html_fixture import (
    DETAILS,
    METHODS,
    Node,
    make_card,
    make_report,
    page_of,
    read_page,
    rows_of,
    section_of,
)

from shoot.evaluation.results import KNOWING_SPEED, Report
from shoot.metrics.bootstrap import Interval
from shoot.report.html import SampleCard, render_page
from shoot.report.html.opening import opening
from shoot.report.html.verdict import verdict_sentence

ABOVE, BELOW, AROUND = Interval(4.0, 1.0, 9.0), Interval(-4.0, -9.0, -1.0), Interval(4.0, -1.0, 9.0)
NAN = float("nan")
MANY = tuple(f"m{idx}" for idx in range(5))


def led(differences: dict[str, Interval], has_bounds: bool = True) -> Report:
    """A report with these differences in top-10."""
    report = make_report(has_bounds, methods=("model", *differences))
    for name, difference in differences.items():
        report.overall.differences[name]["top10"] = difference
    return report


def opening_of(report: Report, cards: Mapping[str, Sequence[SampleCard]]) -> Node:
    return read_page(f"<!DOCTYPE html>{opening(report, cards)}")


@pytest.fixture(scope="module")
def page() -> Node:
    return page_of(make_report())


@pytest.mark.parametrize(
    ("differences", "told"),
    [
        ({"prior": ABOVE}, "better than prior"),
        ({"prior": BELOW}, "worse than prior"),
        ({"prior": AROUND}, "not told apart from prior"),
        ({"prior": ABOVE, "blind": ABOVE}, "better than prior and blind"),
        (
            {"past_motion": BELOW, "prior": ABOVE, "blind": AROUND},
            "better than prior; worse than past motion; not told apart from blind",
        ),
        (dict.fromkeys(MANY, ABOVE), "better than 5 of 5 baselines"),
        (
            dict.fromkeys(MANY, BELOW) | {"prior": ABOVE},
            "better than prior; worse than 5 of 6 baselines",
        ),
        ({"prior": ABOVE, KNOWING_SPEED: BELOW}, "better than prior"),
        ({"prior": ABOVE, "blind": Interval(NAN, NAN, NAN)}, "better than prior"),
    ],
)
def test_the_verdict_says_what_the_reports_numbers_say(
    differences: dict[str, Interval], told: str
) -> None:
    report = led(differences)
    written = report.to_json()
    top10 = {name: metrics["top10"] for name, metrics in written["methods"].items()}
    ours = top10.pop("model")
    baselines = [
        name
        for name in top10
        if name != KNOWING_SPEED and written["differences"][name]["top10"]["value"] is not None
    ]
    strongest = max(baselines, key=lambda name: top10[name]["value"])
    which = "only" if len(baselines) == 1 else "strongest"
    prior = top10["prior"]["value"] if "prior" in baselines and strongest != "prior" else None
    assert verdict_sentence(report) == (
        f"The planner ranks what the driver did among its ten best in {ours['value']:.1f} % of "
        f"{written['num_samples']} samples [{ours['low']:.1f}, {ours['high']:.1f}]; "
        f"{strongest.replace('_', ' ')}, the {which} baseline, does so in "
        f"{top10[strongest]['value']:.1f} %"
        + ("" if prior is None else f", prior in {prior:.1f} %")
        + f": the planner is {told}."
    )


@pytest.mark.parametrize(("groups", "one"), [("scenes", "scene"), ("logs", "log")])
def test_of_one_scene_the_verdict_leaves_open_which_is_better(groups: str, one: str) -> None:
    alone = Interval(20.0, NAN, NAN)
    report = replace(led({"prior": alone, "blind": alone}, has_bounds=False), resampled=groups)  # type: ignore[arg-type]
    said = verdict_sentence(report)
    assert said.endswith(f": of one {one} there is no interval, so which is better stays open.")
    assert "[" not in said
    shown = opening_of(report, {}).text
    assert "intervals" not in shown
    assert "In NLL the planner" not in shown


def test_the_verdict_without_baselines_model_or_numbers() -> None:
    assert re.search(r"in [\d.]+ % of 12 samples \[[\d., ]+\]\.$", verdict_sentence(led({})))
    no_model = make_report(methods=("prior", "blind"))
    assert verdict_sentence(no_model) == "No method is called 'model', so there is no verdict."
    no_top10 = "The report has no top-10 of model: no verdict."
    assert verdict_sentence(make_report(keys=("nll",))) == no_top10
    diverged = make_report()
    diverged.overall.methods["model"]["top10"] = Interval(NAN, NAN, NAN)
    assert verdict_sentence(diverged) == no_top10


def test_the_verdict_confesses_scenes_seen_in_training() -> None:
    said = verdict_sentence(replace(make_report(), num_seen_scenes=2))
    assert said.endswith(". Of these 3 scenes, 2 were seen in training.")
    assert "seen in training" not in verdict_sentence(make_report())


def test_verdict_pictures_and_table_come_first_and_no_word_is_explained_before(page: Node) -> None:
    (body,) = page.all("body")
    parts = [child for child in body.children if isinstance(child, Node)]
    assert [part.attributes.get("class") or part.tag for part in parts] == [
        "h1", "answer", "pair", "note", "scroll summary", "note", "facts", "nav", "main",
    ]  # fmt: skip
    title, verdict = parts[:2]
    assert verdict.text == verdict_sentence(make_report())
    assert body.text.startswith(title.text + verdict.text)
    # The first number of the page stands in the verdict.
    assert not re.search(r"\d", title.text)
    assert re.search(r"\d", verdict.text)
    for word in ("95 %", "Template", "NLL"):
        assert word not in verdict.text


def test_best_and_worst_stand_first_and_once_and_enlarge() -> None:
    cards = {
        "best": [make_card(token="b0"), make_card(token="b1")],
        "typical": [make_card(token="t0")],
        "worst": [make_card(token="w0"), make_card(token="w1")],
    }
    page = read_page(render_page(make_report(), cards, DETAILS))
    assert [node.text for node in page.all("code")] == ["b0", "w0", "b1", "t0", "w1"]
    assert len(page.all("img")) == 5
    (pair,) = (node for node in page.all("div") if node.attributes.get("class") == "pair")
    assert [node.all("strong")[0].text for node in pair.all("figure")] == [
        "Best: scene-0103",
        "Worst: scene-0103",
    ]
    for figure in pair.all("figure"):
        assert figure.all("a")[0].attributes["href"] == f"#{figure.attributes['id']}"
    later = section_of(page, "samples")
    assert [node.text for node in later.all("h3")] == ["Best", "Typical", "Worst"]


def test_without_a_worst_sample_or_any_the_rest_stays() -> None:
    one = opening_of(make_report(), {"best": [make_card()], "worst": []})
    assert len(one.all("figure")) == 1
    none = opening_of(make_report(), {})
    assert [node.tag for node in none.all("h2", "p", "table")] == ["h2", "table", "p"]
    assert not none.all("figure", "img", "a")


def test_the_short_table_holds_planner_and_baselines_beside_the_lead() -> None:
    report = make_report(methods=(*METHODS, KNOWING_SPEED))
    (table,) = opening_of(report, {}).all("table")
    names = [row.all("th")[0].text for row in table.all("tbody")[0].all("tr")]
    assert names == ["model", "prior", "constant velocity"]
    (row,) = rows_of(table, "prior")
    prior, lead = report.overall.methods["prior"], report.overall.differences["prior"]
    assert [cell.lines[0] for cell in row.all("td")] == [
        f"{prior['top10'].value:.1f}",
        f"+{lead['top10'].value:.1f}",
        f"{prior['nll'].value:.2f}",
        f"+{lead['nll'].value:.2f}",
    ]


def test_how_to_read_it_is_folded_and_each_heading_keeps_a_line(page: Node) -> None:
    details = page.all("details")
    assert not [node for node in details if "open" in node.attributes]
    folded = " ".join(node.text for node in details)
    visible = page.all("body")[0].text
    for node in details:
        visible = visible.replace(node.text, "")
    for word in ("minus the logarithm", "drawn again", "Open loop", "Brier score:", "minADE is"):
        assert word in folded
        assert word not in visible
    for section in page.all("section"):
        children = [child for child in section.children if isinstance(child, Node)]
        assert children[0].tag == "h2"
        for heading, line in pairwise(children):
            if heading.tag in ("h2", "h3"):
                assert line.attributes.get("class") == "note", heading.text
                assert len(line.text) > 20
