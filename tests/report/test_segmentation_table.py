"""The table of a segmentation fits a terminal and says what the report says."""

from dataclasses import replace

import numpy as np

from shoot.evaluation.segmentation.results import ClassScores, Part, SegmentationReport
from shoot.metrics.bootstrap import Interval
from shoot.report.segmentation_table import format_segmentation

SURE, ALONE = Interval(32.06, 30.1, 34.0), Interval(7.25, np.nan, np.nan)
NONE = Interval(np.nan, np.nan, np.nan)
SCORES = ClassScores(SURE, 0.43, ALONE, NONE, 2.5)
CLASSES = ("car", "vehicle", "drivable", "lane_boundary")
REPORT = SegmentationReport(
    split="val",
    rule="centre",
    cell_m=0.5,
    num_samples=6019,
    num_scenes=150,
    num_groups=150,
    classes=dict.fromkeys(CLASSES, SCORES),
    by_distance={"0-10 m": Part(6019, 150, dict.fromkeys(CLASSES, SURE))},
    by_condition={"night rain": Part(40, 1, dict.fromkeys(CLASSES, NONE))},
    by_scene={},
    baselines={"prior_map": dict.fromkeys(CLASSES, SCORES)},
)


def test_numbers_stand_where_they_belong() -> None:
    text = format_segmentation(REPORT)
    lines = [line.split() for line in text.splitlines()]
    assert max(len(line) for line in text.splitlines()) <= 80
    assert text.count("[30.1, 34.0]") == 2 * len(CLASSES)
    assert ["car", "32.1", "0.43", "7.2", "-", "2.5"] in lines
    assert ["0-10", "m", "6019", "150", *["32.1"] * 4] in lines
    assert ["night", "rain", "40", "1", *["-"] * 4] in lines
    assert "prior map" in text
    assert "intervals over scenes" in text


def test_seen_scenes_and_logs_are_told() -> None:
    report = replace(REPORT, resampled="logs", num_groups=15, num_seen_scenes=3)
    text = " ".join(format_segmentation(report).split())
    assert "15 logs" in text
    assert "3 SEEN in training" in text
