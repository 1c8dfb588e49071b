import numpy as np
import pytest
import torch

from lss_core.grid import BevGrid
from shoot.baselines.blind import fit_blind
from shoot.planner import Planner, PlannerConfig

GRID = BevGrid(x_min_m=0.0, x_max_m=8.0, y_min_m=-4.0, y_max_m=4.0, cell_m=1.0)


def _planner(points, off_grid="learned", interpolation="nearest"):
    config = PlannerConfig(interpolation=interpolation, off_grid=off_grid)
    return Planner(torch.tensor(points, dtype=torch.float32), GRID, config)


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
