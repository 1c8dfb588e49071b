"""The page as a whole: from a report and pictures to one file."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from lss_core.files import write_atomically
from shoot.evaluation.report import MODEL, Report, Results
from shoot.metrics.bootstrap import Interval
from shoot.report.html.cards import SampleCard, card_sections
from shoot.report.html.columns import (
    CALIBRATION,
    GROUPS,
    MAIN,
    NLL,
    ORACLE_KEYS,
    SAFETY,
    TOP_10,
    Column,
    other_columns,
)
from shoot.report.html.figures import part_figures, reliability_figures, top_k_figures
from shoot.report.html.guide import reading_guide
from shoot.report.html.markup import Html, element, join
from shoot.report.html.style import STYLE
from shoot.report.html.tables import difference_table, method_table, part_table
from shoot.report.html.words import spaced, verdict
from shoot.trajectories import HORIZON_S

# The browser may fetch nothing, run nothing and send nothing, whatever stands in the page.
POLICY: Final = "default-src 'none'; img-src data:; style-src 'unsafe-inline'"


@dataclass(frozen=True)
class PageDetails:
    """What the page says of the evaluation besides its numbers.

    Attributes:
        run: Name of the run.
        data_set: What it was evaluated on, in words.
        date: When, in words; given from outside, so that the same input gives the same page.
        checkpoint: Which weights.
        num_templates: K.
        horizon_s: How far ahead they go.
    """

    run: str
    data_set: str
    date: str
    checkpoint: str = "last"
    num_templates: int | None = None
    horizon_s: float = HORIZON_S


def write_page(
    report: Report,
    cards: Mapping[str, Sequence[SampleCard]],
    details: PageDetails,
    path: str | Path,
) -> None:
    """Write one file that needs no other file, no network and no script to be read.

    It appears whole or not at all. See `render_page`.
    """
    page = render_page(report, cards, details)
    with write_atomically(path) as stream:
        stream.write(page.encode())


def render_page(
    report: Report, cards: Mapping[str, Sequence[SampleCard]], details: PageDetails
) -> str:
    """The page as text; the same input gives the same text.

    Args:
        report: Of the evaluation. A metric that is missing or no number becomes a dash.
        cards: Group (`best`, `typical`, `worst`) -> samples; may be empty.
        details: What else there is to say.
    """
    overall = report.overall
    title = f"Evaluation of {details.run} on '{report.split}'"
    sections = [
        ("guide", "How to read this", _guide(report, details)),
        ("methods", "All methods", _methods(overall)),
        ("driving", "Calibration and driving", _driving(report)),
        ("parts", "Part by part", _parts(report)),
        ("samples", "Samples", _samples(cards)),
    ]
    links = (
        element("li", element("a", name, href=f"#{anchor}"))
        for anchor, name, body in sections
        if body
    )
    body = join(
        element("h1", title),
        _facts(report, details),
        *(_outcome(overall.differences, column) for column in (TOP_10, NLL)),
        element("nav", element("ul", *links), aria_label="Contents"),
        element(
            "main",
            *(
                element("section", element("h2", name), content, id=anchor)
                for anchor, name, content in sections
                if content
            ),
        ),
    )
    head = join(
        element("meta", charset="utf-8"),
        element("meta", http_equiv="Content-Security-Policy", content=POLICY),
        element("meta", name="viewport", content="width=device-width, initial-scale=1"),
        element("title", title),
        element("style", Html(STYLE)),
    )
    page = element("html", element("head", head), element("body", body), lang="en")
    return f"<!DOCTYPE html>\n{page}\n"


def _facts(report: Report, details: PageDetails) -> Html:
    facts = {
        "Run": f"{details.run}, checkpoint {details.checkpoint}",
        "Data set": details.data_set,
        "Split": report.split,
        "Samples": f"{report.overall.num_samples} of {report.overall.num_scenes} scenes",
        "Date": details.date,
    }
    if report.resampled == "logs":
        facts["Samples"] += f" of {report.overall.num_groups} logs"
    if report.num_seen_scenes:
        facts["Seen in training"] = (
            f"{report.num_seen_scenes} of these scenes: the run was trained on them, or its "
            "templates fitted"
        )
    if report.num_bad_samples:
        facts["Left out"] = f"{report.num_bad_samples} samples that cannot be used"
    if details.num_templates is not None:
        facts["Templates"] = str(details.num_templates)
    pairs = (part for name, fact in facts.items() for part in (("dt", name), ("dd", fact)))
    return element("dl", *(element(tag, text) for tag, text in pairs), class_="facts")


def _guide(report: Report, details: PageDetails) -> Html:
    overall = report.overall
    return reading_guide(
        details.num_templates,
        report.resampled,
        overall.num_groups,
        overall.methods,
        details.horizon_s,
    )


def _methods(overall: Results) -> Html:
    parts = [method_table("Ranking: means with 95 % intervals", overall.methods, MAIN)]
    if overall.differences:
        title = f"Differences: {MODEL} minus the others"
        parts.append(difference_table(title, overall.differences, MAIN))
    else:
        parts.append(_note(f"No method is called '{MODEL}', so there are no differences."))
    return join(*parts, top_k_figures(overall.methods))


def _outcome(differences: Mapping[str, Mapping[str, Interval]], column: Column) -> Html:
    """In a sentence: what the model beats and what it does not."""
    outcomes: dict[str, list[str]] = {"better": [], "worse": [], "": []}
    for name, metrics in differences.items():
        if column.key in metrics and math.isfinite(metrics[column.key].value):
            outcomes[verdict(metrics[column.key], column)].append(spaced(name))
    clauses = [
        f"{words} {', '.join(names)}"
        for words, names in (
            ("better than", outcomes["better"]),
            ("worse than", outcomes["worse"]),
            ("not told apart from", outcomes[""]),
        )
        if names
    ]
    if not clauses:
        return Html()
    return element("p", f"In {column.name.partition(',')[0]} the {MODEL} is {'; '.join(clauses)}.")


def _driving(report: Report) -> Html:
    overall = report.overall
    oracle = {ORACLE_KEYS.get(key, key): value for key, value in overall.oracle.items()}
    limits = {"nearest template": oracle, "driven path": overall.driver}
    every = (*overall.methods.values(), *limits.values())
    keys = [key for metrics in every for key in metrics]
    parts = []
    for group in GROUPS:
        parts += [element("h3", group.title), _note(group.note)]
        parts.append(_group(overall, limits, group.columns, keys))
        if group is SAFETY and report.rests_on is not None:
            parts += [_note(f"On this data: {text}.") for text in report.rests_on.sentences()]
        if group is CALIBRATION:
            parts.append(reliability_figures(overall))
        if group is SAFETY and report.num_boxes_left_out:
            parts.append(
                _note(
                    f"Left out: {report.num_boxes_left_out} boxes, at "
                    f"{report.num_samples_with_boxes_left_out} of {overall.num_samples} samples."
                )
            )
    others = other_columns(keys)
    if others:
        parts += [element("h3", "Other metrics"), _group(overall, limits, others, keys)]
    return join(*parts)


def _group(
    overall: Results,
    limits: Mapping[str, Mapping[str, Interval]],
    columns: Sequence[Column],
    keys: Sequence[str],
) -> Html:
    """A group's means, and its differences to be unfolded; of the metrics that there are."""
    columns = [column for column in columns if column.key in keys]
    if not columns:
        return _note("Not part of this report.")
    means = method_table("Means with 95 % intervals", overall.methods, columns, limits)
    if not overall.differences:
        return means
    title = f"Differences: {MODEL} minus the others"
    return join(
        means,
        element(
            "details",
            element("summary", title),
            difference_table(title, overall.differences, columns),
        ),
    )


def _parts(report: Report) -> Html:
    groups = (
        ("manoeuvre", "By manoeuvre", report.by_manoeuvre),
        ("speed", "By speed", report.by_speed),
        ("condition", "By light and weather", report.by_condition),
    )
    return join(
        *(
            join(
                element("h3", title),
                part_table(f"Top-10 and NLL {title.lower()}", parts),
                part_figures(anchor, title, parts, report.overall),
            )
            for anchor, title, parts in groups
            if parts
        )
    )


def _samples(cards: Mapping[str, Sequence[SampleCard]]) -> Html:
    if not any(cards.values()):
        return Html()
    return join(
        _note(
            f"Chosen by the NLL of {MODEL}: best and worst are the two ends, typical ones lie "
            "around the median. They show what success and failure look like, not how often they "
            "happen. Cost of the map: dark is dear."
        ),
        card_sections(cards),
    )


def _note(text: str) -> Html:
    return element("p", text, class_="note")
