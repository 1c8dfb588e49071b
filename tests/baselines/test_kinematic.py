import numpy as np
import pytest
from scipy.special import log_softmax

from shoot.baselines.kinematic import (
    Spread,
    along_heading,
    constant_velocity_futures,
    constant_yaw_rate_futures,
    driving_on_log_prob,
    fit_spread,
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

    def test_in_a_bend_the_velocity_of_now_is_along_the_heading_of_now(self):
        # A circle to the left, 10 m of radius, at 5 m/s: 0.5 rad/s. Over the last half second the
        # ego moved along a chord, which in its frame of now points an eighth of a radian right.
        speed, rate = 5.0 * np.sinc(0.125 / np.pi), 0.5
        mean = np.array([[speed * np.cos(0.125), -speed * np.sin(0.125)]])
        now = along_heading(mean)
        np.testing.assert_allclose(now, [[speed, 0.0]], atol=1e-12)
        angle = rate * 0.25 * np.arange(1, 21)
        circle = 10.0 * np.stack([np.sin(angle), 1.0 - np.cos(angle)], axis=-1)
        futures = constant_yaw_rate_futures(now, np.array([rate]))[0]
        lagging = constant_yaw_rate_futures(mean, np.array([rate]))[0]
        assert np.abs(futures - circle).max() < 0.06  # the chord is a 400th shorter
        assert np.abs(lagging - circle).max() > 1.0

    def test_backing_and_standing_by_hand(self):
        velocity = np.array([[-3.0, 4.0], [0.0, 0.0], [-0.6, -0.8], [1.2, -0.5]])
        expected = [[-5.0, 0.0], [0.0, 0.0], [-1.0, 0.0], [1.3, 0.0]]
        np.testing.assert_allclose(along_heading(velocity), expected)

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
        log_prob = future_log_prob(np.zeros((1, 1, 2)), templates, Spread(1.0, 4.0))
        odds = np.exp(-25.0 / 50.0)
        np.testing.assert_allclose(np.exp(log_prob), [[1 / (1 + odds), odds / (1 + odds)]])

    def test_the_same_distance_says_more_the_earlier_it_is(self):
        # 1 m off at the first, second or fourth of four points.
        templates = np.zeros((4, 4, 2))
        templates[[1, 2, 3], [0, 1, 3], [0, 1, 0]] = 1.0
        spread = Spread(always_m=1.0, grown_m=16.0)
        np.testing.assert_allclose(spread.sigma_m(4), [2.0, 5.0, 10.0, 17.0])
        log_prob = future_log_prob(np.zeros((1, 4, 2)), templates, spread)[0]
        np.testing.assert_allclose(log_prob[1:] - log_prob[0], [-0.5 / 4, -0.5 / 25, -0.5 / 289])
        alike = future_log_prob(np.zeros((1, 4, 2)), templates, Spread(2.0, 0.0))[0]
        np.testing.assert_allclose(alike[1:] - alike[0], [-0.125] * 3)

    def test_wide_spread_leaves_the_prior(self):
        prior = np.log([0.7, 0.2, 0.1])
        templates = np.random.default_rng(2).normal(size=(3, 20, 2))
        log_prob = future_log_prob(np.zeros((2, 20, 2)), templates, Spread(1e6, 0.0), prior)
        np.testing.assert_allclose(log_prob, [prior, prior], atol=1e-6)

    @pytest.mark.parametrize("with_prior", [False, True])
    def test_fitted_spread_beats_a_grid_and_finds_the_truth(self, with_prior):
        generator = np.random.default_rng(3)
        templates = generator.uniform(-5.0, 5.0, (60, 4, 2))
        futures = generator.uniform(-5.0, 5.0, (5000, 4, 2))
        prior = log_softmax(generator.normal(size=60)) if with_prior else None
        # Draw the labels from the model itself (Gumbel noise), with sigma 1.2 m to 4 m.
        truth = Spread(1.0, 3.0)
        log_prob = future_log_prob(futures, templates, truth, prior)
        labels = (log_prob + generator.gumbel(size=log_prob.shape)).argmax(1)
        spread = fit_spread(futures, templates, labels, prior)
        np.testing.assert_allclose(spread.sigma_m(4), truth.sigma_m(4), rtol=0.15)

        def nll(always_m, grown_m):
            asked = Spread(always_m, grown_m)
            log_prob = future_log_prob(futures[::5], templates, asked, prior)
            return -log_prob[np.arange(1000), labels[::5]].mean()  # as fit_spread thins 5000

        least = nll(spread.always_m, spread.grown_m)
        for factor in (0.9, 0.98, 1.02, 1.1):
            assert least <= nll(spread.always_m * factor, spread.grown_m)
            assert least <= nll(spread.always_m, spread.grown_m * factor)
        assert least < min(nll(sigma_m, 0.0) for sigma_m in np.arange(1.0, 4.0, 0.1)) - 0.05

    def test_no_samples_are_refused(self):
        with pytest.raises(ValueError, match="at least one training sample"):
            fit_spread(np.zeros((0, 20, 2)), np.zeros((3, 20, 2)), np.zeros(0, dtype=int))


class TestStandingStill:
    # Ends 0 m, 3 m and 6 m ahead; squared distances from the origin 0, 9 and 36.
    templates = np.array([[[6.0, 0.0]], [[0.0, 0.0]], [[3.0, 0.0]]])

    def test_ranks_templates_by_how_little_they_move(self):
        log_prob = standing_still_log_prob(self.templates, np.array([1, 1, 2, 0]))
        assert log_prob.argsort()[::-1].tolist() == [1, 2, 0]
        assert np.exp(log_prob).sum() == pytest.approx(1.0)

    def test_spread_makes_the_mean_squared_distance_that_of_the_labels(self):
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
        spread = fit_spread(self.paths, self.templates, self.labels)
        expected = future_log_prob(self.paths[:9], self.templates, spread)
        np.testing.assert_allclose(log_prob, expected)

    def test_with_the_prior_it_weighs_templates_where_motion_is_known_too(self):
        # Labels that follow the prior alone: it must not be lost beside the paths.
        generator = np.random.default_rng(5)
        labels = (self.prior + generator.gumbel(size=(200, 30))).argmax(1)
        told = {
            with_prior: driving_on_log_prob(
                self.paths, self.known, labels, self.paths, self.known, self.templates, self.prior,
                with_prior,
            )
            for with_prior in (False, True)
        }  # fmt: skip
        nll = {key: -rows[np.arange(200), labels].mean() for key, rows in told.items()}
        assert nll[True] == pytest.approx(-self.prior[labels].mean(), abs=0.02)
        assert nll[True] < nll[False] - 0.1
        np.testing.assert_array_equal(told[True][~self.known], told[False][~self.known])

    def test_elsewhere_it_is_the_prior_and_the_spread_does_not_suffer(self):
        # Where nothing is known the path is 0, which says nothing of the label.
        paths = np.where(self.known[:, None, None], self.paths, 0.0)
        told = driving_on_log_prob(
            paths, self.known, self.labels, paths, self.known, self.templates, self.prior
        )
        np.testing.assert_array_equal(told[~self.known], np.tile(self.prior, (50, 1)))
        spread = fit_spread(self.paths[self.known], self.templates, self.labels[self.known])
        expected = future_log_prob(self.paths[self.known], self.templates, spread)
        np.testing.assert_allclose(told[self.known], expected)
        without = fit_spread(paths, self.templates, self.labels)
        assert without.sigma_m(4).mean() > 1.2 * spread.sigma_m(4).mean()

    def test_known_nowhere_in_training_leaves_the_prior(self):
        nowhere = np.zeros(200, dtype=bool)
        log_prob = driving_on_log_prob(
            self.paths, nowhere, self.labels, self.paths[:2], ~nowhere[:2], self.templates,
            self.prior,
        )  # fmt: skip
        np.testing.assert_array_equal(log_prob, [self.prior, self.prior])
