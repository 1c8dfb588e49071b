import logging
from dataclasses import replace

import numpy as np
import pytest
import torch

from shoot.baselines import past_motion
from shoot.baselines.folds import scene_folds
from shoot.baselines.past_motion import fit_past_motion, motion_inputs
from shoot.baselines.prior import fit_prior
from shoot.baselines.speed_prior import fit_speed_prior
from shoot.trajectories import DT_S, Futures

NUM_TEMPLATES = 6
TEMPLATES = np.random.default_rng(98).normal(0.0, 10.0, (NUM_TEMPLATES, 20, 2))


def _arcs(speed_mps, yaw_rate_radps, known_steps=8, scene=None):
    """Samples that have been on an arc for two seconds; their futures are noise."""
    num = len(speed_mps)
    angle = -yaw_rate_radps[:, None] * DT_S * np.arange(1, 9)
    ahead_m = -speed_mps[:, None] * DT_S * np.arange(1, 9) * np.sinc(angle / np.pi)
    aside_m = ahead_m * np.tan(angle / 2)
    known = np.arange(8) < np.broadcast_to(known_steps, num)[:, None]
    moves = known[:, 0]
    return Futures(
        xy_m=np.random.default_rng(99).normal(size=(num, 20, 2)),
        scene=np.arange(num) // 10 if scene is None else scene,
        sample=np.arange(num),
        velocity_mps=np.stack([speed_mps * moves, np.zeros(num)], axis=-1),
        yaw_rate_radps=yaw_rate_radps * moves,
        past_xy_m=np.where(known[..., None], np.stack([ahead_m, aside_m], axis=-1), 0.0),
        past_known=known,
        num_left_out=0,
    )


def _turning(num, seed):
    """Labels tell whether the ego has been turning right, not at all, or left; speed says nothing.

    Templates 3 to 5 are never driven.
    """
    generator = np.random.default_rng(seed)
    turn = generator.integers(-1, 2, num)
    futures = _arcs(
        generator.uniform(2.0, 12.0, num),
        0.25 * turn + generator.normal(0.0, 0.02, num),
        generator.integers(2, 9, num),
    )
    return futures, turn + 1


def _nll(log_prob, labels):
    return -log_prob[np.arange(len(labels)), labels].mean()


@pytest.fixture(scope="module")
def fit():
    return fit_past_motion(*_turning(600, seed=0), TEMPLATES)


@pytest.fixture
def one_epoch(monkeypatch):
    """For what does not depend on how much is learned."""
    monkeypatch.setattr(past_motion, "MAX_EPOCHS", 1)


class TestInputs:
    def test_by_hand(self):
        futures = _arcs(np.array([2.0]), np.array([0.0]), known_steps=2)
        # 0.4 m in the last quarter second (1.6 m/s), 0.6 m and 0.1 m aside in the one before.
        past = futures.past_xy_m.copy()
        past[0, :2] = [[-0.4, 0.0], [-1.0, -0.1]]
        futures = replace(futures, past_xy_m=past, yaw_rate_radps=np.array([0.3]))
        inputs = motion_inputs(futures)[0].tolist()
        assert inputs[:3] == pytest.approx([2.0, np.arcsinh(10.0), 0.3])
        assert inputs[3:11] == [1.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]
        assert inputs[11:15] == pytest.approx([-0.4, 0.0, 0.4, 0.4], abs=1e-6)
        assert inputs[15:] == [0.0] * 12

    def test_where_the_recording_begins_nothing_is_known(self):
        inputs = motion_inputs(_arcs(np.array([8.0, 8.0]), np.array([0.1, 0.1]), np.array([0, 1])))
        assert not inputs[0].any()
        assert inputs[1].any()

    def test_steady_driving_is_no_change(self):
        inputs = motion_inputs(_arcs(np.array([9.0]), np.array([0.0])))
        torch.testing.assert_close(inputs[0, 11:], torch.zeros(16), atol=1e-5, rtol=0.0)


