"""From maps to a report: counts in rings and scenes, scores of sums, intervals, parts."""

import json
from pathlib import Path

import numpy as np
import pytest

from lss_core.grid import BevGrid
from shoot.evaluation.segmentation.counting import (
    CellCounter,
    CellCounts,
    name_rings,
    rings_of_cells,
)
from shoot.evaluation.segmentation.summary import summarise
from shoot.metrics.overlap import count_overlap, iou

GRID = BevGrid(-12.0, 12.0, -8.0, 8.0, 2.0)
CLASSES = ("car", "drivable")
SCENES = np.array([7, 7, 3, 9, 9, 9])
NAMES, CONDITIONS = ["scene-3", "scene-7", "scene-9"], ["day", "night", "day"]


def make_maps(seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    generator = np.random.default_rng(seed)
    shape = (len(SCENES), len(CLASSES), *GRID.shape)
    truth = (generator.random(shape) < 0.3).astype(np.uint8)
    prob = np.clip(generator.random(shape) * 0.7 + 0.3 * truth, 0.0, 1.0)
    return prob.astype(np.float32), truth


def count(prob: np.ndarray, truth: np.ndarray) -> CellCounts:
    counter = CellCounter(SCENES, len(CLASSES), GRID)
    for batch in (slice(0, 4), slice(4, 6)):
        counter.add(prob[batch], truth[batch], SCENES[batch])
    return counter.counts()


def test_rings_by_hand() -> None:
    """Cells of 2 m: centres at odd metres, so (7, 7) is 9.9 m off and (9, 5) 10.3 m."""
    rings = rings_of_cells(GRID)
    assert rings.shape == (12, 8)
    assert rings[6 + 3, 4 + 3] == 0
    assert rings[6 + 4, 4 + 2] == 1
    assert (rings == rings[::-1]).all()
    assert (rings == rings[:, ::-1]).all()
    assert name_rings(GRID) == ["0-10 m", "10-20 m"]


def test_counts_are_of_the_right_scene_and_ring() -> None:
    prob, truth = make_maps()
    counts = count(prob, truth)
    assert counts.scene.tolist() == [3, 7, 9]
    assert counts.num_samples.tolist() == [1, 2, 3]
    near = rings_of_cells(GRID) == 0
    for n, scene in enumerate(counts.scene):
        for c in range(len(CLASSES)):
            said, true = prob[scene == SCENES, c] >= 0.5, truth[scene == SCENES, c] == 1
            for ring, cells in ((0, near), (1, ~near)):
                expected = [
                    (both & cells).sum() for both in (said & true, said & ~true, ~said & true)
                ]
                assert counts.by_ring[n, c, ring].tolist() == expected
    # Rings together are all cells.
    assert (counts.by_ring.sum(axis=2) == count_overlap(counts.by_probability)).all()


def test_report_is_one_intersection_over_one_union() -> None:
    prob, truth = make_maps()
    report = summarise(count(prob, truth), CLASSES, GRID, "val", NAMES, CONDITIONS)
    for c, name in enumerate(CLASSES):
        said, true = prob[:, c] >= 0.5, truth[:, c] == 1
        scores = report.classes[name]
        assert scores.iou.value == pytest.approx(100 * (said & true).sum() / (said | true).sum())
        assert scores.iou.low <= scores.iou.value <= scores.iou.high
        assert scores.iou_at_best.value >= scores.iou.value
        assert scores.share_true == pytest.approx(100 * true.mean())
        assert scores.average_precision.value > scores.share_true
        night = SCENES == 7
        at_night = 100 * (said & true)[night].sum() / (said | true)[night].sum()
        assert report.by_condition["night"].iou[name].value == pytest.approx(at_night)
    assert (report.by_condition["day"].num_samples, report.by_condition["day"].num_scenes) == (4, 2)
    # One scene tells nothing of others.
    assert np.isnan(report.by_condition["night"].iou["car"].low)
    assert list(report.by_distance) == ["0-10 m", "10-20 m"]
    assert report.num_samples == 6


def test_a_baseline_stands_beside_the_model_on_the_same_draws() -> None:
    prob, truth = make_maps()
    ours, same = count(prob, truth), count(prob, truth)
    worse = count(np.full_like(prob, 0.5), truth)
    baselines = {"same": same, "everything": worse}
    report = summarise(ours, CLASSES, GRID, "val", NAMES, CONDITIONS, baselines=baselines)
    for name in CLASSES:
        none = report.differences["same"][name]["average_precision"]
        assert (none.value, none.low, none.high) == (0.0, 0.0, 0.0)
        everything = report.baselines["everything"][name]
        assert everything.iou.value == pytest.approx(report.classes[name].share_true)
        less = report.differences["everything"][name]["iou"]
        assert less.value == pytest.approx(report.classes[name].iou.value - everything.iou.value)


def test_scenes_of_one_log_are_drawn_together() -> None:
    counts = count(*make_maps())
    report = summarise(counts, CLASSES, GRID, "val", NAMES, CONDITIONS, logs=["a", "b", "a"])
    assert (report.resampled, report.num_groups) == ("logs", 2)
    assert report.by_scene["scene-9"].log == "a"
    with pytest.raises(ValueError, match="3 scenes"):
        summarise(counts, CLASSES, GRID, "val", NAMES[:2], CONDITIONS)


def test_json_says_what_the_report_does(tmp_path: Path) -> None:
    prob, truth = make_maps()
    truth[:, 0] = 0  # no car anywhere
    report = summarise(count(prob, truth), CLASSES, GRID, "val", NAMES, CONDITIONS)
    report.save(tmp_path / "report.json")
    stored = json.loads((tmp_path / "report.json").read_text())
    assert stored["task"] == "segmentation"
    assert list(stored["classes"]) == list(CLASSES)
    found = stored["classes"]["drivable"]["iou"]
    assert found == {
        key: getattr(report.classes["drivable"].iou, key) for key in ("value", "low", "high")
    }
    assert stored["classes"]["car"]["iou"]["value"] == 0.0
    assert stored["classes"]["car"]["average_precision"]["value"] is None
    cells = stored["by_scene"]["scene-7"]["classes"]["drivable"]
    assert list(cells) == ["true_positives", "false_positives", "false_negatives"]
    of_all = sum(
        np.array(list(scene["classes"]["drivable"].values()))
        for scene in stored["by_scene"].values()
    )
    assert float(iou(of_all)) == pytest.approx(found["value"])
    assert "log" not in stored["by_scene"]["scene-7"]
    parts = stored["by_distance"]["0-10 m"], stored["by_condition"]["day"]
    assert all(0.0 < part["classes"]["drivable"]["iou"]["value"] < 100.0 for part in parts)
