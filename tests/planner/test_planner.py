import math
from contextlib import nullcontext

import pytest
import torch
import torch.nn.functional as F
from host_waits import NoMixedDevices
from hypothesis import given
from hypothesis import strategies as st
from torch import Tensor

from lss_core.grid import BevGrid
from shoot.planner import Interpolation, OffGrid, Planner, PlannerConfig, score_templates

LN2 = math.log(2.0)
# Four cells ahead, two to either side; cell (x, y) = (0, 0) is at the car's right.
SMALL = BevGrid(x_min_m=0.0, x_max_m=4.0, y_min_m=-2.0, y_max_m=2.0, cell_m=1.0)
WIDE = BevGrid(x_min_m=-3.0, x_max_m=9.0, y_min_m=-5.0, y_max_m=5.0, cell_m=0.5)


def random_map(grid: BevGrid, batch: int = 2, seed: int = 0) -> Tensor:
    return torch.randn(batch, *grid.shape, generator=torch.Generator().manual_seed(seed))


def random_templates(grid: BevGrid, num: int = 9, seed: int = 0, beyond_m: float = 0.0) -> Tensor:
    """Waypoints all over the grid, and up to `beyond_m` outside."""
    share = torch.rand(num, 20, 2, generator=torch.Generator().manual_seed(seed))
    low = torch.tensor([grid.x_min_m, grid.y_min_m]) - beyond_m
    high = torch.tensor([grid.x_max_m, grid.y_max_m]) + beyond_m
    return low + share * (high - low)


def test_hand_worked_probabilities() -> None:
    cost = torch.full((1, 4, 4), 50.0)
    cost[0, 0, 2], cost[0, 1, 2] = 0.0, 0.0
    cost[0, 0, 1], cost[0, 1, 1] = LN2, 0.0
    cost[0, 0, 3], cost[0, 1, 3] = LN2, LN2
    # Cell centres: straight ahead on the left of the axis, on its right, far left.
    templates = torch.tensor(
        [[[0.5, 0.5], [1.5, 0.5]], [[0.5, -0.5], [1.5, -0.5]], [[0.5, 1.5], [1.5, 1.5]]]
    )
    for interpolation in ("bilinear", "nearest"):
        scores = score_templates(cost, templates, SMALL, interpolation)
        torch.testing.assert_close(scores, torch.tensor([[0.0, -LN2, -2.0 * LN2]]))
        torch.testing.assert_close(scores.softmax(-1), torch.tensor([[4.0, 2.0, 1.0]]) / 7.0)


def test_bilinear_by_hand() -> None:
    cost = torch.arange(16.0).reshape(1, 4, 4)
    # x = 1.25 is 3/4 of the way from centre 0.5 to 1.5, y = -0.5 the centre of column 1:
    # 0.25 * 1 + 0.75 * 5 = 4. And (3, 0) lies between cells 9, 10, 13, 14: 11.5.
    templates = torch.tensor([[[1.25, -0.5], [3.0, 0.0]]])
    torch.testing.assert_close(
        score_templates(cost, templates, SMALL), torch.tensor([[-(4.0 + 11.5)]])
    )


@given(seed=st.integers(0, 10_000))
def test_bilinear_is_grid_sample(seed: int) -> None:
    cost, templates = random_map(WIDE, seed=seed), random_templates(WIDE, seed=seed)
    # grid_sample wants (column, row) in -1..1 from edge to edge.
    where_x = (templates[..., 0] - WIDE.x_min_m) / (WIDE.x_max_m - WIDE.x_min_m) * 2.0 - 1.0
    where_y = (templates[..., 1] - WIDE.y_min_m) / (WIDE.y_max_m - WIDE.y_min_m) * 2.0 - 1.0
    where = torch.stack([where_y, where_x], dim=-1).expand(len(cost), -1, -1, -1)
    read = F.grid_sample(cost[:, None], where, align_corners=False, padding_mode="border")
    expected = -read[:, 0].sum(dim=-1)
    for off_grid in ("learned", "border", "zero"):
        got = score_templates(cost, templates, WIDE, off_grid=off_grid, off_grid_cost=7.0)
        torch.testing.assert_close(got, expected, atol=1e-4, rtol=1e-4)


def test_border_rule_is_grid_sample_outside_too() -> None:
    cost, templates = random_map(WIDE), random_templates(WIDE, beyond_m=8.0)
    where_x = (templates[..., 0] - WIDE.x_min_m) / (WIDE.x_max_m - WIDE.x_min_m) * 2.0 - 1.0
    where_y = (templates[..., 1] - WIDE.y_min_m) / (WIDE.y_max_m - WIDE.y_min_m) * 2.0 - 1.0
    where = torch.stack([where_y, where_x], dim=-1).expand(len(cost), -1, -1, -1)
    read = F.grid_sample(cost[:, None], where, align_corners=False, padding_mode="border")
    got = score_templates(cost, templates, WIDE, off_grid="border")
    torch.testing.assert_close(got, -read[:, 0].sum(dim=-1), atol=1e-4, rtol=1e-4)


