import json

import numpy as np
import pytest
from scipy.special import log_softmax

from shoot.evaluation.report import condition_of, evaluate
from shoot.metrics.bootstrap import interval, paired_interval
from shoot.metrics.calibration import measure_reliability
from shoot.metrics.comfort import measure_comfort
from shoot.metrics.ranks import TOP_KS, negative_log_likelihood, rank_labels
from shoot.report.html import PageDetails, render_page
from shoot.report.terminal import format_table

COMFORT = ["lon_accel_mps2", "lat_accel_mps2", "jerk_mps3", "comfort"]
CHECKS = [f"{what}_{s}s" for what in ("collision", "off_road") for s in (1, 2, 3, 5)]
METRICS = (
    [f"top{k}" for k in TOP_KS]
    + ["nll", "brier", "expected_ade"]
    + [f"{name}_{k}" for name in ("min_ade", "min_fde", "miss_rate") for k in TOP_KS]
    + [f"l2_{how}_{s}s" for how in ("at", "upto") for s in (1, 2, 3)]
    + COMFORT
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
        "speed_mps": speeds[labels] + generator.uniform(0.0, 0.5, 240),
    }


@pytest.fixture(scope="module")
def report(case):
    return evaluate(**case)


def _path_checks(paths):
    """A wall across the road at x = 20 m; the first 20 samples are not checked."""
    found = {}
    for seconds in (1, 2, 3, 5):
        hit = 100.0 * (paths[:, : 4 * seconds, 0].max(axis=1) > 20.0)
        hit[:20] = np.nan
        found |= {f"collision_{seconds}s": hit, f"off_road_{seconds}s": 0.0 * hit}
    return found


@pytest.fixture(scope="module")
def checked(case):
    return evaluate(**case, path_checks=_path_checks)


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
    assert report.overall.differences["prior"]["top10"] == paired_interval(*hits, scene)
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
        for key, values in (measure_comfort(chosen) | _path_checks(chosen)).items():
            assert found[key].value == pytest.approx(np.nanmean(values)), key
        l2_m = np.linalg.norm(chosen - futures, axis=-1)
        assert found["l2_at_3s"].value == pytest.approx(l2_m[:, 11].mean())
        assert found["l2_upto_3s"].value == pytest.approx(l2_m[:, 1:12:2].mean())
    collision = _path_checks(templates[case["log_probs"]["model"].argmax(axis=1)])["collision_3s"]
    expected = interval(collision[20:], scene[20:]).value
    assert 0.0 < expected < 100.0
    assert checked.overall.methods["model"]["collision_3s"].value == pytest.approx(expected)


def test_another_step_is_another_time(case, checked):
    """The same points at half the pace: what was at 1 s is at 2 s, and accelerations a quarter."""
    slow = evaluate(**case, path_checks=_path_checks, dt_s=0.5).overall
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


@pytest.mark.parametrize(
    ("num_points", "dt_s", "shown"),
    [(20, 0.25, "3 s"), (8, 0.25, "2 s"), (10, 0.5, "3 s"), (5, 0.4, "2 s"), (6, 0.3, None)],
)
def test_table_shows_the_latest_moment_that_there_is(case, num_points, dt_s, shown):
    shorter = {name: case[name][:, :num_points] for name in ("futures", "templates")}
    text = " ".join(format_table(evaluate(**case | shorter, dt_s=dt_s)).split())
    said = f"L2: distance of the most probable template at {shown}"
    assert said in text if shown else "L2" not in text
    assert ("mean L2" in text) == (dt_s in (0.25, 0.5))


def test_the_driver_is_judged_too(case, checked):
    assert set(checked.overall.driver) == {*CHECKS, *COMFORT}
    expected = _path_checks(case["futures"]) | measure_comfort(case["futures"])
    for key, values in expected.items():
        assert checked.overall.driver[key].value == pytest.approx(np.nanmean(values)), key
    # None of the first scene's samples is checked.
    assert np.isnan(evaluate_scene(case, 50).overall.driver["collision_5s"].value)


def evaluate_scene(case, scene):
    keep = case["scene_idx"] == scene
    log_probs = {"model": case["log_probs"]["model"][keep]}
    arrays = {
        name: case[name][keep] for name in ("labels", "futures", "scene_idx", "speed_mps")
    } | {"conditions": ["day"] * int(keep.sum())}
    return evaluate(**case | arrays | {"log_probs": log_probs}, path_checks=_path_checks)


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


