"""A report on a segmentation as text for a terminal."""

from rich.table import Table
from rich.text import Text

from shoot.evaluation.segmentation.results import ClassScores, Part, SegmentationReport
from shoot.metrics.bootstrap import name_groups
from shoot.report.cells import as_text, interval_cell, new_table, number, spaced

_FORM = "{:.1f}"


def format_segmentation(report: SegmentationReport, width: int = 80) -> str:
    """The report as text: classes with intervals, baselines, then parts without intervals.

    Args:
        report: What to show.
        width: Columns of the terminal.
    """
    return as_text((_class_table(report), _parts_table(report)), width)


def _class_table(report: SegmentationReport) -> Table:
    seen = f"; {report.num_seen_scenes} SEEN in training" if report.num_seen_scenes else ""
    table = new_table(
        f"Split '{report.split}': {report.num_samples} samples of {report.num_scenes} scenes "
        f"(95 % intervals over {name_groups(report.resampled, report.num_groups)}){seen}"
    )
    table.add_column("class", max_width=16)
    for header in (
        "IoU, %",
        "best\nthreshold",
        "IoU there, %",
        "average\nprecision, %",
        "cells, %",
    ):
        table.add_column(header, justify="right", no_wrap=True)
    _add_classes(table, report.classes)
    for name, classes in report.baselines.items():
        table.add_section()
        table.add_row(Text(spaced(name)))
        _add_classes(table, classes)
    return table


def _add_classes(table: Table, classes: dict[str, ClassScores]) -> None:
    for name, scores in classes.items():
        table.add_row(
            Text(spaced(name)),
            interval_cell(scores.iou, _FORM),
            number(scores.best_threshold, "{:.2f}"),
            interval_cell(scores.iou_at_best, _FORM),
            interval_cell(scores.average_precision, _FORM),
            number(scores.share_true, _FORM),
        )


def _parts_table(report: SegmentationReport) -> Table:
    table = new_table("Part by part: IoU, %")
    table.add_column("part", no_wrap=True)
    for header in ("samples", "scenes"):
        table.add_column(header, justify="right")
    for name in report.classes:
        table.add_column(Text(spaced(name)), justify="right", max_width=10)
    for parts in (report.by_distance, report.by_condition):
        table.add_section()
        for name, part in parts.items():
            table.add_row(name, *_part_cells(part))
    return table


def _part_cells(part: Part) -> list[str]:
    ious = (number(iou.value, _FORM) for iou in part.iou.values())
    return [str(part.num_samples), str(part.num_scenes), *ious]
