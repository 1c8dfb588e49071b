"""Scores of templates on a GPU: the CPU's, wherever templates and price lie."""

import pytest
import torch

from lss_core.grid import BevGrid
from shoot.planner import Interpolation, OffGrid, score_templates

GRID = BevGrid(-3.0, 9.0, -5.0, 5.0, 0.5)


@pytest.mark.parametrize("place", ["cpu", "cuda"])
@pytest.mark.parametrize("off_grid", ["learned", "border", "zero"])
@pytest.mark.parametrize("interpolation", ["bilinear", "nearest"])
def test_scores_and_gradients_are_the_cpus(
    interpolation: Interpolation, off_grid: OffGrid, place: str
) -> None:
    random = torch.Generator().manual_seed(0)
    cost = torch.randn(2, *GRID.shape, generator=random)
    # Some leave the map.
    templates = torch.rand(9, 20, 2, generator=random) * 16.0 - torch.tensor([5.0, 8.0])
    found = []
    for device, own_place in (("cpu", "cpu"), ("cuda", place)):
        cost_map = cost.to(device).requires_grad_()
        price = torch.tensor(7.0, device=own_place, requires_grad=True)
        scores = score_templates(
            cost_map, templates.to(own_place), GRID, interpolation, off_grid, price
        )
        assert scores.device.type == device
        scores.log_softmax(dim=-1)[:, 3].sum().backward()
        found.append([scores.detach().cpu(), cost_map.grad.cpu(), price.grad.cpu()])
    for on_cpu, on_gpu in zip(*found, strict=True):
        torch.testing.assert_close(on_gpu, on_cpu, rtol=1e-4, atol=1e-4)
