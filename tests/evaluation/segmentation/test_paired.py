"""Two reports are enough to say which run is better, and by how much."""

import json
from pathlib import Path

import numpy as np
import pytest

from lss_core.errors import DataError
from lss_core.grid import BevGrid
from shoot.evaluation.segmentation.counting import CellCounter
from shoot.evaluation.segmentation.paired import load_overlaps, paired_iou
from shoot.evaluation.segmentation.summary import summarise

GRID = BevGrid(-4.0, 4.0, -4.0, 4.0, 1.0)
NUM_SCENES = 8


def write_report(path: Path, skill: float, classes: tuple[str, ...] = ("car", "road")) -> Path:
    """Of the same scenes each time, some harder than others; skill is better than none."""
    generator = np.random.default_rng(0)
    shape = (NUM_SCENES, len(classes), *GRID.shape)
    truth = (generator.random(shape) < 0.3).astype(np.uint8)
    hard = np.linspace(0.2, 0.9, NUM_SCENES)[:, None, None, None]
    noise = hard * (generator.random(shape) - 0.5)
    prob = np.clip(0.5 + skill * (truth - 0.5) + noise, 0.0, 1.0)
    counter = CellCounter(np.arange(NUM_SCENES), len(classes), GRID)
    counter.add(prob, truth, np.arange(NUM_SCENES))
    names = [f"scene-{n}" for n in range(NUM_SCENES)]
    report = summarise(counter.counts(), classes, GRID, "val", names, ["day"] * NUM_SCENES)
    report.save(path)
    return path


def value_of(path: Path, name: str) -> float:
    value: float = json.loads(path.read_text())["classes"][name]["iou"]["value"]
    return value


def test_the_difference_is_that_of_the_reports(tmp_path: Path) -> None:
    good, bad = write_report(tmp_path / "good.json", 0.6), write_report(tmp_path / "bad.json", 0.3)
    difference = paired_iou([load_overlaps(good)], [load_overlaps(bad)])["car"]
    assert difference.value == pytest.approx(value_of(good, "car") - value_of(bad, "car"))
    assert difference.low > 0.0
    back = paired_iou([load_overlaps(bad)], [load_overlaps(good)])["car"]
    assert (back.value, back.low) == pytest.approx((-difference.value, -difference.high))
    # What makes a scene hard cancels.
    own = json.loads(good.read_text())["classes"]["car"]["iou"]
    other = json.loads(bad.read_text())["classes"]["car"]["iou"]
    apart = own["high"] - own["low"] + other["high"] - other["low"]
    assert difference.high - difference.low < apart


def test_of_several_runs_the_mean_counts(tmp_path: Path) -> None:
    paths = [write_report(tmp_path / f"{n}.json", skill) for n, skill in enumerate((0.6, 0.5, 0.3))]
    runs = [load_overlaps(path) for path in paths]
    first, second, third = (value_of(path, "road") for path in paths)
    found = paired_iou(runs[:2], runs[2:])["road"]
    assert found.value == pytest.approx(0.5 * (first + second) - third)
    assert paired_iou(runs, runs)["road"].excludes_zero is False


def test_only_what_both_have_is_compared(tmp_path: Path) -> None:
    both = load_overlaps(write_report(tmp_path / "both.json", 0.5))
    turned = load_overlaps(write_report(tmp_path / "turned.json", 0.5, ("lane", "car")))
    assert list(paired_iou([both], [turned])) == ["car"]
    other = load_overlaps(write_report(tmp_path / "other.json", 0.5, ("lane",)))
    with pytest.raises(DataError, match="no class"):
        paired_iou([both], [other])


def test_other_scenes_and_other_files_are_refused(tmp_path: Path) -> None:
    path = write_report(tmp_path / "report.json", 0.5)
    report = json.loads(path.read_text())
    changed = tmp_path / "changed.json"

    def write(**changes: object) -> Path:
        changed.write_text(json.dumps({**report, **changes}))
        return changed

    scenes = dict(list(report["by_scene"].items())[:-1])
    with pytest.raises(DataError, match="other scenes"):
        paired_iou([load_overlaps(path)], [load_overlaps(write(by_scene=scenes))])
    for wrong in (
        write(task="planning"),
        write(by_scene={}),
        write(by_scene={"a": {"num_samples": 1, "classes": {"car": {"true_positives": 1}}}}),
    ):
        with pytest.raises(DataError, match="no report of a segmentation"):
            load_overlaps(wrong)
    changed.write_text("[")
    with pytest.raises(DataError, match="no report of a segmentation"):
        load_overlaps(changed)
    with pytest.raises(DataError, match="cannot be read"):
        load_overlaps(tmp_path / "absent.json")