def test_finds_labels_that_depend_on_past_curvature_where_speed_finds_none(fit):
    train, train_labels = _turning(600, seed=0)
    new, labels = _turning(1000, seed=1)
    nll = _nll(fit.log_prob(new), labels)
    by_speed = fit_speed_prior(
        np.linalg.norm(train.velocity_mps, axis=1), np.ones(600, dtype=bool), train_labels,
        train.scene, NUM_TEMPLATES,
    )  # fmt: skip
    speed_mps = np.linalg.norm(new.velocity_mps, axis=1)
    speed_nll = _nll(by_speed.of(speed_mps, np.ones(1000, dtype=bool)), labels)
    assert speed_nll > np.log(3.0) - 0.05
    assert nll < 0.1
    assert fit.held_out_nll == pytest.approx(nll, abs=0.1)


def test_finds_labels_that_only_the_earlier_past_tells():
    # All drive 8 m/s straight on now; some were slower until a second ago. None stands out before.
    generator = np.random.default_rng(5)
    sped_up = generator.integers(0, 2, 1200)
    futures = _arcs(np.full(1200, 8.0), np.zeros(1200))
    past = futures.past_xy_m.copy()
    past[:, 4:, 0] += sped_up[:, None] * 0.5 * np.arange(1, 5)
    futures = replace(futures, past_xy_m=past)
    fit = fit_past_motion(futures, sped_up, TEMPLATES[:2])
    assert fit.held_out_nll < 0.1 < np.log(2.0)


def test_a_template_never_driven_learns_from_its_neighbours(monkeypatch):
    monkeypatch.setattr(past_motion, "MAX_EPOCHS", 10)
    # Straight on at 0.5 m/s, 1.5 m/s ... 19.5 m/s; nobody in training drives near 10.5 m/s.
    line = np.stack([DT_S * np.arange(1, 21), np.zeros(20)], axis=-1)
    templates = (0.5 + np.arange(20))[:, None, None] * line
    speed_mps = np.random.default_rng(8).uniform(0.0, 20.0, 600)
    speed_mps = speed_mps[speed_mps.astype(int) != 10]
    futures = _arcs(speed_mps, np.zeros(len(speed_mps)))
    fit = fit_past_motion(futures, speed_mps.astype(int), templates)
    log_prob = fit.log_prob(_arcs(np.array([10.5]), np.zeros(1)))[0]
    assert log_prob[10] > log_prob[np.abs(np.arange(20) - 10) > 2].max() + 1.0
    assert log_prob[10] > fit_prior(speed_mps.astype(int), futures.scene, 20)[10] + 1.0


def test_is_a_distribution_finite_for_templates_never_driven(fit):
    futures, _ = _turning(50, seed=2)
    extreme = replace(futures, velocity_mps=1e3 * futures.velocity_mps)
    for asked in (futures, extreme):
        log_prob = fit.log_prob(asked)
        assert log_prob.shape == (50, NUM_TEMPLATES)
        assert np.isfinite(log_prob).all()
        np.testing.assert_allclose(np.exp(log_prob.astype(np.float64)).sum(1), 1.0, atol=1e-5)


def test_the_future_changes_nothing(one_epoch):
    train, labels = _turning(200, seed=0)
    fit = fit_past_motion(train, labels, TEMPLATES)
    again = fit_past_motion(replace(train, xy_m=7.0 * train.xy_m + 3.0), labels, TEMPLATES)
    new, _ = _turning(20, seed=3)
    other_future = replace(new, xy_m=-new.xy_m)
    np.testing.assert_array_equal(again.log_prob(other_future), fit.log_prob(new))


def test_the_past_does_change_something(fit):
    new, _ = _turning(20, seed=3)
    mirrored = replace(
        new, past_xy_m=new.past_xy_m * [1.0, -1.0], yaw_rate_radps=-new.yaw_rate_radps
    )
    assert not np.allclose(fit.log_prob(mirrored), fit.log_prob(new), atol=0.1)


def test_seed_decides_all_and_leaves_torch_alone(one_epoch):
    train, labels = _turning(200, seed=0)
    new, _ = _turning(20, seed=3)
    fit = fit_past_motion(train, labels, TEMPLATES)
    torch.manual_seed(1)
    before = torch.random.get_rng_state()
    again = fit_past_motion(train, labels, TEMPLATES)
    assert torch.equal(torch.random.get_rng_state(), before)
    np.testing.assert_array_equal(again.log_prob(new), fit.log_prob(new))
    other = fit_past_motion(train, labels, TEMPLATES, seed=1)
    assert not np.array_equal(other.log_prob(new), fit.log_prob(new))


