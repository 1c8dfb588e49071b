"""The sections of the page below its opening, each with a line of what it is about."""

from collections.abc import Mapping, Sequence

from shoot.evaluation.results import MODEL, Report, Results
from shoot.metrics.bootstrap import Interval
from shoot.report.html.cards import SampleCard, card_sections, other_cards
from shoot.report.html.columns import (
    CALIBRATION,
    GROUPS,
    MAIN,
    ORACLE_KEYS,
    SAFETY,
    Column,
    other_columns,
)
from shoot.report.html.figures import part_figures, reliability_figures, top_k_figures
from shoot.report.html.markup import Html, element, folded, join, note
from shoot.report.html.tables import difference_table, method_table, part_table

_READING = "How to read these numbers"


def methods_section(overall: Results) -> Html:
    """Every method by ranking, the model's lead over each, and top-k as a plot."""
    parts = [note(f"Every method on the same samples, and {MODEL}'s lead over each.")]
    parts.append(method_table("Ranking: means with 95 % intervals", overall.methods, MAIN))
    if overall.differences:
        title = f"Differences: {MODEL} minus the others"
        parts.append(difference_table(title, overall.differences, MAIN))
    else:
        parts.append(note(f"No method is called '{MODEL}', so there are no differences."))
    return join(*parts, top_k_figures(overall.methods))


def driving_section(report: Report) -> Html:
    """All other metrics, group by group."""
    overall = report.overall
    oracle = {ORACLE_KEYS.get(key, key): value for key, value in overall.oracle.items()}
    limits = {"nearest template": oracle, "driven path": overall.driver}
    every = (*overall.methods.values(), *limits.values())
    keys = [key for metrics in every for key in metrics]
    parts = [
        note("All but the ranking: what probabilities are worth, and how the choice would drive.")
    ]
    for group in GROUPS:
        parts += [element("h3", group.title), note(group.note)]
        parts.append(_group(overall, limits, group.columns, keys))
        parts.append(folded(_READING, note(group.reading)))
        if group is SAFETY and report.rests_on is not None:
            parts += [note(f"On this data: {text}.") for text in report.rests_on.sentences()]
        if group is CALIBRATION:
            parts.append(reliability_figures(overall))
        if group is SAFETY and report.num_boxes_left_out:
            parts.append(
                note(
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
        return note("Not part of this report.")
    means = method_table("Means with 95 % intervals", overall.methods, columns, limits)
    if not overall.differences:
        return means
    title = f"Differences: {MODEL} minus the others"
    return join(
        means,
        folded(title, difference_table(title, overall.differences, columns)),
    )


def parts_section(report: Report) -> Html:
    """Top-10 and NLL of each method in parts of the samples."""
    groups = (
        ("manoeuvre", "By manoeuvre", "What the driver did next.", report.by_manoeuvre),
        ("speed", "By speed", "The speed at the sample, where it is known.", report.by_speed),
        (
            "condition",
            "By light and weather",
            "As the scene's description says; what it does not mark is a dry day.",
            report.by_condition,
        ),
    )
    found = [group for group in groups if group[-1]]
    if not found:
        return Html()
    return join(
        note("The same samples cut into parts: where a method is good and where it is not."),
        *(
            join(
                element("h3", title),
                note(line),
                part_table(f"Top-10 and NLL {title.lower()}", parts),
                part_figures(anchor, title, parts, report.overall),
            )
            for anchor, title, line, parts in found
        ),
    )


def samples_section(cards: Mapping[str, Sequence[SampleCard]]) -> Html:
    """The samples that do not open the page; empty if there are none."""
    others = other_cards(cards)
    if not others:
        return Html()
    return join(
        note("They show what success and failure look like, not how often they happen."),
        folded(
            "How they are chosen",
            note(
                f"By the NLL of {MODEL}: best and worst are the two ends, of which the very first "
                "open the page; typical ones lie around the median. The best are taken where the "
                "car moves. A group takes no second sample of a scene while there are others."
            ),
        ),
        card_sections(others),
    )
