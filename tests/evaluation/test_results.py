"""The form of report.json."""

import json

import numpy as np
import pytest
from report_case import METRICS, make_case

from shoot.evaluation.report import evaluate
from shoot.report.terminal import format_table


@pytest.fixture(scope="module")
def case():
    return make_case()


@pytest.fixture(scope="module")
def report(case):
    return evaluate(**case)


def test_report_json_has_the_agreed_form(report, tmp_path):
    path = tmp_path / "new" / "report.json"
    report.save(path)
    loaded = json.loads(path.read_text())
    assert loaded == report.to_json()
    assert (loaded["split"], loaded["num_samples"], loaded["num_scenes"]) == ("val", 240, 12)
    assert set(loaded["methods"]) == {"model", "prior"}
    assert set(loaded["differences"]) == {"prior"}
    for metrics in (*loaded["methods"].values(), *loaded["differences"].values()):
        assert set(metrics) == {*METRICS, "ece"}
        for name, metric in metrics.items():
            assert set(metric) == {"value", "low", "high"}
            assert metric["low"] <= metric["high"]
            # Noise makes ECE larger, so that the value may lie below its draws.
            assert name == "ece" or metric["low"] <= metric["value"] <= metric["high"]
    assert loaded["driver"] == {}
    assert set(loaded["reliability"]) == {"model", "prior"}
    assert {key: len(bins) for key, bins in loaded["reliability"]["model"].items()} == {
        "confidence": 10,
        "accuracy": 10,
        "count": 10,
    }
    assert loaded["by_speed"]["0-1 m/s"]["methods"]["prior"]["brier"]["value"] > 0.0
    assert set(loaded["oracle"]) == {"ade", "fde", "miss_rate"}
    assert loaded["by_condition"]["rain"]["methods"]["model"]["top10"]["value"] > 0.0
    assert set(loaded["by_manoeuvre"]["standing"]) == {
        "num_samples",
        "num_scenes",
        "num_groups",
        "methods",
        "differences",
        "oracle",
        "driver",
        "reliability",
    }
    assert [entry.name for entry in path.parent.iterdir()] == ["report.json"]


def test_one_scene_is_valid_json_without_bounds(case, tmp_path):
    one = evaluate(**case | {"scene_idx": np.zeros(240, dtype=int)})
    one.save(tmp_path / "report.json")
    top10 = json.loads((tmp_path / "report.json").read_text())["methods"]["model"]["top10"]
    assert top10["value"] > 0.0
    assert top10["low"] is None
    assert top10["high"] is None
    assert "[" not in format_table(one)
