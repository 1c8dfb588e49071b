import numpy as np
import pytest
from scipy.special import log_softmax

from shoot.baselines.kinematic import (
    constant_velocity_futures,
    constant_yaw_rate_futures,
    driving_on_log_prob,
    fit_sigma,
    future_log_prob,
    squared_distances,
    standing_still_log_prob,
)


class TestFutures:
    def test_constant_velocity_by_hand(self):
        futures = constant_velocity_futures(np.array([[2.0, -0.4], [0.0, 0.0]]), 1.0, 0.25)
        assert futures.shape == (2, 4, 2)
        np.testing.assert_allclose(futures[0], [[0.5, -0.1], [1.0, -0.2], [1.5, -0.3], [2, -0.4]])
        assert not futures[1].any()

    def test_paper_horizon_is_20_points(self):
        futures = constant_velocity_futures(np.array([[10.0, 0.0]]))
        assert futures.shape == (1, 20, 2)
        assert futures[0, 0].tolist() == pytest.approx([2.5, 0.0])
        assert futures[0, -1].tolist() == pytest.approx([50.0, 0.0])

    def test_a_quarter_circle_to_the_left_by_hand(self):
        # 20 m radius: pi / 2 x 20 m in 5 s.
        futures = constant_yaw_rate_futures(np.array([[2 * np.pi, 0.0]]), np.array([np.pi / 10]))
        assert futures[0, -1].tolist() == pytest.approx([20.0, 20.0])
        half = 20.0 * np.sqrt(0.5)
        assert futures[0, 9].tolist() == pytest.approx([half, 20.0 - half])

    def test_yaw_rate_agrees_with_small_steps_for_sideways_velocity_too(self):
        velocity, rate, step_s = np.array([5.0, 1.0]), -0.3, 1e-4
        turn = rate * step_s * (np.arange(50_000) + 0.5)
        rotation = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
        end = (rotation * velocity[None, :, None]).sum(1).sum(1) * step_s
        futures = constant_yaw_rate_futures(velocity[None], np.array([rate]))
        np.testing.assert_allclose(futures[0, -1], end, atol=1e-6)

    def test_a_tiny_rate_joins_the_straight_line(self):
        velocity = np.array([[7.0, 0.5]])
        nearly = constant_yaw_rate_futures(velocity, np.array([1e-9]))
        np.testing.assert_allclose(nearly, constant_velocity_futures(velocity), atol=1e-6)


class TestFutureLogProb:
    def test_distances_equal_the_plain_ones(self):
        generator = np.random.default_rng(1)
        futures, templates = (
            generator.uniform(-50, 50, (6, 20, 2)),
            generator.normal(size=(9, 20, 2)),
        )
        plain = ((futures[:, None] - templates) ** 2).sum((2, 3))
        np.testing.assert_allclose(squared_distances(futures, templates), plain)
        assert squared_distances(futures, futures).diagonal().min() >= 0.0

    def test_by_hand(self):
        templates = np.array([[[0.0, 0.0]], [[3.0, 4.0]]])
        log_prob = future_log_prob(np.zeros((1, 1, 2)), templates, sigma_m=5.0)
        odds = np.exp(-25.0 / 50.0)
        np.testing.assert_allclose(np.exp(log_prob), [[1 / (1 + odds), odds / (1 + odds)]])

    def test_wide_sigma_leaves_the_prior(self):
        prior = np.log([0.7, 0.2, 0.1])
        templates = np.random.default_rng(2).normal(size=(3, 20, 2))
        log_prob = future_log_prob(np.zeros((2, 20, 2)), templates, 1e6, prior)
        np.testing.assert_allclose(log_prob, [prior, prior], atol=1e-6)

    @pytest.mark.parametrize("with_prior", [False, True])
    def test_fitted_sigma_beats_a_grid_and_finds_the_truth(self, with_prior):
        generator = np.random.default_rng(3)
        templates = generator.uniform(-5.0, 5.0, (60, 4, 2))
        futures = generator.uniform(-5.0, 5.0, (5000, 4, 2))
        prior = log_softmax(generator.normal(size=60)) if with_prior else None
        # Draw the labels from the model itself (Gumbel noise), with sigma 2.
        log_prob = future_log_prob(futures, templates, 2.0, prior)
        labels = (log_prob + generator.gumbel(size=log_prob.shape)).argmax(1)
        sigma_m = fit_sigma(futures, templates, labels, prior)
        assert sigma_m == pytest.approx(2.0, rel=0.05)

        def nll(sigma):
            log_prob = future_log_prob(futures[::2], templates, sigma, prior)
            return -log_prob[np.arange(2500), labels[::2]].mean()  # as fit_sigma thins 5000

        assert nll(sigma_m) <= min(nll(sigma_m * factor) for factor in (0.9, 0.99, 1.01, 1.1))

    def test_no_samples_are_refused(self):
        with pytest.raises(ValueError, match="at least one training sample"):
            fit_sigma(np.zeros((0, 20, 2)), np.zeros((3, 20, 2)), np.zeros(0, dtype=int))


