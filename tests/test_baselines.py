import numpy as np
import pytest
import torch
from scipy.special import log_softmax

from lss_core.grid import BevGrid
from shoot.baselines import (
    SMOOTHINGS,
    constant_velocity_futures,
    constant_yaw_rate_futures,
    fit_blind,
    fit_prior,
    fit_sigma,
    future_log_prob,
    prior_log_prob,
    scene_folds,
    squared_distances,
)
from shoot.planner import Planner, PlannerConfig

GRID = BevGrid(x_min_m=0.0, x_max_m=8.0, y_min_m=-4.0, y_max_m=4.0, cell_m=1.0)


def _planner(points, off_grid="learned", interpolation="nearest"):
    config = PlannerConfig(interpolation=interpolation, off_grid=off_grid)
    return Planner(torch.tensor(points, dtype=torch.float32), GRID, config)


class TestFolds:
    def test_keep_scenes_whole_and_share_them_out_evenly(self):
        scene = np.repeat(np.arange(100, 123), 7)
        fold = scene_folds(scene, num_folds=5)
        of_scene = [set(fold[scene == name]) for name in np.unique(scene)]
        assert all(len(folds) == 1 for folds in of_scene)
        assert sorted(np.bincount([folds.pop() for folds in of_scene])) == [4, 4, 5, 5, 5]

    def test_fewer_scenes_than_folds(self):
        assert set(scene_folds(np.array([3, 3, 8]), num_folds=5)) == {0, 1}
        assert set(scene_folds(np.array([3, 3]), num_folds=5)) == {0}


class TestPrior:
    def test_by_hand(self):
        log_prob = prior_log_prob(np.array([0, 0, 0, 2]), 3, smoothing=1.0)
        np.testing.assert_allclose(np.exp(log_prob), [4 / 7, 1 / 7, 2 / 7])

    @pytest.mark.parametrize("smoothing", [0.0, -1.0, float("nan")])
    def test_smoothing_must_be_positive(self, smoothing):
        with pytest.raises(ValueError, match="smoothing must be above 0"):
            prior_log_prob(np.array([0]), 3, smoothing)

    @pytest.mark.parametrize("label", [-1, 3])
    def test_labels_of_other_templates_are_refused(self, label):
        with pytest.raises(ValueError, match=r"must lie in 0\.\.2"):
            prior_log_prob(np.array([0, label]), 3)

    def test_fitted_smoothing_is_about_the_best_on_new_scenes(self):
        generator = np.random.default_rng(0)
        frequency = generator.dirichlet(np.full(200, 0.2))
        labels = generator.choice(200, size=600, p=frequency)
        scene = np.repeat(np.arange(60), 10)

        def expected_nll(log_prob):
            return -(frequency * log_prob).sum()

        nll = [expected_nll(prior_log_prob(labels, 200, s)) for s in SMOOTHINGS]
        assert max(nll) - min(nll) > 0.1
        assert expected_nll(fit_prior(labels, scene, 200)) < min(nll) + 0.02

    def test_one_scene_falls_back_to_plain_smoothing(self):
        labels = np.array([0, 1, 1])
        expected = prior_log_prob(labels, 4)
        np.testing.assert_array_equal(fit_prior(labels, np.zeros(3), 4), expected)


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