def test_past_that_says_nothing_stops_it_early():
    train, _ = _turning(1500, seed=0)
    labels = np.random.default_rng(6).integers(0, 3, 1500)
    fit = fit_past_motion(train, labels, TEMPLATES)
    new, _ = _turning(1000, seed=1)
    new_labels = np.random.default_rng(7).integers(0, 3, 1000)
    assert fit.held_out_nll < np.log(3.0) + 0.02
    assert _nll(fit.log_prob(new), new_labels) < np.log(3.0) + 0.05


def test_all_folds_choose_the_epochs():
    train, labels = _turning(1500, seed=0)
    # Labels are noisy, those of the first fold nothing else: each epoch is worse for it, but better
    # for the other four.
    generator = np.random.default_rng(12)
    noise = (generator.random(1500) < 0.3) | (scene_folds(train.scene) == 0)
    noisy = np.where(noise, generator.integers(0, 3, 1500), labels)
    assert fit_past_motion(train, noisy, TEMPLATES).epochs >= 2
    # Every scene has its own way: nothing that is learned holds for others.
    each = generator.permuted(np.tile(np.arange(3), (150, 1)), axis=1)
    assert fit_past_motion(train, each[train.scene, labels], TEMPLATES).epochs <= 1


def test_says_the_mean_of_its_networks_which_is_less_of_a_draw(monkeypatch):
    monkeypatch.setattr(past_motion, "MAX_EPOCHS", 6)
    new, labels = _turning(200, seed=3)
    # Labels that are hard to tell, so that networks differ.
    train, train_labels = _turning(600, seed=4)
    noise = np.random.default_rng(10).random(600) < 0.4
    noisy = np.where(noise, np.random.default_rng(11).integers(0, 3, 600), train_labels)
    fits = [fit_past_motion(train, noisy, TEMPLATES, seed) for seed in range(2)]
    inputs = motion_inputs(new)
    alone = [[np.exp(net.log_prob(inputs).numpy()) for net in fit.nets] for fit in fits]
    means = [np.exp(fit.log_prob(new)) for fit in fits]
    for mean, members in zip(means, alone, strict=True):
        assert len(members) == 5
        np.testing.assert_allclose(mean, np.mean(members, axis=0), atol=1e-5)
        # The mean is better than what its members reach on average, as -log is convex.
        rows = np.arange(200), labels
        nll = [-np.log(prob[rows]).mean() for prob in members]
        assert -np.log(mean[rows]).mean() < np.mean(nll)
    apart = np.abs(means[0] - means[1]).mean()
    assert apart < 0.7 * np.abs(alone[0][0] - alone[1][0]).mean()


def test_one_scene_stays_at_the_prior():
    train, labels = _turning(200, seed=0)
    train = replace(train, scene=np.zeros(200, dtype=int))
    fit = fit_past_motion(train, labels, TEMPLATES)
    expected = fit_prior(labels, train.scene, NUM_TEMPLATES)
    np.testing.assert_allclose(fit.log_prob(train), np.tile(expected, (200, 1)), atol=1e-5)
    assert (fit.epochs, np.isnan(fit.held_out_nll)) == (0, True)


def test_two_scenes_hold_out_one_another():
    train, labels = _turning(400, seed=0)
    train = replace(train, scene=np.arange(400) // 200)
    fit = fit_past_motion(train, labels, TEMPLATES)
    new, new_labels = _turning(200, seed=1)
    assert _nll(fit.log_prob(new), new_labels) < 0.3


def test_says_what_it_chose(caplog, one_epoch):
    train, labels = _turning(200, seed=4)
    with caplog.at_level(logging.INFO):
        fit = fit_past_motion(train, labels, TEMPLATES)
    assert f"Past motion: {fit.epochs} epochs, NLL {fit.held_out_nll:.3f} on" in caplog.text


def test_no_labels_are_refused():
    train, labels = _turning(10, seed=0)
    with pytest.raises(ValueError, match="at least one training label"):
        fit_past_motion(train.select(np.zeros(10, dtype=bool)), labels[:0], TEMPLATES)
