"""The page of a folder of driven routes."""

from collections.abc import Mapping, Sequence
from pathlib import Path

from lss_core.files import write_atomically
from shoot.metrics.driving_score.score import NAME
from shoot.report.driving.columns import (
    COLUMNS,
    SCORE,
    WORDS,
    Row,
    fact_columns,
    interval_of,
    scores_of,
)
from shoot.report.driving.route_cards import route_cards, worst_routes
from shoot.report.html.document import document
from shoot.report.html.markup import Html, element, folded, join, note
from shoot.report.html.tables import method_table
from shoot.report.html.words import bounds, has_bounds, number

NUM_WORST = 6


def write_driving_page(
    path: str | Path,
    summary: Row,
    rows: Sequence[Row],
    strips: Mapping[int, bytes],
    beside: Mapping[str, Row] | None = None,
) -> None:
    """Write one file that needs no other file, no network and no script; whole or not at all.

    See `render_driving_page`.
    """
    page = render_driving_page(summary, rows, strips, beside)
    with write_atomically(path) as stream:
        stream.write(page.encode())


def render_driving_page(
    summary: Row,
    rows: Sequence[Row],
    strips: Mapping[int, bytes],
    beside: Mapping[str, Row] | None = None,
) -> str:
    """The page as text; the same input gives the same text.

    Args:
        summary: As in `summary.json`.
        rows: Results of all routes, as in their files.
        strips: Number of a route -> its filmstrip as a JPEG file's bytes; missing ones are left
            out.
        beside: Name -> summary of others, to stand in the same tables.
    """
    drivers = {_name(summary): summary, **(beside or {})}
    title = f"{_name(summary)} drives {summary.get('num_routes')} routes"
    body = join(
        element("h1", f"{title}, {summary.get('mode')} traffic"),
        element("h2", _answer(summary), class_="answer"),
        method_table(
            f"{NAME}: means over routes",
            {name: scores_of(one) for name, one in drivers.items()},
            COLUMNS,
            corner="driver",
        ),
        _guide(),
        element("h2", "Facts"),
        _facts(drivers),
        element("h2", "Worst routes"),
        note(
            "First the whole way from above, from the white dot to the black one; then moments: "
            "what the front camera saw, if there is one, and the ground around the car, heading "
            "up. Blue: driven. Orange: planned. Green: the route. Red crosses: something went "
            "wrong there."
        ),
        route_cards(worst_routes(rows, NUM_WORST), strips),
        element("h2", "All routes"),
        folded(f"Scores of {len(rows)} routes", _all_routes(rows)),
    )
    return document(title, body)


def _name(summary: Row) -> str:
    return str(summary.get("driver"))


def _answer(summary: Row) -> str:
    score = interval_of(summary.get(SCORE.key))
    said = number(score.value, 3)
    reach = f" {bounds(score, 3)}" if has_bounds(score) else ""
    return f"{_name(summary)} has a driving score of {said}{reach}."


def _guide() -> Html:
    meanings = (f"{key.upper()}: {words}" for key, words in WORDS.items())
    return folded(
        "What the columns mean",
        element("p", "All are 0 to 1, and high is good. ", "; ".join(meanings), "."),
        element(
            "p",
            "The driving score of a route is the product of the factors times the weighted mean of "
            "the rest (EP and TTC 5, LK, HC and EC 2 each). The first seconds, which the rule "
            "driver drives, do not count. Ranges are 95 % intervals over routes. A route that "
            "could not be driven counts 0. It is not NAVSIM's own figure: see "
            "docs/driving_score.md.",
        ),
    )


def _facts(drivers: Mapping[str, Row]) -> Html:
    facts = {name: dict(summary.get("facts", {})) for name, summary in drivers.items()}
    keys = dict.fromkeys(key for of_one in facts.values() for key in of_one)
    rows = {
        name: {key: interval_of(value) for key, value in of_one.items()}
        for name, of_one in facts.items()
    }
    return method_table("Means over routes", rows, fact_columns(keys), corner="driver")


def _all_routes(rows: Sequence[Row]) -> Html:
    scores = {
        str(row["route"]): {key: interval_of(value) for key, value in row["scores"].items()}
        for row in rows
    }
    return method_table("Scores of single routes", scores, COLUMNS, corner="route")