class TestBlind:
    """Labels of 4 templates with counts 4 : 2 : 1 : 1 in each of 200 scenes."""

    labels = np.tile([0, 0, 0, 0, 1, 1, 2, 3], 200)
    scene = np.repeat(np.arange(200), 8)
    disjoint = ([[0.5, 0.5]], [[1.5, 0.5]], [[2.5, 0.5]], [[3.5, 0.5]])

    def test_templates_on_separate_cells_reach_their_frequencies(self):
        fit = fit_blind(_planner(self.disjoint), self.labels, self.scene)
        np.testing.assert_allclose(np.exp(fit.log_prob), [0.5, 0.25, 0.125, 0.125], atol=2e-3)
        assert fit.held_out_nll == pytest.approx(1.2130, abs=1e-3)  # 1.75 ln 2
        # Log-odds of 2 between neighbours are differences of cost; cells never driven stay 0.
        costs = fit.cost_map[:4, 4]
        assert costs[1] - costs[0] == pytest.approx(np.log(2.0), abs=0.02)
        assert np.count_nonzero(fit.cost_map) == 4

    def test_templates_on_the_same_cells_share_their_frequency(self):
        # The third lies in the first one's cell.
        points = ([[0.2, 0.5]], [[1.5, 0.5]], [[0.9, 0.1]], [[3.5, 0.5]])
        fit = fit_blind(_planner(points), self.labels, self.scene)
        np.testing.assert_allclose(np.exp(fit.log_prob), [5 / 16, 1 / 4, 5 / 16, 1 / 8], atol=2e-3)

    def test_learned_off_grid_cost_is_part_of_it(self):
        # The first two leave the grid and can only be told from the rest by the scalar.
        points = ([[9.0, 0.5]], [[-1.0, 0.5]], [[2.5, 0.5]], [[3.5, 0.5]])
        learned = fit_blind(_planner(points), self.labels, self.scene)
        expected = [3 / 8, 3 / 8, 1 / 8, 1 / 8]
        np.testing.assert_allclose(np.exp(learned.log_prob), expected, atol=2e-3)
        zero = fit_blind(_planner(points, off_grid="zero"), self.labels, self.scene)
        assert zero.off_grid_cost == 0.0

    @pytest.mark.parametrize(
        ("off_grid", "interpolation"),
        [("learned", "bilinear"), ("border", "bilinear"), ("zero", "nearest")],
    )
    def test_it_is_what_the_planner_says_of_its_map(self, off_grid, interpolation):
        points = np.random.default_rng(4).uniform((-1, -5), (9, 5), (20, 5, 2))
        planner = _planner(points, off_grid, interpolation)
        generator = np.random.default_rng(5)
        labels = generator.integers(0, 20, 80) // 2
        fit = fit_blind(planner, labels, np.arange(80) // 8)
        assert planner.off_grid_cost.item() == 0.0  # the planner given is left alone
        with torch.no_grad():
            planner.off_grid_cost.fill_(fit.off_grid_cost)
            scores = planner(torch.from_numpy(fit.cost_map)[None])
        expected = torch.log_softmax(scores[0], dim=0).numpy()
        np.testing.assert_allclose(fit.log_prob, expected, atol=1e-5)

    def test_it_is_the_minimum_of_the_planners_own_loss(self):
        points = np.random.default_rng(6).uniform((0, -4), (8, 4), (30, 5, 2))
        planner = _planner(points, interpolation="bilinear")
        labels = np.random.default_rng(7).integers(0, 30, 400) // 2
        fit = fit_blind(planner, labels, np.arange(400) // 8)
        cost_map = torch.from_numpy(fit.cost_map).float()[None].requires_grad_()
        planner.off_grid_cost.data.fill_(fit.off_grid_cost)
        scores = planner(cost_map).expand(len(labels), -1)
        loss = planner.loss(scores, torch.from_numpy(labels))
        loss = loss + 0.5 * fit.weight_decay * cost_map.square().sum()
        loss.backward()
        assert cost_map.grad.abs().max() < 1e-4

    def test_decay_grows_when_scenes_say_little_of_others(self):
        # Each scene repeats one label of its own: what training scenes show does not come again.
        scene = np.repeat(np.arange(40), 8)
        points = np.random.default_rng(8).uniform((0, -4), (8, 4), (60, 5, 2))
        alone = fit_blind(_planner(points), scene, scene)
        mixed = fit_blind(_planner(points), np.tile(np.arange(8), 40), scene)
        assert alone.weight_decay > mixed.weight_decay
        # A label never seen cannot be told better than by chance; lower means it was seen.
        assert np.log(60) <= alone.held_out_nll < np.log(60) + 0.2

    def test_one_scene_still_gives_a_distribution(self):
        fit = fit_blind(_planner(self.disjoint), self.labels, np.zeros_like(self.labels))
        assert np.exp(fit.log_prob).sum() == pytest.approx(1.0)
        assert fit.log_prob.argmax() == 0
        assert np.isnan(fit.held_out_nll)

    def test_no_labels_are_refused(self):
        with pytest.raises(ValueError, match="at least one training label"):
            fit_blind(_planner(self.disjoint), self.labels[:0], self.scene[:0])
