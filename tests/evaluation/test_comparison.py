from dataclasses import replace

import numpy as np
import pytest
from world_fixture import NUM_TEMPLATES, TinyRun

from shoot.baselines import fit_past_motion
from shoot.evaluation.comparison import Scored, baseline_log_probs, score, sum_up
from shoot.evaluation.known_speed import tell_speed
from shoot.prediction.run import TrainedRun, open_run, predict
from shoot.training.planning.data import LabelledSplit
from shoot.training.planning.motion import TrainingMotion

SAME_FOR_ALL = ("prior", "standing_still", "blind")


@pytest.fixture(scope="module")
def trained(tiny_run: TinyRun) -> TrainedRun:
    return open_run(tiny_run.folder)


@pytest.fixture(scope="module")
def train(trained: TrainedRun) -> TrainingMotion:
    return TrainingMotion.load(trained.folder.motion_file, trained.templates)


@pytest.fixture(scope="module")
def scored(trained: TrainedRun) -> Scored:
    return score(trained, "val")


def test_every_method_is_a_distribution_for_every_sample(scored: Scored) -> None:
    num_samples = len(scored.samples.labels)
    for name, log_prob in scored.log_probs.items():
        shape = (NUM_TEMPLATES,) if name in SAME_FOR_ALL else (num_samples, NUM_TEMPLATES)
        assert log_prob.shape == shape, name
        assert np.isfinite(log_prob).all(), name
        np.testing.assert_allclose(np.exp(log_prob, dtype=np.float64).sum(-1), 1.0, atol=1e-5)


def test_the_model_is_the_run_and_is_told_the_speed_that_the_speed_prior_knows(
    trained: TrainedRun, scored: Scored
) -> None:
    said = scored.log_probs
    expected = predict(trained, scored.samples)
    np.testing.assert_array_equal(said["model"], expected)
    told = tell_speed(said["model"], said["speed_prior"], said["prior"])
    np.testing.assert_array_equal(said["model_knowing_speed"], told)


def test_where_a_recording_begins_no_method_knows_a_speed(scored: Scored) -> None:
    begins = ~scored.samples.futures.past_known[:, 0]
    assert begins.sum() == len(set(scored.samples.scene_names))
    for name in ("speed_prior", "constant_velocity", "constant_yaw_rate"):
        rows = scored.log_probs[name]
        np.testing.assert_array_equal(
            rows[begins], np.tile(scored.log_probs["prior"], (begins.sum(), 1))
        )
    for name in ("constant_velocity", "constant_yaw_rate"):
        rows = scored.log_probs[name][~begins]
        assert not np.isclose(rows, scored.log_probs["prior"]).all(axis=1).any()
    np.testing.assert_allclose(
        scored.log_probs["model_knowing_speed"][begins],
        scored.log_probs["model"][begins],
        atol=1e-5,
    )


def test_baselines_see_nothing_of_the_split_but_each_samples_own_past(
    trained: TrainedRun, train: TrainingMotion, scored: Scored
) -> None:
    # Other futures, other labels, and half of the samples left out: the rest is told the same.
    samples = scored.samples
    half = np.arange(len(samples.labels)) % 2 == 0
    futures = replace(samples.futures, xy_m=-3.0 * samples.futures.xy_m[::-1]).select(half)
    other = LabelledSplit(samples.index, futures, (samples.labels[half] + 5) % NUM_TEMPLATES)
    past_motion = fit_past_motion(train.past, train.labels, trained.templates.points)
    told = baseline_log_probs(train, other, trained.templates, trained.module.planner, past_motion)
    assert set(told) == set(scored.log_probs) - {"model", "model_knowing_speed"}
    for name, log_prob in told.items():
        expected = scored.log_probs[name]
        expected = expected if name in SAME_FOR_ALL else expected[half]
        np.testing.assert_allclose(log_prob, expected, rtol=1e-5, err_msg=name)


def test_scenes_add_up_to_all_samples(trained: TrainedRun, scored: Scored) -> None:
    report = sum_up(trained, scored, "val")
    assert report.by_scene.keys() == set(scored.samples.scene_names)
    counts = [scene["num_samples"] for scene in report.by_scene.values()]
    assert sum(counts) == report.overall.num_samples
    for metric in ("top10", "nll"):
        means = [scene[metric] for scene in report.by_scene.values()]
        whole = report.overall.methods["model"][metric].value
        assert np.average(means, weights=counts) == pytest.approx(whole)
    assert report.to_json()["by_scene"] == report.by_scene
