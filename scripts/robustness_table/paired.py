"""What a run has over the plain one, asked alike: paired differences, from records alone."""

from dataclasses import asdict
from pathlib import Path

from planning_table.cells import paired, value_cell
from run_queue import read_json

from robustness_table.conditions import PLAIN
from shoot.evaluation.segmentation.paired import load_overlaps, paired_iou


def asked_file(folder: Path, task: str, run: str, condition: str) -> Path:
    """Where the record of a run under a condition is."""
    return folder / f"{task}-{run}-{condition.replace(' ', '')}.json"


def gain_cell(folder: Path, task: str, metric: str, run: str, condition: str) -> str:
    """The run minus the plain one with its interval over scenes; `-` if one was not asked.

    Args:
        folder: Of the records.
        task: Of both.
        metric: A class of a segmentation, `top10` or `nll` of a planner.
        run: The run.
        condition: How both were asked.
    """
    own, plain = (asked_file(folder, task, it, condition) for it in (run, PLAIN))
    if not (own.exists() and plain.exists()):
        return "-"
    if task == "planning":
        return paired([read_json(own)], [read_json(plain)], metric)
    gain = paired_iou([load_overlaps(own)], [load_overlaps(plain)])[metric]
    return value_cell(asdict(gain), "iou", sign=True)
