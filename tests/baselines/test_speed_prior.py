import logging

import numpy as np
import pytest

from shoot.baselines.folds import scene_folds
from shoot.baselines.prior import fit_prior
from shoot.baselines.speed_prior import (
    NUM_MOVING_BINS,
    STANDING_MPS,
    STRENGTHS,
    SpeedPrior,
    fit_speed_prior,
)


def _everywhere(speed_mps):
    return np.ones(len(speed_mps), dtype=bool)


def _drive(num, seed, num_templates=40):
    """Labels that follow from the speed alone: 0 when standing, else one of two near the speed."""
    generator = np.random.default_rng(seed)
    speed_mps = np.where(generator.random(num) < 0.2, 0.0, generator.uniform(0.5, 15.0, num))
    near = 1 + (speed_mps / 15.0 * (num_templates - 2)).astype(int)
    labels = np.where(speed_mps == 0.0, 0, near + generator.integers(0, 2, num))
    return speed_mps, labels


def test_by_hand():
    # Two scenes say the same, so the choice is known to fall on the weakest prior and, as there are
    # but two speeds, on the fewest bins that tell them apart.
    speed_mps = np.tile([0.0, 0.0, 0.1, 5.0, 5.0, 5.0, 5.0, 5.0], 2)
    labels = np.tile([0, 0, 0, 1, 1, 1, 1, 2], 2)
    scene = np.repeat([7, 9], 8)
    fit = fit_speed_prior(speed_mps, _everywhere(speed_mps), labels, scene, 3)
    prior = np.exp(fit.log_prior)
    assert fit.edges_mps.tolist() == [STANDING_MPS]
    assert fit.strength == 1.0
    np.testing.assert_allclose(np.exp(fit.log_prob[0]), (np.array([6, 0, 0]) + prior) / 7)
    np.testing.assert_allclose(np.exp(fit.log_prob[1]), (np.array([0, 8, 2]) + prior) / 11)


def test_speeds_fall_into_bins_by_their_lower_edge():
    log_prob = np.log([[0.8, 0.2], [0.5, 0.5], [0.1, 0.9]])
    prior = SpeedPrior(np.array([0.2, 6.0]), log_prob, np.log([0.4, 0.6]), 1.0, 0.0)
    speed_mps = np.array([0.0, 0.19, 0.2, 5.99, 6.0, 80.0])
    got = prior.of(speed_mps, _everywhere(speed_mps))
    np.testing.assert_array_equal(got, log_prob[[0, 0, 1, 1, 2, 2]])


def test_finds_labels_that_depend_on_speed_alone():
    speed_mps, labels = _drive(4000, seed=0)
    scene = np.arange(4000) // 20
    fit = fit_speed_prior(speed_mps, _everywhere(speed_mps), labels, scene, 40)
    new_speed_mps, new_labels = _drive(4000, seed=1)
    log_prob = fit.of(new_speed_mps, _everywhere(new_speed_mps))
    nll = -log_prob[np.arange(4000), new_labels].mean()
    at_best = 0.8 * np.log(2.0)  # standing is certain, the rest a coin
    prior_nll = -fit.log_prior[new_labels].mean()
    assert at_best < nll < at_best + 0.35
    assert prior_nll > at_best + 2.0
    assert fit.held_out_nll == pytest.approx(nll, abs=0.05)
    np.testing.assert_allclose(np.exp(log_prob).sum(1), 1.0)


def test_speed_that_says_nothing_leaves_the_prior():
    generator = np.random.default_rng(2)
    speed_mps = generator.uniform(0.0, 15.0, 2000)
    labels = generator.choice(30, 2000, p=generator.dirichlet(np.ones(30)))
    scene = np.arange(2000) // 20
    fit = fit_speed_prior(speed_mps, _everywhere(speed_mps), labels, scene, 30)
    assert fit.strength >= 300.0 or len(fit.edges_mps) == 1
    assert np.abs(np.exp(fit.log_prob[1:]) - np.exp(fit.log_prior)).max() < 0.03


def test_choice_is_the_best_of_a_plain_loop():
    speed_mps, labels = _drive(300, seed=3)
    known = np.arange(300) % 10 > 0
    scene = np.arange(300) // 10
    fold = scene_folds(scene)

    def held_out_nll(num_bins, strength):
        total = 0.0
        for left_out in range(5):
            fitted = (fold != left_out) & known
            moving = speed_mps[fitted & (speed_mps >= STANDING_MPS)]
            edges = [STANDING_MPS, *(np.quantile(moving, i / num_bins) for i in range(1, num_bins))]
            prior = np.exp(fit_prior(labels[fold != left_out], scene[fold != left_out], 40))
            for s in np.flatnonzero((fold == left_out) & known):
                below = sum(speed_mps[s] >= edge for edge in edges)
                low, high = [0.0, *edges, np.inf][below : below + 2]
                own = fitted & (speed_mps >= low) & (speed_mps < high)
                hits = (labels[own] == labels[s]).sum()
                total -= np.log((hits + strength * prior[labels[s]]) / (own.sum() + strength))
        return total / known.sum()

    nll = {(b, s): held_out_nll(b, s) for b in NUM_MOVING_BINS for s in STRENGTHS}
    num_bins, strength = min(nll, key=nll.get)
    fit = fit_speed_prior(speed_mps, known, labels, scene, 40)
    assert (len(fit.edges_mps), fit.strength) == (num_bins, strength)
    assert fit.held_out_nll == pytest.approx(nll[num_bins, strength])


def test_where_speed_is_not_known_it_is_the_prior_and_is_not_counted_as_standing():
    speed_mps, labels = _drive(1000, seed=4)
    known = np.arange(1000) % 5 > 0
    scene = np.arange(1000) // 5
    fit = fit_speed_prior(np.where(known, speed_mps, 0.0), known, labels, scene, 40)
    np.testing.assert_array_equal(fit.log_prior, fit_prior(labels, scene, 40))
    got = fit.of(np.zeros(2), np.array([True, False]))
    np.testing.assert_array_equal(got[1], fit.log_prior)
    assert np.exp(got[0, 0]) > 0.9
    speed_now_unknown_elsewhere = np.where(known, speed_mps, 3.0)
    again = fit_speed_prior(speed_now_unknown_elsewhere, known, labels, scene, 40)
    np.testing.assert_array_equal(again.log_prob, fit.log_prob)


@pytest.mark.parametrize("known", [True, False])
def test_one_scene_or_no_speed_still_give_distributions(known):
    speed_mps, labels = _drive(50, seed=5)
    is_known = np.full(50, known)
    for scene in (np.zeros(50), np.arange(50) // 10):
        fit = fit_speed_prior(speed_mps, is_known, labels, scene, 40)
        assert np.isfinite(fit.held_out_nll) == (known and scene.any())
        np.testing.assert_allclose(np.exp(fit.log_prob).sum(1), 1.0)
        assert np.isfinite(fit.log_prob).all()


def test_says_what_it_chose(caplog):
    speed_mps, labels = _drive(200, seed=6)
    with caplog.at_level(logging.INFO):
        fit = fit_speed_prior(speed_mps, _everywhere(speed_mps), labels, np.arange(200) // 10, 40)
    expected = f"Speed prior: {len(fit.edges_mps) + 1} bins, prior worth {fit.strength:g} samples"
    assert expected in caplog.text
    assert f"NLL {fit.held_out_nll:.3f} on" in caplog.text


def test_no_labels_are_refused():
    nothing = np.zeros(0)
    with pytest.raises(ValueError, match="at least one training label"):
        fit_speed_prior(nothing, nothing.astype(bool), nothing.astype(int), nothing, 3)
