"""The max-margin loss: by hand, as a plain loop, and what of costs it does not change."""

import pytest
import torch
from torch import Tensor

from lss_core.grid import BevGrid
from shoot.planner import Planner, PlannerConfig, max_margin_loss, score_templates

GRID = BevGrid(x_min_m=-3.0, x_max_m=9.0, y_min_m=-5.0, y_max_m=5.0, cell_m=0.5)
NUM_STEPS = 4


def numbers(*shape: int, seed: int = 0, dtype: torch.dtype = torch.float32) -> Tensor:
    return torch.randn(*shape, generator=torch.Generator().manual_seed(seed), dtype=dtype)


def paths(num: int, seed: int, beyond_m: float = 1.0) -> Tensor:
    share = torch.rand(num, NUM_STEPS, 2, generator=torch.Generator().manual_seed(seed))
    low = torch.tensor([GRID.x_min_m, GRID.y_min_m]) - beyond_m
    high = torch.tensor([GRID.x_max_m, GRID.y_max_m]) + beyond_m
    return low + share * (high - low)


def margin_planner(cost: str = "map", margin_per_m: float = 0.3) -> Planner:
    config = PlannerConfig(cost=cost, loss="max_margin", margin_per_m=margin_per_m)  # type: ignore[arg-type]
    planner = Planner(paths(7, seed=1), GRID, config)
    with torch.no_grad():
        planner.off_grid_cost.fill_(0.4)
    return planner


def test_by_hand() -> None:
    # Two times, three trajectories. Short of the margin of 2 a metre:
    # 1 - 4 + 2 and 5 - 6 + 8, so 7; 1 - 1 + 0 and 5 - 5 + 0, so 0; 1 + 2 + 3 and 5 - 9 + 2, so 6.
    driven = torch.tensor([[1.0, 5.0], [0.0, 0.0]])
    cost = torch.tensor([[[4.0, 6.0], [1.0, 5.0], [-2.0, 9.0]], [[9.0, 9.0]] * 3])
    distance_m = torch.tensor([[[1.0, 4.0], [0.0, 0.0], [1.5, 1.0]], [[3.0, 1.0]] * 3])
    # The second sample keeps all margins: 0. The mean over both is 3.5.
    assert max_margin_loss(driven, cost, distance_m, 2.0).item() == pytest.approx(3.5)
    assert max_margin_loss(driven[:1], cost[:1], distance_m[:1], 2.0).item() == pytest.approx(7.0)


def test_the_margin_is_the_unit_of_cost() -> None:
    driven, cost = numbers(2, 3), numbers(2, 5, 3, seed=1)
    distance_m = numbers(2, 5, 3, seed=2).abs()
    loss = max_margin_loss(driven, cost, distance_m, 1.0)
    assert loss > 0.0
    torch.testing.assert_close(
        max_margin_loss(0.1 * driven, 0.1 * cost, distance_m, 0.1), 0.1 * loss
    )


def test_no_time_makes_up_for_another_one() -> None:
    # Much dearer at the first time, 1 too cheap at the second: short by 1 all the same.
    driven, cost = torch.zeros(1, 2), torch.tensor([[[1000.0, -1.0]]])
    assert max_margin_loss(driven, cost, torch.zeros(1, 1, 2), 1.0).item() == 1.0


@pytest.mark.parametrize("cost", ["map", "volume"])
def test_it_is_a_plain_loop(cost: str) -> None:
    planner, future = margin_planner(cost), paths(3, seed=2)
    maps = numbers(3, planner.num_maps, *GRID.shape)
    price = planner.off_grid_cost.detach()

    def cost_at(b: int, t: int, point: Tensor) -> float:
        one = maps[b : b + 1, t if cost == "volume" else 0]
        return -score_templates(one, point[None, None], GRID, off_grid_cost=price).item()

    worst = []
    for b in range(3):
        short = []
        for template in planner.templates:
            at_times = [
                cost_at(b, t, future[b, t])
                - cost_at(b, t, template[t])
                + 0.3 * torch.dist(template[t], future[b, t]).item()
                for t in range(NUM_STEPS)
            ]
            short.append(sum(max(0.0, value) for value in at_times))
        worst.append(max(short))
    assert min(worst) > 0.0
    loss = planner.margin_loss(maps, future)
    assert loss.item() == pytest.approx(sum(worst) / 3, rel=1e-4)
    one_by_one = [planner.margin_loss(maps[b : b + 1], future[b : b + 1]) for b in range(3)]
    torch.testing.assert_close(torch.stack(one_by_one), torch.tensor(worst), rtol=1e-4, atol=1e-4)


def test_gradients_are_the_finite_differences() -> None:
    given = [
        numbers(2, 3, seed=1, dtype=torch.float64).requires_grad_(),
        numbers(2, 5, 3, seed=2, dtype=torch.float64).requires_grad_(),
        numbers(2, 5, 3, seed=3, dtype=torch.float64).abs(),
    ]
    assert torch.autograd.gradcheck(lambda *parts: max_margin_loss(*parts, 0.5), given)


