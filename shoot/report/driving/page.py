"""The page of a folder of driven routes."""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

from lss_core.files import write_atomically
from shoot.metrics.bootstrap import Interval
from shoot.metrics.driving_score.score import NAME
from shoot.report.driving.columns import (
    COLUMNS,
    FACTS,
    SCORE,
    WORDS,
    Row,
    facts_of,
    interval_of,
    scores_of,
)
from shoot.report.driving.route_cards import route_cards, worst_routes
from shoot.report.html.columns import Column
from shoot.report.html.document import document
from shoot.report.html.markup import Html, element, folded, join, note
from shoot.report.html.tables import difference_table, method_table
from shoot.report.html.words import bounds, has_bounds, number
from shoot.simulation.routes.result_files import SUMMARY, read_object, strip_file

NUM_WORST = 6
PAGE = "report.html"

Read = Callable[[Row], dict[str, Interval]]


def write_driving_page(
    folder: Path, summary: Row, rows: Sequence[Row], beside: Sequence[Path] = ()
) -> Path:
    """Write `report.html`, which needs no other file, no network and no script; returns its path.

    Args:
        folder: Of results, with their filmstrips; the page is written there, whole or not at all.
        summary: Of these, as in `summary.json`.
        rows: Results of all routes, as in their files.
        beside: Folders of other results; those with a summary stand in the same tables.
    """
    files = {
        row["route"]: strip_file(folder, row["route"]) for row in worst_routes(rows, NUM_WORST)
    }
    strips = {route: path.read_bytes() for route, path in files.items() if path.exists()}
    others = {
        one.resolve().name: read_object(one / SUMMARY) for one in beside if (one / SUMMARY).exists()
    }
    path = folder / PAGE
    with write_atomically(path) as stream:
        stream.write(render_driving_page(summary, rows, strips, others).encode())
    return path


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
        _table(f"{NAME}: means over routes", drivers, COLUMNS, scores_of),
        _differences(summary, COLUMNS, scores_of),
        _guide(summary),
        element("h2", "Facts"),
        _table("Means over routes that were driven to their end", drivers, FACTS, facts_of),
        _differences(summary, FACTS, facts_of),
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


def _table(title: str, drivers: Mapping[str, Row], columns: Sequence[Column], read: Read) -> Html:
    means = {name: read(summary) for name, summary in drivers.items()}
    return method_table(title, means, columns, corner="driver")


def _differences(summary: Row, columns: Sequence[Column], read: Read) -> Html:
    """Paired, on the same routes; nothing if nobody is to be compared with."""
    minus = summary.get("minus", {})
    if not minus:
        return Html()
    differences = {name: read(one) for name, one in minus.items()}
    return difference_table("Differences on the same routes", differences, columns, _name(summary))


def _guide(summary: Row) -> Html:
    settings: Row = summary.get("settings", {})
    meanings = (f"{key.upper()}: {words}" for key, words in WORDS.items())
    return folded(
        "What the columns mean",
        element("p", "All are 0 to 1, and high is good. ", "; ".join(meanings), "."),
        element(
            "p",
            "The driving score of a route is the product of the factors times the weighted mean of "
            "the rest (EP and TTC 5, LK, HC and EC 2 each). The first seconds, which the rule "
            "driver drives, do not count. Ranges are 95 % intervals over "
            f"{summary.get('num_towns')} towns. A route that could not be driven counts 0. It is "
            "not NAVSIM's own figure: see docs/driving_score.md.",
        ),
        element("ul", *(element("li", f"{name}: {value}") for name, value in settings.items())),
    )


def _all_routes(rows: Sequence[Row]) -> Html:
    scores = {
        str(row["route"]): {key: interval_of(value) for key, value in row["scores"].items()}
        for row in rows
    }
    return method_table("Scores of single routes", scores, COLUMNS, corner="route")
