"""From log-probabilities to a report: each number is what it says it is."""

import numpy as np
import pytest
from report_case import CHECKS, COMFORT, METRICS, check_against_wall, evaluate_scene, make_case

from shoot.evaluation.report import condition_of, evaluate
from shoot.metrics.bootstrap import interval
from shoot.metrics.calibration import measure_reliability
from shoot.metrics.comfort import measure_comfort
from shoot.metrics.ranks import TOP_KS, negative_log_likelihood, rank_labels


@pytest.fixture(scope="module")
def case():
    return make_case()


@pytest.fixture(scope="module")
def report(case):
    return evaluate(**case)


@pytest.fixture(scope="module")
def checked(case):
    return evaluate(**case, path_checks=check_against_wall)


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
        np.array([0.0, 5.0]),
    ).overall
    model = {name: metric.value for name, metric in report.methods["model"].items()}
    assert model["top1"] == 50.0
    assert model["top5"] == 100.0
    assert model["nll"] == pytest.approx(0.5 * np.log(16 / 3))
    assert model["min_ade_1"] == pytest.approx(2.5)  # 0 m and 5 m
    assert model["min_fde_5"] == pytest.approx(1.5)  # 0 m and 3 m
    assert model["miss_rate_1"] == 50.0
    assert model["brier"] == pytest.approx(0.5 * (2 * 0.25**2 + 2 * 0.75**2))
    # 0 m and 4 m to the templates; then 5 m and 3 m.
    assert model["expected_ade"] == pytest.approx(0.5 * (0.25 * 4.0 + 0.75 * 5.0 + 0.25 * 3.0))
    # Equally sure of both, so one bin: 75 % said, 50 % right.
    assert model["ece"] == pytest.approx(25.0)
    assert report.reliability["model"].count.tolist() == [2]
    # Paths of 0.25 s have no L2 at 1 s and no acceleration.
    assert not any(name.startswith("l2_") for name in model)
    assert np.isnan(model["comfort"])
    assert report.differences["prior"]["nll"].value == pytest.approx(0.5 * np.log(4 / 3))
    assert report.differences["prior"]["ece"].value == pytest.approx(25.0)
    assert report.differences["prior"]["top1"].value == 0.0  # the prior's tie is shared: 1 / 2 each
    assert report.oracle["ade"].value == pytest.approx(1.5)
    # Two scenes: both, one of them twice, or the other twice.
    assert (report.methods["model"]["top1"].low, report.methods["model"]["top1"].high) == (0, 100)


def test_numbers_are_those_of_metrics_and_bootstrap(case, report):
    labels, scene = case["labels"], case["scene_idx"]
    model = case["log_probs"]["model"]
    prior = np.tile(case["log_probs"]["prior"], (240, 1))
    hits = [100.0 * rank_labels(log_prob, labels).hits(10) for log_prob in (model, prior)]
    assert report.overall.methods["model"]["top10"] == interval(hits[0], scene)
    assert report.overall.differences["prior"]["top10"] == interval(hits[0] - hits[1], scene)
    nll = negative_log_likelihood(prior, labels)
    expected = interval(nll, scene)
    found = report.overall.methods["prior"]["nll"]
    assert (found.value, found.low, found.high) == pytest.approx(
        (expected.value, expected.low, expected.high)
    )
    bins = measure_reliability(np.exp(model).max(axis=1), rank_labels(model, labels).hits(1))
    np.testing.assert_allclose(report.overall.reliability["model"].accuracy, bins.accuracy)
    np.testing.assert_allclose(report.overall.reliability["model"].confidence, bins.confidence)


def test_who_says_nothing_hits_by_chance_and_is_calibrated(case):
    found = evaluate(**case | {"log_probs": {"model": np.full(30, -np.log(30.0))}}).overall
    for k in TOP_KS:
        assert found.methods["model"][f"top{k}"].value == pytest.approx(100.0 * k / 30)
    assert found.methods["model"]["ece"].value == pytest.approx(0.0, abs=1e-5)
    assert found.reliability["model"].accuracy.tolist() == pytest.approx([1 / 30])


