"""The page of driven routes: all numbers, the worst routes first, nothing that could run."""

import base64

import pytest
from html_fixture import HOSTILE, Node, read_page
from routes_page_case import hostile_routes_page, make_row, make_strip, make_summary

from shoot.report.driving.page import NUM_WORST, render_driving_page
from shoot.report.driving.route_cards import worst_routes

ROWS = [make_row(route, score) for route, score in enumerate((0.9, 0.2, 0.7, 0.2, 1.0, 0.4, 0.8))]


def text_of(node: Node) -> str:
    parts = [child if isinstance(child, str) else text_of(child) for child in node.children]
    return " ".join(" ".join(parts).split())


def found(page: str, tag: str) -> list[Node]:
    return [node for node in read_page(page) if node.tag == tag]


def test_the_worst_come_first_and_of_equals_those_with_most_mishaps() -> None:
    mishap = {"time_s": 3.0, "what": "leaves the road", "at_m": [0.0, 0.0]}
    rows = [*ROWS[:3], make_row(3, 0.2, mishaps=[mishap]), *ROWS[4:]]
    assert [row["route"] for row in worst_routes(rows, 4)] == [3, 1, 5, 2]
    page = render_driving_page(make_summary(), rows, {})
    headings = [text_of(node) for node in found(page, "h3")]
    assert headings[:3] == ["Route 3: 0.200", "Route 1: 0.200", "Route 5: 0.400"]
    assert len(headings) == NUM_WORST
    assert "3.0 s leaves the road" in [text_of(node) for node in found(page, "li")]


def test_scores_of_all_drivers_and_differences_are_there() -> None:
    summary = make_summary(minus={"rule": make_summary(score=-0.375)})
    page = render_driving_page(summary, ROWS, {}, {"rule": make_summary("rule", 0.875)})
    rows = [text_of(node) for node in found(page, "tr")]
    assert any(row.startswith("run 0.500 [0.375, 0.625]") for row in rows)
    assert any(row.startswith("rule 0.875 [0.750, 1.000]") for row in rows)
    # Low is bad of scores, and good of red lights.
    assert any("−0.375 [−0.500, −0.250] worse" in row for row in rows)
    assert any("+0.25 [+0.12, +0.38] worse" in row for row in rows)
    assert "run has a driving score of 0.500 [0.375, 0.625]." in text_of(found(page, "body")[0])


def test_a_route_says_what_it_lost_by_and_how_far_it_came() -> None:
    page = render_driving_page(make_summary(), [make_row(3, 0.25)], {})
    said = [text_of(node) for node in found(page, "p")]
    assert (
        "Town 103, seed 7. 43 m along the route (the rules: 50 m). Below 1: on the road (DAC) 0.25."
    ) in said
    assert "Nothing went wrong by the score's facts." in said


def test_a_route_that_failed_says_why_and_has_no_facts() -> None:
    row = make_row(4, 0.0, error="The planner gives no finite scores.")
    del row["facts"], row["mishaps"]
    page = render_driving_page(make_summary(), [row], {})
    assert any(
        "counts 0: The planner gives no finite scores." in text_of(node)
        for node in found(page, "p")
    )


def test_strips_are_inside_the_page() -> None:
    page = render_driving_page(make_summary(), ROWS, {1: make_strip()})
    (image,) = found(page, "img")
    inside = (image.attributes["src"] or "").removeprefix("data:image/jpeg;base64,")
    assert base64.b64decode(inside) == make_strip()
    assert "<script" not in page
    assert page == render_driving_page(make_summary(), ROWS, {1: make_strip()})


@pytest.mark.parametrize("word", HOSTILE)
def test_hostile_texts_stay_texts(word: str) -> None:
    tags = [node.tag for node in read_page(hostile_routes_page("harmless"))]
    assert [node.tag for node in read_page(hostile_routes_page(word))] == tags
