"""A run asked under one condition: what it scores there, and in each scene."""

from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

from run_queue import Record

from lss_core.data.samples import load_index, rows_of_split
from lss_core.data.usable import Needs
from robustness_table.conditions import Condition
from shoot.evaluation.comparison import means_by_scene
from shoot.evaluation.segmentation.scoring import score_segmentation
from shoot.metrics.bootstrap import interval
from shoot.metrics.ranks import negative_log_likelihood, rank_labels
from shoot.prediction.run import open_run, predict
from shoot.prediction.segmenter import open_segmenter
from shoot.training.planning.data import label_rows
from shoot.training.segmentation.data import label_segments

SPLIT = "val"


def ask(task: str, folder: Path, condition: Condition, every: int) -> Record:
    """Scores with 95 % intervals over scenes, and what two such are compared by.

    Args:
        task: `segmentation` or `planning`.
        folder: Of the run.
        condition: How it is asked.
        every: Every so many samples of the validation scenes are asked about.
    """
    return {"segmentation": _segment, "planning": _plan}[task](folder, condition, every)


def _segment(folder: Path, condition: Condition, every: int) -> dict[str, Any]:
    run = open_segmenter(folder, cameras=condition.cameras)
    run = replace(run, disturbance=condition.disturbance)
    told = run.config
    index = load_index(told.data.root, told.data.version, told.data.cameras)
    rows = rows_of_split(index, told.data.root, told.data.version, SPLIT)[::every]
    samples = label_segments(index, rows, told.data, told.model.grid, told.classes, told.rule)
    report = score_segmentation(run, samples, SPLIT)
    return {
        "scores": {name: asdict(scores.iou) for name, scores in report.classes.items()},
        "by_scene": report.to_json()["by_scene"],
    }


def _plan(folder: Path, condition: Condition, every: int) -> dict[str, Any]:
    run = open_run(folder, cameras=condition.cameras)
    run = replace(run, disturbance=condition.disturbance)
    data = run.config.data
    index = load_index(data.root, data.version, data.cameras)
    rows = rows_of_split(index, data.root, data.version, SPLIT)[::every]
    samples = label_rows(index, rows, data, run.templates, Needs())
    log_prob = predict(run, samples)
    scores = {
        "top10": 100.0 * rank_labels(log_prob, samples.labels).hits(10),
        "nll": negative_log_likelihood(log_prob, samples.labels),
    }
    return {
        "scores": {
            name: asdict(interval(values, samples.scene_names)) for name, values in scores.items()
        },
        "by_scene": means_by_scene(samples, log_prob),
    }