class TestLogs:
    """12 scenes of 4 logs, the last of which has only one of them."""

    logs = np.repeat(["a", "a", "a", "a", "a", "b", "b", "b", "c", "c", "c", "d"], 20)

    @pytest.fixture(scope="class")
    def by_log(self, case):
        return evaluate(**case, logs=self.logs)

    def test_are_drawn_whole_and_means_stay(self, case, report, by_log):
        labels = case["labels"]
        hits = 100.0 * rank_labels(case["log_probs"]["model"], labels).hits(10)
        prior = np.tile(case["log_probs"]["prior"], (240, 1))
        prior_hits = 100.0 * rank_labels(prior, labels).hits(10)
        found = by_log.overall
        assert found.methods["model"]["top10"] == interval(hits, self.logs)
        assert found.methods["model"]["top10"] != report.overall.methods["model"]["top10"]
        assert found.differences["prior"]["top10"] == paired_interval(hits, prior_hits, self.logs)
        for name, metric in report.overall.methods["model"].items():
            assert found.methods["model"][name].value == pytest.approx(metric.value)

    def test_are_counted_and_named(self, report, by_log):
        loaded = by_log.to_json()
        assert (loaded["resampled"], loaded["num_scenes"], loaded["num_groups"]) == ("logs", 12, 4)
        assert loaded["by_condition"]["rain"]["num_groups"] == 2
        loaded = report.to_json()
        assert (loaded["resampled"], loaded["num_groups"]) == ("scenes", 12)

    def test_are_named_in_the_table_and_on_the_page(self, report, by_log):
        titles = [" ".join(format_table(found).split()) for found in (by_log, report)]
        assert "240 samples of 12 scenes (95 % intervals over 4 logs)" in titles[0]
        assert "240 samples of 12 scenes (95 % intervals over scenes)" in titles[1]
        details = PageDetails("run", "last", "data", "now", 30)
        pages = [render_page(found, {}, details) for found in (by_log, report)]
        assert "240 of 12 scenes of 4 logs" in pages[0]
        assert "95 % intervals over 4 logs: whole logs are drawn again" in pages[0]
        assert "logs" not in pages[1]
        assert "95 % intervals over scenes: whole scenes are drawn again" in pages[1]

    def test_one_alone_has_no_interval_though_it_has_scenes(self, case):
        found = evaluate(**case, logs=np.full(240, "a"))
        assert np.isnan(found.overall.methods["model"]["top10"].low)
        page = render_page(found, {}, PageDetails("run", "last", "data", "now", 30))
        assert "one log only" in page


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
    first = {line.split()[0] for line in lines if line}
    assert {"standing", "straight", "day", "rain", "0-1", "over"} <= first
    assert not {"driver", "crash"} & set(text.split())


def _driving_row(text, name):
    """The method's row in the second table."""
    rows = text[text.index("Calibration, distances, safety") :].splitlines()
    return next(line.split()[1:] for line in rows if line.split()[:1] == [name])


def test_table_shows_distances_and_safety(checked):
    text = format_table(checked)
    model = {key: metric.value for key, metric in checked.overall.methods["model"].items()}
    assert _driving_row(text, "model") == [
        f"{model['ece']:.1f}",
        f"{model['brier']:.2f}",
        f"{model['expected_ade']:.2f}",
        f"{model['min_ade_10']:.2f}",
        f"{model['l2_at_3s']:.2f}",
        f"{model['l2_upto_3s']:.2f}",
        f"{model['collision_3s']:.1f}",
        f"{model['off_road_3s']:.1f}",
        f"{model['comfort']:.0f}",
    ]
    driver = checked.overall.driver
    assert _driving_row(text, "driver") == [
        f"{driver['collision_3s'].value:.1f}",
        "0.0",
        f"{driver['comfort'].value:.0f}",
    ]


def test_table_of_nine_methods_fits_80_columns_and_shows_the_best_part_by_part(case):
    generator = np.random.default_rng(1)
    names = ["blind", "constant_velocity", "constant_yaw_rate", "ego_status_network", "a", "b", "c"]
    log_probs = case["log_probs"] | {
        name: log_softmax(generator.normal(size=(240, 30)), axis=1) for name in names
    }
    log_probs["b"], log_probs["constant_yaw_rate"] = [case["log_probs"]["model"]] * 2
    text = format_table(evaluate(**case | {"log_probs": log_probs}, path_checks=_path_checks))
    lines = text.splitlines()
    assert max(map(len, lines)) <= 80
    assert "\N{HORIZONTAL ELLIPSIS}" not in text  # nothing is cut off
    header = lines[next(i for i, line in enumerate(lines) if "Part by part" in line) + 2 :][:2]
    assert {"model", "prior", "yaw", "b"} <= set(" ".join(header).split())
    assert not {"blind", "network", "a"} & set(" ".join(header).split())


def test_table_shows_what_does_not_apply_as_a_dash(case):
    text = format_table(evaluate_scene(case, 50))
    assert _driving_row(text, "model")[-3:-1] == ["-", "-"]
    assert "nan" not in text


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
