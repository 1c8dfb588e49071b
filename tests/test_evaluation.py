import json

import numpy as np
import pytest
from scipy.special import log_softmax

from shoot.bootstrap import interval, paired_interval
from shoot.evaluation import condition_of, evaluate, format_table
from shoot.metrics import TOP_KS, negative_log_likelihood, ranks

METRICS = (
    [f"top{k}" for k in TOP_KS]
    + ["nll"]
    + [f"{name}_{k}" for name in ("min_ade", "min_fde", "miss_rate") for k in TOP_KS]
)


@pytest.mark.parametrize(
    ("description", "condition"),
    [
        ("Parking lot, barrier, exit parking lot", "day"),
        ("", "day"),
        ("Night, big street, bus stop", "night"),
        ("wait at crosswalk at NIGHT", "night"),
        ("Rain, parked cars", "rain"),
        ("Night, rain, wet road", "night rain"),
        ("heavy raining at dusk", "dusk rain"),
        ("Dusk, intersection", "dusk"),
        ("Overnight parking, train station, terrain", "day"),
    ],
)
def test_condition_of(description, condition):
    assert condition_of(description) == condition


@pytest.fixture(scope="module")
def case():
    """240 samples of 12 scenes: standing and straight, day and rain."""
    generator = np.random.default_rng(0)
    time_s = 0.25 * np.arange(1, 21)
    speeds = np.linspace(0.0, 12.0, 30)
    line = np.stack([time_s, 0.0 * time_s], axis=-1)
    templates = (speeds[:, None, None] * line).astype(np.float32)
    labels = np.where(generator.random(240) < 0.3, 0, generator.integers(1, 30, 240))
    futures = templates[labels] + generator.normal(0.0, 0.02, (240, 20, 2)).astype(np.float32)
    logits = generator.normal(size=(240, 30))
    logits[np.arange(240), labels] += 2.0
    scene_idx = np.repeat(np.arange(12), 20) + 50
    return {
        "log_probs": {
            "model": log_softmax(logits, axis=1).astype(np.float32),
            "prior": log_softmax(generator.normal(size=30)),
        },
        "labels": labels,
        "futures": futures,
        "templates": templates,
        "scene_idx": scene_idx,
        "conditions": ["day" if scene < 58 else "rain" for scene in scene_idx],
        "split": "val",
    }


@pytest.fixture(scope="module")
def report(case):
    return evaluate(**case)


def test_by_hand():
    """Two templates, ahead by 1 m and by 5 m; the model is right once, in one scene of two."""
    templates = np.array([[[1.0, 0.0]], [[5.0, 0.0]]])
    futures = np.array([[[1.0, 0.0]], [[5.0, 3.0]]])
    sure = np.log([[0.75, 0.25], [0.75, 0.25]])
    report = evaluate(
        {"model": sure, "prior": np.log([0.5, 0.5])},
        np.array([0, 1]),
        futures,
        templates,
        np.array([0, 1]),
        ["day", "day"],
        "val",
    ).overall
    model = {name: metric.value for name, metric in report.methods["model"].items()}
    assert model["top1"] == 50.0
    assert model["top5"] == 100.0
    assert model["nll"] == pytest.approx(0.5 * np.log(16 / 3))
    assert model["min_ade_1"] == pytest.approx(2.5)  # 0 m and 5 m
    assert model["min_fde_5"] == pytest.approx(1.5)  # 0 m and 3 m
    assert model["miss_rate_1"] == 50.0
    assert report.differences["prior"]["nll"].value == pytest.approx(0.5 * np.log(4 / 3))
    assert report.differences["prior"]["top1"].value == 0.0  # the prior's tie goes to template 0
    assert report.oracle["ade"].value == pytest.approx(1.5)
    # Two scenes: both, one of them twice, or the other twice.
    assert (report.methods["model"]["top1"].low, report.methods["model"]["top1"].high) == (0, 100)


def test_numbers_are_those_of_metrics_and_bootstrap(case, report):
    labels, scene = case["labels"], case["scene_idx"]
    model = case["log_probs"]["model"]
    prior = np.tile(case["log_probs"]["prior"], (240, 1))
    hits = [100.0 * (ranks(log_prob, labels) < 10) for log_prob in (model, prior)]
    assert report.overall.methods["model"]["top10"] == interval(hits[0], scene)
    assert report.overall.differences["prior"]["top10"] == paired_interval(*hits, scene)
    nll = negative_log_likelihood(prior, labels)
    assert report.overall.methods["prior"]["nll"] == interval(nll, scene)