class TestStandingStill:
    # Ends 0 m, 3 m and 6 m ahead; squared distances from the origin 0, 9 and 36.
    templates = np.array([[[6.0, 0.0]], [[0.0, 0.0]], [[3.0, 0.0]]])

    def test_ranks_templates_by_how_little_they_move(self):
        log_prob = standing_still_log_prob(self.templates, np.array([1, 1, 2, 0]))
        assert log_prob.argsort()[::-1].tolist() == [1, 2, 0]
        assert np.exp(log_prob).sum() == pytest.approx(1.0)

    def test_sigma_makes_the_mean_squared_distance_that_of_the_labels(self):
        # Where the NLL is smallest, expected and driven distance agree: (0 + 0 + 9 + 36) / 4.
        log_prob = standing_still_log_prob(self.templates, np.array([1, 1, 2, 0]))
        assert np.exp(log_prob) @ [36.0, 0.0, 9.0] == pytest.approx(45.0 / 4.0, abs=1e-2)

    def test_no_samples_are_refused(self):
        with pytest.raises(ValueError, match="at least one training sample"):
            standing_still_log_prob(self.templates, np.zeros(0, dtype=int))


class TestDrivingOn:
    generator = np.random.default_rng(4)
    templates = generator.uniform(-5.0, 5.0, (30, 4, 2))
    paths = generator.uniform(-5.0, 5.0, (200, 4, 2))
    prior = log_softmax(generator.normal(size=30))
    known = np.arange(200) % 4 > 0
    labels = squared_distances(paths + generator.normal(size=paths.shape), templates).argmin(1)

    def test_where_motion_is_known_it_is_the_distribution_around_the_path(self):
        everywhere = np.ones(200, dtype=bool)
        log_prob = driving_on_log_prob(
            self.paths, everywhere, self.labels, self.paths[:9], everywhere[:9], self.templates,
            self.prior,
        )  # fmt: skip
        sigma_m = fit_sigma(self.paths, self.templates, self.labels)
        expected = future_log_prob(self.paths[:9], self.templates, sigma_m)
        np.testing.assert_allclose(log_prob, expected)

    def test_elsewhere_it_is_the_prior_and_sigma_does_not_suffer(self):
        # Where nothing is known the path is 0, which says nothing of the label.
        paths = np.where(self.known[:, None, None], self.paths, 0.0)
        told = driving_on_log_prob(
            paths, self.known, self.labels, paths, self.known, self.templates, self.prior
        )
        np.testing.assert_array_equal(told[~self.known], np.tile(self.prior, (50, 1)))
        sigma_m = fit_sigma(self.paths[self.known], self.templates, self.labels[self.known])
        expected = future_log_prob(self.paths[self.known], self.templates, sigma_m)
        np.testing.assert_allclose(told[self.known], expected)
        assert fit_sigma(paths, self.templates, self.labels) > 1.2 * sigma_m

    def test_known_nowhere_in_training_leaves_the_prior(self):
        nowhere = np.zeros(200, dtype=bool)
        log_prob = driving_on_log_prob(
            self.paths, nowhere, self.labels, self.paths[:2], ~nowhere[:2], self.templates,
            self.prior,
        )  # fmt: skip
        np.testing.assert_array_equal(log_prob, [self.prior, self.prior])
