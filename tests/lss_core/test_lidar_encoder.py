"""Pillars of lidar points: against a slow reference, and what must not matter."""

import numpy as np
import pytest
import torch
from torch import Tensor

from lss_core.grid import BevGrid
from lss_core.lidar_encoder import PillarEncoder

GRID = BevGrid(x_min_m=-4.0, x_max_m=8.0, y_min_m=-3.0, y_max_m=3.0, cell_m=1.0)
Z_M = (-2.0, 3.0)


@pytest.fixture
def encoder() -> PillarEncoder:
    torch.manual_seed(0)
    encoder = PillarEncoder(GRID, channels=6, z_min_m=Z_M[0], z_max_m=Z_M[1])
    torch.nn.init.normal_(encoder.norm.bias)
    encoder.norm.running_mean.normal_()  # type: ignore[union-attr]
    return encoder.eval()


def scan(seed: int, count: int) -> Tensor:
    """Points in and around the grid."""
    rng = np.random.default_rng(seed)
    low, high = [-6.0, -4.0, -3.0, 0.0, 0.0], [10.0, 4.0, 4.0, 255.0, 0.5]
    return torch.from_numpy(rng.uniform(low, high, (count, 5))).float()


def reference(encoder: PillarEncoder, points: Tensor) -> Tensor:
    """[C, X, Y] of one sample, one cell after the other, in float64, all features of one kind."""
    weight = torch.cat([encoder.of_point.weight, encoder.of_pillar.weight], dim=1).detach().double()
    norm = encoder.norm
    assert norm.running_mean is not None
    assert norm.running_var is not None
    pillars = torch.zeros(encoder.channels, *GRID.shape, dtype=torch.float64)
    for i in range(GRID.num_x):
        for j in range(GRID.num_y):
            corner = torch.tensor([GRID.x_min_m + i, GRID.y_min_m + j])
            here = ((points[:, :2] >= corner) & (points[:, :2] < corner + 1.0)).all(1)
            here &= (points[:, 2] >= Z_M[0]) & (points[:, 2] < Z_M[1])
            own = points[here].double()
            if not len(own):
                continue
            centre = (corner + 0.5).double()
            mean = own[:, :3].mean(0)
            features = []
            for point in own:
                x, y, z, intensity, age = point.tolist()
                features.append([
                    2 * (x - float(centre[0])), 2 * (y - float(centre[1])), z / 3, intensity / 255,
                    age, 2 * (float(centre[0]) + 4) / 12 - 1, 2 * (float(centre[1]) + 3) / 6 - 1,
                    2 * float(mean[0] - centre[0]), 2 * float(mean[1] - centre[1]), mean[2] / 3,
                ])  # fmt: skip
            values = torch.tensor(features, dtype=torch.float64) @ weight.T
            values = (values - norm.running_mean) / (norm.running_var + norm.eps).sqrt()
            values = values * norm.weight.detach() + norm.bias.detach()
            pillars[:, i, j] = values.clamp(min=0.0).max(0).values
    return pillars


def test_agrees_with_cell_by_cell(encoder):
    counts = [200, 0, 37]
    scans = [scan(seed, count) for seed, count in enumerate(counts)]
    pillars = encoder(torch.cat(scans), torch.tensor([0, 200, 200]))
    assert pillars.shape == (3, 6, 12, 6)
    for own, points in zip(pillars, scans, strict=True):
        torch.testing.assert_close(
            own.detach().double(), reference(encoder, points), atol=1e-5, rtol=1e-4
        )
    assert pillars[0].abs().sum() > 0
    assert pillars[1].abs().sum() == 0


def test_the_order_of_points_and_the_company_do_not_matter(encoder):
    points, other = scan(0, 150), scan(1, 80)
    alone = encoder(points, torch.tensor([0]))
    shuffled = points[torch.randperm(150, generator=torch.Generator().manual_seed(3))]
    together = encoder(torch.cat([other, shuffled]), torch.tensor([0, 80]))
    torch.testing.assert_close(together[1], alone[0], atol=1e-6, rtol=1e-5)


def test_moving_by_a_cell_moves_the_map(encoder):
    """Once the network is not told where in the grid a point is."""
    with torch.no_grad():
        encoder.of_pillar.weight[:, :2] = 0.0
    points = scan(0, 100)
    points = points[(points[:, 0] < 7.0) & (points[:, 0] > -4.0)]
    moved = points + torch.tensor([1.0, 0.0, 0.0, 0.0, 0.0])
    here, there = (encoder(p, torch.tensor([0]))[0] for p in (points, moved))
    torch.testing.assert_close(there[:, 1:], here[:, :-1], atol=1e-5, rtol=1e-4)


def test_lower_edges_are_in_and_upper_ones_out(encoder):
    inside = torch.tensor([[-4.0, -3.0, -2.0, 9.0, 0.0]])
    assert encoder(inside, torch.tensor([0])).abs().sum() > 0
    for axis, edge_m in ((0, 8.0), (1, 3.0), (2, 3.0)):
        outside = inside.clone()
        outside[0, axis] = edge_m
        assert encoder(outside, torch.tensor([0])).abs().sum() == 0


def test_no_points_at_all(encoder):
    assert encoder(torch.zeros(0, 5), torch.tensor([0, 0])).abs().sum() == 0


@pytest.mark.trains
@pytest.mark.parametrize("train", [False, True])
def test_gradient_against_finite_differences(encoder, train):
    encoder.train(train).double()
    points = scan(0, 40)

    def loss(weight: Tensor) -> Tensor:
        # autocast's exit to float32 is for the network; here all of it is float64.
        pillars = torch.func.functional_call(
            encoder, {"of_point.weight": weight}, (points, torch.tensor([0, 25]))
        )
        mixed: Tensor = pillars * torch.linspace(-1, 1, pillars.numel()).view_as(pillars)
        return mixed.sum()

    weight = encoder.of_point.weight.detach().clone().requires_grad_()
    assert torch.autograd.gradcheck(loss, (weight,), atol=1e-5)


def test_bfloat16_training_keeps_it_in_float32(encoder):
    points = scan(0, 60)
    with torch.autocast("cpu", torch.bfloat16):
        mixed = encoder(points, torch.tensor([0]))
    assert torch.equal(mixed, encoder(points, torch.tensor([0])))
