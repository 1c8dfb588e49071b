"""The page as a whole: from a report and pictures to one file."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from lss_core.files import write_atomically
from shoot.evaluation.results import Report
from shoot.report.html.cards import SampleCard
from shoot.report.html.document import document
from shoot.report.html.guide import reading_guide
from shoot.report.html.markup import Html, element, join
from shoot.report.html.opening import opening
from shoot.report.html.sections import (
    driving_section,
    methods_section,
    parts_section,
    samples_section,
)
from shoot.trajectories import HORIZON_S


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

    It opens with the verdict, the best and the worst sample and one table. What the words mean is
    folded away below.

    Args:
        report: Of the evaluation. A metric that is missing or no number becomes a dash.
        cards: Group (`best`, `typical`, `worst`) -> samples; may be empty.
        details: What else there is to say.
    """
    overall = report.overall
    title = f"Evaluation of {details.run} on '{report.split}'"
    sections = [
        ("guide", "How to read this", _guide(report, details)),
        ("methods", "All methods", methods_section(overall)),
        ("driving", "Calibration and driving", driving_section(report)),
        ("parts", "Part by part", parts_section(report)),
        ("samples", "More samples", samples_section(cards)),
    ]
    links = (
        element("li", element("a", name, href=f"#{anchor}"))
        for anchor, name, body in sections
        if body
    )
    body = join(
        element("h1", title),
        opening(report, cards),
        _facts(report, details),
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
    return document(title, body)


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