def test_nearest_reads_the_cell_that_owns_the_point() -> None:
    cost = random_map(WIDE, batch=1)
    templates = random_templates(WIDE, num=30, seed=4)
    # Points on cell edges among them: a cell owns its lower edges.
    templates[:10] = (templates[:10] * 2.0).round() / 2.0
    templates[:10] = templates[:10].clamp(max=torch.tensor([8.5, 4.5]))
    cells, inside = WIDE.cells(templates)
    assert inside.all()
    expected = -cost[0, cells[..., 0], cells[..., 1]].sum(dim=-1)
    torch.testing.assert_close(score_templates(cost, templates, WIDE, "nearest")[0], expected)


@pytest.mark.parametrize(
    ("point", "cell"),
    [
        ((0.0, -2.0), (0, 0)),  # lower corner: in
        ((1.0, 0.0), (1, 2)),
        ((0.999, -0.001), (0, 1)),
        ((3.999, 1.999), (3, 3)),
    ],
)
def test_nearest_at_the_edges(point: tuple[float, float], cell: tuple[int, int]) -> None:
    cost = torch.arange(1.0, 17.0).reshape(1, 4, 4)
    score = score_templates(cost, torch.tensor([[point]]), SMALL, "nearest", off_grid_cost=99.0)
    assert score.item() == -cost[0, cell[0], cell[1]].item()


@pytest.mark.parametrize("point", [(4.0, 0.0), (-0.001, 0.0), (1.0, 2.0), (1.0, -2.001)])
@pytest.mark.parametrize("interpolation", ["bilinear", "nearest"])
def test_upper_edge_is_outside(point: tuple[float, float], interpolation: Interpolation) -> None:
    cost = torch.arange(1.0, 17.0).reshape(1, 4, 4)
    score = score_templates(cost, torch.tensor([[point]]), SMALL, interpolation, "learned", 99.0)
    assert score.item() == -99.0


@pytest.mark.parametrize(
    ("off_grid", "expected"),
    # Cells (1, 2) = 7 and, for two points beyond the front, (3, 2) = 15 or the rule's own cost.
    [("learned", -(7.0 + 2 * 2.5)), ("border", -(7.0 + 2 * 15.0)), ("zero", -7.0)],
)
@pytest.mark.parametrize("interpolation", ["bilinear", "nearest"])
def test_points_off_the_grid_follow_the_rule(
    off_grid: OffGrid, expected: float, interpolation: Interpolation
) -> None:
    cost = torch.arange(1.0, 17.0).reshape(1, 4, 4)
    template = torch.tensor([[[1.5, 0.5], [5.5, 0.5], [70.0, 0.5]]])
    score = score_templates(cost, template, SMALL, interpolation, off_grid, 2.5)
    assert score.item() == pytest.approx(expected)


@pytest.mark.parametrize("off_grid", ["learned", "border", "zero"])
@pytest.mark.parametrize("interpolation", ["bilinear", "nearest"])
def test_a_cheap_template_inside_wins(interpolation: Interpolation, off_grid: OffGrid) -> None:
    # The mask of what is inside must not be turned round: only this template is all inside.
    cost = torch.full((1, 4, 4), 3.0)
    cost[0, :, 2] = -3.0
    inside = torch.tensor([[0.5, 0.5], [1.5, 0.5], [2.5, 0.5]])
    outside = inside + torch.tensor([0.0, 40.0])
    partly = inside + torch.tensor([2.0, -1.0])
    scores = score_templates(
        cost, torch.stack([outside, inside, partly]), SMALL, interpolation, off_grid
    )
    assert scores.argmax().item() == 1
    assert scores[0, 1].item() == pytest.approx(9.0)


@given(
    seed=st.integers(0, 10_000),
    constant=st.floats(-5.0, 5.0),
    interpolation=st.sampled_from(["bilinear", "nearest"]),
)
def test_a_constant_changes_no_probability(
    seed: int, constant: float, interpolation: Interpolation
) -> None:
    cost, templates = random_map(WIDE, seed=seed), random_templates(WIDE, seed=seed)
    before = score_templates(cost, templates, WIDE, interpolation)
    after = score_templates(cost + constant, templates, WIDE, interpolation)
    torch.testing.assert_close(after, before - 20.0 * constant, atol=1e-3, rtol=1e-4)
    torch.testing.assert_close(after.softmax(-1), before.softmax(-1), atol=1e-3, rtol=1e-3)