def test_the_chosen_template_is_the_one_that_is_judged(case, checked):
    templates, futures, scene = case["templates"], case["futures"], case["scene_idx"]
    for name, log_prob in case["log_probs"].items():
        chosen = templates[np.broadcast_to(log_prob.argmax(axis=-1), 240)]
        found = checked.overall.methods[name]
        for key, values in (measure_comfort(chosen) | check_against_wall(chosen)).items():
            assert found[key].value == pytest.approx(np.nanmean(values)), key
        l2_m = np.linalg.norm(chosen - futures, axis=-1)
        assert found["l2_at_3s"].value == pytest.approx(l2_m[:, 11].mean())
        assert found["l2_upto_3s"].value == pytest.approx(l2_m[:, 1:12:2].mean())
    collision = check_against_wall(templates[case["log_probs"]["model"].argmax(axis=1)])[
        "collision_3s"
    ]
    expected = interval(collision[20:], scene[20:]).value
    assert 0.0 < expected < 100.0
    assert checked.overall.methods["model"]["collision_3s"].value == pytest.approx(expected)


def test_another_step_is_another_time(case, checked):
    """The same points at half the pace: what was at 1 s is at 2 s, and accelerations a quarter."""
    slow = evaluate(**case, path_checks=check_against_wall, dt_s=0.5).overall
    for which in ("methods", "differences"):
        for name, metrics in getattr(slow, which).items():
            usual = getattr(checked.overall, which)[name]
            assert metrics["l2_at_2s"].value == pytest.approx(usual["l2_at_1s"].value)
            assert metrics["lon_accel_mps2"].value == pytest.approx(
                usual["lon_accel_mps2"].value / 4.0, abs=1e-9
            )
            assert metrics["min_ade_10"] == usual["min_ade_10"]
    usual = checked.overall.driver["jerk_mps3"].value
    assert slow.driver["jerk_mps3"].value == pytest.approx(usual / 8.0)


def test_the_driver_is_judged_too(case, checked):
    assert set(checked.overall.driver) == {*CHECKS, *COMFORT}
    expected = check_against_wall(case["futures"]) | measure_comfort(case["futures"])
    for key, values in expected.items():
        assert checked.overall.driver[key].value == pytest.approx(np.nanmean(values)), key
    # None of the first scene's samples is checked.
    assert np.isnan(evaluate_scene(case, 50).overall.driver["collision_5s"].value)


def test_without_checks_nothing_is_said_of_them(report):
    assert report.overall.driver == {}
    for metrics in (*report.overall.methods.values(), *report.overall.differences.values()):
        assert not set(CHECKS) & set(metrics)


def test_a_broadcast_method_equals_one_written_out(case, report):
    written_out = np.tile(case["log_probs"]["prior"], (240, 1))
    log_probs = case["log_probs"] | {"prior": written_out}
    assert evaluate(**case | {"log_probs": log_probs}).to_json() == report.to_json()


def test_parts_add_up_to_the_whole(case, report):
    for parts, names in (
        (report.by_manoeuvre, {"standing", "straight"}),
        (report.by_condition, {"day", "rain"}),
        (report.by_speed, {"0-1 m/s", "1-5 m/s", "5-10 m/s", "over 10 m/s"}),
    ):
        assert set(parts) == names
        assert sum(part.num_samples for part in parts.values()) == 240
        for metric in METRICS:
            weighted = sum(p.num_samples * p.methods["model"][metric].value for p in parts.values())
            assert weighted / 240 == pytest.approx(report.overall.methods["model"][metric].value)
    assert report.by_condition["day"].num_scenes == 8
    assert report.by_manoeuvre["standing"].num_samples == np.sum(case["labels"] == 0)


def test_speeds_include_the_lower_end_and_empty_parts_are_left_out(case):
    speed_mps = np.tile([0.0, 0.999, 1.0, 4.999, 10.0, 30.0], 40)
    parts = evaluate(**case | {"speed_mps": speed_mps}).by_speed
    assert {name: part.num_samples for name, part in parts.items()} == {
        "0-1 m/s": 80,
        "1-5 m/s": 80,
        "over 10 m/s": 80,
    }


def test_without_a_model_there_are_no_differences(case):
    report = evaluate(**case | {"log_probs": {"prior": case["log_probs"]["prior"]}})
    assert report.overall.differences == {}
    assert set(report.overall.methods) == {"prior"}


class TestRefuses:
    def test_no_samples(self, case):
        per_sample = ("labels", "futures", "scene_idx", "conditions", "speed_mps")
        empty = {name: case[name][:0] for name in per_sample}
        with pytest.raises(ValueError, match="'val' has no samples"):
            evaluate(**case | empty)

    def test_lengths_that_differ(self, case):
        with pytest.raises(ValueError, match="240 labels, got 240, 240, 239 and 240"):
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
