"""Single routes: what their scores were, what went wrong and when, and a filmstrip."""

import base64
from collections.abc import Mapping, Sequence

from shoot.report.driving.columns import SCORE, WORDS, Row, interval_of
from shoot.report.html.markup import Html, element, join
from shoot.report.html.words import number

_SHOWN_MISHAPS = 8


def worst_routes(rows: Sequence[Row], num: int) -> list[Row]:
    """Those of the lowest scores, the lowest first; of equal ones those with most mishaps."""
    return sorted(rows, key=lambda row: (_score(row), -len(row.get("mishaps", ()))))[:num]


def route_cards(rows: Sequence[Row], strips: Mapping[int, bytes]) -> Html:
    """A heading, facts in words and the strip of each route.

    Args:
        rows: Results of routes, as in their files.
        strips: Number of a route -> JPEG file's bytes.
    """
    return join(*(_card(row, strips.get(row["route"])) for row in rows))


def _card(row: Row, strip: bytes | None) -> Html:
    number_ = row["route"]
    heading = f"Route {number_}: {number(_score(row), 3)}"
    parts = [element("h3", heading), element("p", sentence_of(row))]
    if row.get("error") is None:
        parts.append(_mishaps(row))
    if strip is not None:
        picture = element(
            "img",
            src=f"data:image/jpeg;base64,{base64.b64encode(strip).decode()}",
            alt=f"Route {number_}: its way from above, then moments of it in the order of time.",
        )
        label = f"Filmstrip of route {number_}"
        strip_box = element("div", picture, class_="strip", role="region", aria_label=label,
                            tabindex=0)  # fmt: skip
        parts.append(strip_box)
    return element("article", *parts, id=f"route{number_}")


def sentence_of(row: Row) -> str:
    """What the score was lost by."""
    place = f"Town {row.get('town_seed')}, seed {row.get('seed')}. "
    if row.get("error") is not None:
        return f"{place}It was not driven to its end and counts 0: {row['error']}"
    lost = [
        f"{words} ({key.upper()}) {number(value, 2)}"
        for key, words in WORDS.items()
        if (value := interval_of(row["scores"].get(key)).value) < 1.0
    ]
    facts = row.get("facts", {})
    metres = interval_of(facts.get("progress_m")).value
    reference = interval_of(facts.get("reference_progress_m")).value
    went = f"{number(metres, 0)} m along the route (the rules: {number(reference, 0)} m). "
    return place + went + (f"Below 1: {', '.join(lost)}." if lost else "All sub-scores are 1.")


def _mishaps(row: Row) -> Html:
    mishaps = list(row.get("mishaps", ()))
    if not mishaps:
        return element("p", "Nothing went wrong by the score's facts.", class_="note")
    shown = [
        element("li", element("strong", f"{one['time_s']:.1f} s"), f" {one['what']}")
        for one in mishaps[:_SHOWN_MISHAPS]
    ]
    if len(mishaps) > len(shown):
        shown.append(element("li", f"and {len(mishaps) - len(shown)} more"))
    return element("ul", *shown)


def _score(row: Row) -> float:
    return interval_of(row["scores"].get(SCORE.key)).value