@pytest.mark.parametrize("off_grid", ["learned", "border", "zero"])
def test_mirrored_world_mirrored_scores(off_grid: OffGrid) -> None:
    cost, templates = random_map(WIDE), random_templates(WIDE, beyond_m=4.0)
    expected = score_templates(cost, templates, WIDE, off_grid=off_grid, off_grid_cost=0.7)
    mirrored = score_templates(
        cost.flip(-1),
        templates * torch.tensor([1.0, -1.0]),
        WIDE,
        off_grid=off_grid,
        off_grid_cost=0.7,
    )
    torch.testing.assert_close(mirrored, expected, atol=1e-4, rtol=1e-4)


def test_batch_is_one_by_one() -> None:
    cost, templates = random_map(WIDE, batch=5), random_templates(WIDE, beyond_m=3.0)
    together = score_templates(cost, templates, WIDE, off_grid_cost=1.5)
    for one, scores in zip(cost, together, strict=True):
        alone = score_templates(one[None], templates, WIDE, off_grid_cost=1.5)
        torch.testing.assert_close(alone[0], scores)


def test_grid_of_one_cell() -> None:
    grid = BevGrid(x_min_m=0.0, x_max_m=2.0, y_min_m=-1.0, y_max_m=1.0, cell_m=2.0)
    score = score_templates(torch.full((1, 1, 1), 4.0), torch.tensor([[[0.1, 0.9]]]), grid)
    assert score.item() == -4.0


@pytest.mark.parametrize("interpolation", ["bilinear", "nearest"])
def test_gradients_are_the_finite_differences(interpolation: Interpolation) -> None:
    templates = random_templates(SMALL, num=5, beyond_m=1.0)
    planner = Planner(templates, SMALL, PlannerConfig(interpolation=interpolation))
    label = torch.tensor([1, 3])
    cost = random_map(SMALL).requires_grad_()
    planner.loss(planner(cost), label).backward()
    assert cost.grad is not None
    assert planner.off_grid_cost.grad is not None
    step = 1e-2
    with torch.no_grad():
        for place in [(0, 0, 0), (0, 2, 1), (1, 3, 3), (1, 1, 2)]:
            bump = torch.zeros_like(cost)
            bump[place] = step
            up, down = (planner.loss(planner(cost + s * bump), label) for s in (1.0, -1.0))
            slope = (up - down) / (2.0 * step)
            assert cost.grad[place].item() == pytest.approx(slope.item(), abs=2e-4)
        losses = []
        for sign in (1.0, -1.0):
            planner.off_grid_cost.fill_(sign * step)
            losses.append(planner.loss(planner(cost), label))
        slope = (losses[0] - losses[1]) / (2.0 * step)
    assert slope.abs().item() > 1e-3
    assert planner.off_grid_cost.grad.item() == pytest.approx(slope.item(), abs=2e-4)


@pytest.mark.trains
def test_going_down_the_gradient_makes_the_driven_road_cheap() -> None:
    templates = torch.tensor([[[0.5, 0.5], [1.5, 0.5]], [[0.5, -0.5], [1.5, -0.5]]])
    cost = torch.zeros(1, 4, 4, requires_grad=True)
    planner = Planner(templates, SMALL)
    planner.loss(planner(cost), torch.tensor([0])).backward()
    assert cost.grad is not None
    assert (cost.grad[0, :2, 2] > 0.0).all()
    assert (cost.grad[0, :2, 1] < 0.0).all()


def test_learned_cost_starts_at_nothing_and_is_learned_only_if_asked() -> None:
    templates = random_templates(WIDE, beyond_m=5.0)
    cost = random_map(WIDE)
    learned = Planner(templates, WIDE, PlannerConfig(off_grid="learned"))
    zero = Planner(templates, WIDE, PlannerConfig(off_grid="zero"))
    torch.testing.assert_close(learned(cost), zero(cost))
    assert learned.off_grid_cost.requires_grad
    assert not zero.off_grid_cost.requires_grad


def test_temperature() -> None:
    templates, cost = random_templates(WIDE), random_map(WIDE)
    plain = Planner(templates, WIDE)
    warm = Planner(templates, WIDE, PlannerConfig(learn_temperature=True))
    assert not plain.log_temperature.requires_grad
    torch.testing.assert_close(warm(cost), plain(cost))
    with torch.no_grad():
        warm.log_temperature.fill_(LN2)
    torch.testing.assert_close(warm(cost), plain(cost) / 2.0)