@pytest.mark.parametrize("cost", ["map", "volume"])
def test_gradients_of_the_map_are_the_finite_differences(cost: str) -> None:
    planner, future = margin_planner(cost), paths(2, seed=2)
    maps = numbers(2, planner.num_maps, *GRID.shape).requires_grad_()
    loss = planner.margin_loss(maps, future)
    loss.backward()
    assert maps.grad is not None
    assert planner.off_grid_cost.grad is not None
    # Piecewise linear: a small step changes it by exactly the slope.
    step = 0.01
    with torch.no_grad():
        down = planner.margin_loss(maps - step * maps.grad, future)
        assert (loss - down).item() == pytest.approx(
            step * maps.grad.square().sum().item(), rel=1e-2
        )
        planner.off_grid_cost += step
        slope = (planner.margin_loss(maps, future) - loss) / step
    assert planner.off_grid_cost.grad.item() == pytest.approx(slope.item(), abs=1e-2)


def test_only_the_worst_trajectory_and_the_driven_one_are_moved() -> None:
    driven, cost = numbers(1, 3).requires_grad_(), numbers(1, 6, 3, seed=1).requires_grad_()
    distance_m = numbers(1, 6, 3, seed=2).abs() + 2.0  # every margin is missed
    max_margin_loss(driven, cost, distance_m, 1.0).backward()
    assert driven.grad is not None
    assert cost.grad is not None
    worst = (driven[:, None] - cost + distance_m).sum(dim=-1).argmax()
    expected = torch.zeros(1, 6, 3)
    expected[0, worst] = -1.0
    torch.testing.assert_close(cost.grad, expected)
    torch.testing.assert_close(driven.grad, torch.ones(1, 3))


def test_where_all_keep_the_margin_nothing_is_left_to_learn() -> None:
    # What a waypoint costs is its distance to the driven one, twice the margin.
    driven = torch.tensor([[2.25, 0.25]] * NUM_STEPS)
    centres_m = torch.stack(
        torch.meshgrid(torch.arange(-2.75, 9.0, 0.5), torch.arange(-4.75, 5.0, 0.5), indexing="ij"),
        dim=-1,
    )
    maps = (2.0 * (centres_m - driven[0]).norm(dim=-1))[None, None].requires_grad_()
    config = PlannerConfig("nearest", loss="max_margin", margin_per_m=1.0)
    templates = centres_m[[0, 5, 9, 20], [3, 18, 11, 2]][:, None].expand(-1, NUM_STEPS, -1)
    planner = Planner(templates, GRID, config)
    loss = planner.margin_loss(maps, driven[None])
    loss.backward()
    assert loss.item() == 0.0
    assert maps.grad is not None
    assert not maps.grad.any()
    # At three times the margin it would not be: nothing else makes it 0.
    tripled = Planner(templates, GRID, PlannerConfig("nearest", margin_per_m=3.0))
    assert tripled.margin_loss(maps, driven[None]).item() > 1.0


def test_the_farthest_is_the_worst_where_all_cost_the_same() -> None:
    planner, future = margin_planner(), paths(2, seed=2)
    with torch.no_grad():
        planner.off_grid_cost.fill_(5.0)  # as the map
    far_m = (planner.templates - future[:, None]).norm(dim=-1).sum(dim=-1).amax(dim=-1)
    loss = planner.margin_loss(torch.full((2, 1, *GRID.shape), 5.0), future)
    assert loss.item() == pytest.approx(0.3 * far_m.mean().item(), rel=1e-4)


@pytest.mark.parametrize("cost", ["map", "volume"])
def test_going_down_the_gradient_ranks_the_driven_template_first(cost: str) -> None:
    planner = margin_planner(cost, margin_per_m=0.1)
    future = planner.templates[[2, 5]]
    maps = torch.zeros(2, planner.num_maps, *GRID.shape, requires_grad=True)
    optimizer = torch.optim.Adam([maps], 0.05)
    for _ in range(60):
        optimizer.zero_grad()
        planner.margin_loss(maps, future).backward()
        optimizer.step()
    assert planner(maps).argmax(dim=-1).tolist() == [2, 5]


def test_in_mixed_precision_it_sums_in_float32() -> None:
    planner, future = margin_planner("volume"), paths(2, seed=2)
    maps = numbers(2, NUM_STEPS, *GRID.shape).bfloat16()
    with torch.autocast("cpu", dtype=torch.bfloat16):
        loss = planner.margin_loss(maps, future)
    assert loss.dtype == torch.float32
    torch.testing.assert_close(loss, planner.margin_loss(maps.float(), future))
    assert loss != loss.bfloat16()


def test_a_temperature_it_could_not_learn_is_refused() -> None:
    with pytest.raises(ValueError, match="learn_temperature"):
        PlannerConfig(learn_temperature=True, loss="max_margin")
