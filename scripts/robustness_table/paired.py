"""What one asking has over another: paired differences, from records alone."""

from dataclasses import asdict
from pathlib import Path

from planning_table.cells import paired, value_cell
from run_queue import read_json

from shoot.evaluation.segmentation.paired import load_overlaps, paired_iou


def asked_file(folder: Path, task: str, run: str, condition: str) -> Path:
    """Where the record of a run under a condition is."""
    return folder / f"{task}-{run}-{condition.replace(' ', '')}.json"


def gain_cell(
    folder: Path, task: str, metric: str, asked: tuple[str, str], base: tuple[str, str]
) -> str:
    """The one minus the other with its interval over scenes; `-` if one of them was not asked.

    Args:
        folder: Of the records.
        task: Of both.
        metric: A class of a segmentation, `top10` or `nll` of a planner.
        asked: The run, and the condition it was asked under.
        base: The same of the other.
    """
    own, other = (asked_file(folder, task, *of) for of in (asked, base))
    if not (own.exists() and other.exists()):
        return "-"
    if task == "planning":
        return paired([read_json(own)], [read_json(other)], metric)
    gain = paired_iou([load_overlaps(own)], [load_overlaps(other)])[metric]
    return value_cell(asdict(gain), "iou", sign=True)
