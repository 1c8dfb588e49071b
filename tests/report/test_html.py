"""The page as a whole: nothing of it can act, it needs nothing, and it is the same each time."""

import re
from dataclasses import replace
from pathlib import Path

import pytest
from html_fixture import (
    CARDS,
    DETAILS,
    HOSTILE,
    Node,
    Numbers,
    hostile_page,
    make_card,
    make_report,
    page_of,
    read_page,
    rows_of,
)

from shoot.evaluation.results import Report
from shoot.metrics.bootstrap import Interval
from shoot.report.html import render_page, write_page
from shoot.report.html.figures import plotted_methods


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


def test_without_a_model_the_page_says_so() -> None:
    page = page_of(make_report(methods=("prior", "blind")))
    assert "No method is called 'model'" in page.text


def test_cards_say_which_sample_and_how_sure(page: Node) -> None:
    best, worst = (node for node in page.all("figure") if node.attributes.get("class") == "card")
    caption = best.all("figcaption")[0].text
    for said in ("3f2a-token", "scene-0103", "Night, big street", "rank 4 of 40", "28.7 %", "1.25"):
        assert said in caption
    assert "rank 40 of 40, probability below 0.1 %" in worst.all("figcaption")[0].text
    (picture,) = best.all("img")
    assert (picture.attributes["width"], picture.attributes["height"]) == ("60", "40")
    with pytest.raises(ValueError, match="'3f2a-token' must be a PNG"):
        make_card(picture=b"\xff\xd8 a JPEG")


def test_without_cards_there_is_no_empty_section(report: Report) -> None:
    page = read_page(render_page(report, {"best": []}, DETAILS))
    assert "More samples" not in [node.text for node in page.all("h2")]
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
    regions = [n for n in page.all("div") if n.attributes.get("role") == "region"]
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
    later = replace(DETAILS, date="2031-01-01")
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