def test_module_is_the_function() -> None:
    templates, cost = random_templates(WIDE, beyond_m=5.0), random_map(WIDE)
    planner = Planner(templates, WIDE)
    with torch.no_grad():
        planner.off_grid_cost.fill_(0.3)
    torch.testing.assert_close(
        planner(cost), score_templates(cost, templates, WIDE, off_grid_cost=0.3)
    )


def test_half_precision_maps_are_summed_in_float32() -> None:
    # 20 cells of 1 + 1/128: in bfloat16 sums above 16 would lose the fractions.
    cost = torch.full((1, *WIDE.shape), 1.0 + 1.0 / 128.0, dtype=torch.bfloat16)
    templates = random_templates(WIDE)
    planner = Planner(templates, WIDE)
    with torch.autocast("cpu", dtype=torch.bfloat16):
        scores = planner(cost)
    assert scores.dtype == torch.float32
    torch.testing.assert_close(scores, torch.full_like(scores, -20.0 * (1.0 + 1.0 / 128.0)))


def test_templates_are_a_buffer() -> None:
    planner = Planner(random_templates(WIDE), WIDE)
    assert {name for name, _ in planner.named_parameters()} == {"off_grid_cost", "log_temperature"}
    assert "templates" in planner.state_dict()


def test_loss_is_cross_entropy_by_hand() -> None:
    planner = Planner(random_templates(SMALL, num=3), SMALL)
    scores = torch.tensor([[0.0, -LN2, -2.0 * LN2], [3.0, 3.0, 3.0]])
    # Probabilities 4/7, 2/7, 1/7 and thirds; labels 2 and 0.
    loss = planner.loss(scores, torch.tensor([2, 0]))
    assert loss.item() == pytest.approx((math.log(7.0) + math.log(3.0)) / 2.0)


@pytest.mark.parametrize("shape", [(4, 5), (5, 4), (3, 3)])
def test_map_of_another_size_is_refused(shape: tuple[int, int]) -> None:
    templates = random_templates(SMALL)
    with pytest.raises(ValueError, match="cells"):
        score_templates(torch.zeros(1, *shape), templates, SMALL)
    with pytest.raises(ValueError, match="cells"):
        Planner(templates, SMALL)(torch.zeros(1, *shape))


@pytest.mark.parametrize("off_grid", ["learned", "border", "zero"])
@pytest.mark.parametrize("interpolation", ["bilinear", "nearest"])
def test_a_window_around_the_reads_scores_the_same(
    interpolation: Interpolation, off_grid: OffGrid
) -> None:
    # All waypoints ahead and to the left, some beyond the grid's far border.
    ahead = BevGrid(x_min_m=2.0, x_max_m=11.0, y_min_m=0.5, y_max_m=3.0, cell_m=0.5)
    planner = Planner(random_templates(ahead), WIDE, PlannerConfig(interpolation, off_grid))
    with torch.no_grad():
        planner.off_grid_cost.fill_(0.7)
    window = planner.reads.window(WIDE)
    assert window.x_start >= 9
    assert window.x_stop == 24
    assert window.y_start >= 10
    assert window.y_stop <= 17
    cost_map = random_map(WIDE)
    part = cost_map[:, window.x_start : window.x_stop, window.y_start : window.y_stop]
    scores = planner.score(part, planner.reads.within(window, WIDE))
    torch.testing.assert_close(scores, planner(cost_map))


def test_templates_that_read_nothing_have_a_window_all_the_same() -> None:
    planner = Planner(torch.full((3, 20, 2), 500.0), WIDE)
    window = planner.reads.window(WIDE)
    scores = planner.score(torch.ones(1, *window.shape), planner.reads.within(window, WIDE))
    torch.testing.assert_close(scores, planner(torch.ones(1, *WIDE.shape)))


@pytest.mark.parametrize("place", ["cpu", "meta"])
@pytest.mark.parametrize("off_grid", ["learned", "border", "zero"])
@pytest.mark.parametrize("interpolation", ["bilinear", "nearest"])
def test_scores_lie_where_the_map_does_wherever_the_templates_lie(
    interpolation: Interpolation, off_grid: OffGrid, place: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    # The device without values stands for a GPU: it, too, takes no tensors of the CPU.
    monkeypatch.setattr(torch, "autocast", lambda *_, **__: nullcontext())  # it has none
    cost = random_map(WIDE).to("meta").requires_grad_()
    templates = random_templates(WIDE, beyond_m=8.0).to(place)
    price = torch.tensor(7.0, device=place)
    with NoMixedDevices():
        scores = score_templates(cost, templates, WIDE, interpolation, off_grid, price)
        scores.sum().backward()
    assert scores.device.type == "meta"
    assert scores.shape == (2, 9)
    assert cost.grad is not None
