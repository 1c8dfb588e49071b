"""Pillars of lidar points on a GPU: the CPU's map and gradients, all rows in one piece or not."""

import copy

import pytest
import torch

from lss_core.grid import BevGrid
from lss_core.lidar_encoder import PillarEncoder

GRID = BevGrid(-20.0, 20.0, -20.0, 20.0, 0.5)


@pytest.mark.parametrize("counts", [[12_000, 8_500], [0, 300], [0, 0]])
def test_map_and_gradients_are_the_cpus(counts: list[int]) -> None:
    random = torch.Generator().manual_seed(0)
    low = torch.tensor([-24.0, -24.0, -3.0, 0.0, 0.0])
    size = torch.tensor([48.0, 48.0, 8.0, 255.0, 0.5])
    points = low + size * torch.rand(sum(counts), 5, generator=random)
    offsets = torch.tensor([0, counts[0]])
    torch.manual_seed(0)
    encoder = PillarEncoder(GRID, channels=16, z_min_m=-2.0, z_max_m=4.0)
    torch.nn.init.normal_(encoder.norm.bias)
    found = []
    for device in ("cpu", "cuda"):
        own = copy.deepcopy(encoder).to(device)
        bev = own(points.to(device), offsets.to(device))
        slope = torch.linspace(-1.0, 1.0, bev.numel(), device=device).view_as(bev)
        loss = (bev * slope).sum()
        gradients = torch.autograd.grad(loss, list(own.parameters())) if loss.requires_grad else ()
        found.append([t.detach().cpu() for t in (bev, *gradients)])
    for on_cpu, on_gpu in zip(*found, strict=True):
        scale = float(on_cpu.abs().max())
        torch.testing.assert_close(on_gpu, on_cpu, rtol=1e-3, atol=1e-4 * max(1.0, scale))
