"""What the page opens with: verdict, best and worst sample, and the table the verdict rests on."""

from collections.abc import Mapping, Sequence

from shoot.evaluation.results import MODEL, Report
from shoot.report.html.cards import SampleCard, first_cards
from shoot.report.html.columns import NLL
from shoot.report.html.markup import Html, element, join, note
from shoot.report.html.tables import summary_table
from shoot.report.html.verdict import relations, verdict_sentence


def opening(report: Report, cards: Mapping[str, Sequence[SampleCard]]) -> Html:
    """Verdict, pictures if there are any, and one short table."""
    overall = report.overall
    has_intervals = overall.num_groups > 1
    by_nll = relations(overall.differences, NLL) if has_intervals else ""
    means = "Means with 95 % intervals" if has_intervals else "Means"
    return join(
        element("h2", verdict_sentence(report), class_="answer"),
        first_cards(cards),
        summary_table(f"{means}; {MODEL} is the planner", overall),
        note(f"In NLL the planner is {by_nll}.") if by_nll else "",
    )
