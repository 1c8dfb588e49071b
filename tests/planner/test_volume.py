"""A cost volume: each waypoint of a template reads the map of its own time."""

import pytest
import torch
from torch import Tensor

from lss_core.grid import BevGrid
from shoot.planner import Interpolation, OffGrid, Planner, PlannerConfig, score_templates

NUM_STEPS = 5
GRID = BevGrid(x_min_m=-3.0, x_max_m=9.0, y_min_m=-5.0, y_max_m=5.0, cell_m=0.5)


def random_volume(batch: int = 2, seed: int = 0) -> Tensor:
    generator = torch.Generator().manual_seed(seed)
    return torch.randn(batch, NUM_STEPS, *GRID.shape, generator=generator)


def random_templates(num: int = 9, beyond_m: float = 0.0, grid: BevGrid = GRID) -> Tensor:
    share = torch.rand(num, NUM_STEPS, 2, generator=torch.Generator().manual_seed(1))
    low = torch.tensor([grid.x_min_m, grid.y_min_m]) - beyond_m
    high = torch.tensor([grid.x_max_m, grid.y_max_m]) + beyond_m
    return low + share * (high - low)


def test_the_same_way_costs_another_sum_the_other_way_round() -> None:
    volume = torch.zeros(1, 2, *GRID.shape)
    # Cells of (0.25, 0.25) and (1.25, -0.75), first and second time.
    volume[0, 0, 6, 10], volume[0, 1, 6, 10] = 1.0, 20.0
    volume[0, 0, 8, 8], volume[0, 1, 8, 8] = 300.0, 4000.0
    there = torch.tensor([[0.25, 0.25], [1.25, -0.75]])
    scores = score_templates(volume, torch.stack([there, there.flip(0)]), GRID)
    torch.testing.assert_close(scores, torch.tensor([[-4001.0, -320.0]]))


@pytest.mark.parametrize("off_grid", ["learned", "border", "zero"])
@pytest.mark.parametrize("interpolation", ["bilinear", "nearest"])
def test_it_is_the_sum_of_templates_of_one_waypoint(
    interpolation: Interpolation, off_grid: OffGrid
) -> None:
    volume, templates = random_volume(), random_templates(beyond_m=3.0)
    scores = score_templates(volume, templates, GRID, interpolation, off_grid, 0.7)
    one_by_one = [
        score_templates(volume[:, t], templates[:, t : t + 1], GRID, interpolation, off_grid, 0.7)
        for t in range(NUM_STEPS)
    ]
    torch.testing.assert_close(scores, torch.stack(one_by_one).sum(dim=0))


@pytest.mark.parametrize("off_grid", ["learned", "border", "zero"])
@pytest.mark.parametrize("interpolation", ["bilinear", "nearest"])
def test_the_same_map_at_all_times_is_the_map(
    interpolation: Interpolation, off_grid: OffGrid
) -> None:
    templates, label = random_templates(beyond_m=3.0), torch.tensor([1, 3])
    losses, slopes, of_price = [], [], []
    for cost in ("map", "volume"):
        planner = Planner(templates, GRID, PlannerConfig(interpolation, off_grid, cost=cost))
        with torch.no_grad():
            planner.off_grid_cost.fill_(0.7)
        cost_map = random_volume()[:, 0].requires_grad_()
        maps = cost_map[:, None].expand(-1, planner.num_maps, -1, -1)
        scores = planner(maps)
        losses.append(scores.detach())
        planner.loss(scores, label).backward()
        assert cost_map.grad is not None
        slopes.append(cost_map.grad)
        of_price.append(planner.off_grid_cost.grad)
    torch.testing.assert_close(losses[1], losses[0])
    torch.testing.assert_close(slopes[1], slopes[0])
    torch.testing.assert_close(of_price[1], of_price[0])


def test_no_map_is_changed_by_waypoints_of_other_times() -> None:
    # The waypoints of time 2 are alike, those of the others are not: that map can decide nothing.
    templates = random_templates()
    templates[:, 2] = templates[0, 2]
    planner = Planner(templates, GRID, PlannerConfig(cost="volume"))
    volume = random_volume().requires_grad_()
    planner.loss(planner(volume), torch.tensor([1, 3])).backward()
    assert volume.grad is not None
    moved = volume.grad.abs().amax(dim=(0, 2, 3))
    assert moved[2] < 1e-6
    assert (moved[[0, 1, 3, 4]] > 1e-2).all()


def test_times_of_maps_and_waypoints_may_be_reordered_together() -> None:
    volume, templates = random_volume(), random_templates()
    order = torch.tensor([3, 0, 4, 2, 1])
    torch.testing.assert_close(
        score_templates(volume[:, order], templates[:, order], GRID),
        score_templates(volume, templates, GRID),
    )


def test_a_constant_for_each_time_changes_no_probability() -> None:
    volume, templates = random_volume(), random_templates()
    constants = torch.tensor([3.0, -1.0, 0.5, 8.0, -4.0])[:, None, None]
    torch.testing.assert_close(
        score_templates(volume + constants, templates, GRID).softmax(dim=-1),
        score_templates(volume, templates, GRID).softmax(dim=-1),
    )


@pytest.mark.parametrize("off_grid", ["learned", "border", "zero"])
@pytest.mark.parametrize("interpolation", ["bilinear", "nearest"])
def test_a_window_of_all_maps_scores_the_same(
    interpolation: Interpolation, off_grid: OffGrid
) -> None:
    ahead = BevGrid(x_min_m=2.0, x_max_m=11.0, y_min_m=0.5, y_max_m=3.0, cell_m=0.5)
    config = PlannerConfig(interpolation, off_grid, cost="volume")
    planner = Planner(random_templates(grid=ahead), GRID, config)
    with torch.no_grad():
        planner.off_grid_cost.fill_(0.7)
    window = planner.reads.window(GRID)
    assert window.x_start >= 9
    assert window.y_start >= 10
    volume = random_volume()
    part = volume[..., window.x_start : window.x_stop, window.y_start : window.y_stop]
    scores = planner.score(part, planner.reads.within(window, GRID))
    torch.testing.assert_close(scores, planner(volume))


@pytest.mark.parametrize("num_maps", [2, NUM_STEPS + 1])
def test_other_numbers_of_maps_are_refused(num_maps: int) -> None:
    maps, templates = torch.zeros(1, num_maps, *GRID.shape), random_templates()
    with pytest.raises(ValueError, match=rf"1 or 5 cost map\(s\).*got {num_maps}"):
        score_templates(maps, templates, GRID)
    for cost, wanted in (("map", 1), ("volume", NUM_STEPS)):
        with pytest.raises(ValueError, match=rf"must be {wanted} cost map\(s\)"):
            Planner(templates, GRID, PlannerConfig(cost=cost))(maps)


def test_one_map_for_a_planner_with_a_volume_is_refused() -> None:
    planner = Planner(random_templates(), GRID, PlannerConfig(cost="volume"))
    with pytest.raises(ValueError, match="must be 5"):
        planner(torch.zeros(1, *GRID.shape))