def test_a_broadcast_method_equals_one_written_out(case, report):
    written_out = np.tile(case["log_probs"]["prior"], (240, 1))
    log_probs = case["log_probs"] | {"prior": written_out}
    assert evaluate(**case | {"log_probs": log_probs}) == report


def test_parts_add_up_to_the_whole(case, report):
    for parts, names in (
        (report.by_manoeuvre, {"standing", "straight"}),
        (report.by_condition, {"day", "rain"}),
    ):
        assert set(parts) == names
        assert sum(part.num_samples for part in parts.values()) == 240
        for metric in METRICS:
            weighted = sum(p.num_samples * p.methods["model"][metric].value for p in parts.values())
            assert weighted / 240 == pytest.approx(report.overall.methods["model"][metric].value)
    assert report.by_condition["day"].num_scenes == 8
    assert report.by_manoeuvre["standing"].num_samples == np.sum(case["labels"] == 0)


def test_report_json_has_the_agreed_form(report, tmp_path):
    path = tmp_path / "new" / "report.json"
    report.save(path)
    loaded = json.loads(path.read_text())
    assert loaded == report.to_json()
    assert (loaded["split"], loaded["num_samples"], loaded["num_scenes"]) == ("val", 240, 12)
    assert set(loaded["methods"]) == {"model", "prior"}
    assert set(loaded["differences"]) == {"prior"}
    for metrics in (*loaded["methods"].values(), *loaded["differences"].values()):
        assert set(metrics) == set(METRICS)
        for metric in metrics.values():
            assert set(metric) == {"value", "low", "high"}
            assert metric["low"] <= metric["value"] <= metric["high"]
    assert set(loaded["oracle"]) == {"ade", "fde", "miss_rate"}
    assert loaded["by_condition"]["rain"]["methods"]["model"]["top10"]["value"] > 0.0
    assert set(loaded["by_manoeuvre"]["standing"]) == {
        "num_samples",
        "num_scenes",
        "methods",
        "differences",
        "oracle",
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


def test_without_a_model_there_are_no_differences(case):
    report = evaluate(**case | {"log_probs": {"prior": case["log_probs"]["prior"]}})
    assert report.overall.differences == {}
    assert set(report.overall.methods) == {"prior"}


def test_table_shows_methods_differences_and_parts_in_80_columns(report):
    text = format_table(report)
    lines = text.splitlines()
    assert max(map(len, lines)) <= 80
    top10 = report.overall.methods["model"]["top10"]
    assert any(line.split()[:1] == ["model"] and f"{top10.value:.1f}" in line for line in lines)
    assert f"[{top10.low:.1f}, {top10.high:.1f}]" in text
    difference = report.overall.differences["prior"]["nll"]
    assert f"[{difference.low:+.2f}, {difference.high:+.2f}]" in text
    assert {"standing", "straight", "day", "rain"} <= {line.split()[0] for line in lines if line}


class TestRefuses:
    def test_no_samples(self, case):
        per_sample = ("labels", "futures", "scene_idx", "conditions")
        empty = {name: case[name][:0] for name in per_sample}
        with pytest.raises(ValueError, match="'val' has no samples"):
            evaluate(**case | empty)

    def test_lengths_that_differ(self, case):
        with pytest.raises(ValueError, match="240 labels, got 240, 240 and 239"):
            evaluate(**case | {"conditions": case["conditions"][1:]})

    def test_scores_that_are_no_log_probabilities(self, case):
        scores = case["log_probs"]["model"] + 1.0
        with pytest.raises(ValueError, match="'model' must give log-probabilities"):
            evaluate(**case | {"log_probs": {"model": scores}})

    def test_a_diverged_model(self, case):
        diverged = case["log_probs"]["model"].copy()
        diverged[3] = np.nan
        with pytest.raises(ValueError, match="diverged"):
            evaluate(**case | {"log_probs": {"model": diverged}})

    def test_other_templates(self, case):
        fewer = {"model": case["log_probs"]["model"][:, 1:]}
        with pytest.raises(ValueError, match=r"shape \(240, 30\) or \(30,\), got \(240, 29\)"):
            evaluate(**case | {"log_probs": fewer})

    def test_probability_zero_for_what_was_driven(self, case):
        never = np.full(30, -np.inf)
        never[0] = 0.0
        with pytest.raises(ValueError, match="'prior' gives probability 0"):
            evaluate(**case | {"log_probs": {"prior": never}})
