"""The splat on a GPU: the CPU's index, values and gradients."""

import pytest
import torch
from torch import Tensor

from lss_core.camera import frustum_points
from lss_core.grid import BevGrid
from lss_core.splat import SplatIndex, build_splat_index, pool

GRID = BevGrid(-10.0, 10.0, -6.0, 6.0, 0.5)
IMAGE_HW = (32, 64)
DEPTHS_M = torch.arange(2.0, 12.0)


def _rig() -> tuple[Tensor, Tensor]:
    """Two samples of three cameras, pitched a little, so that no point lies on a cell's border."""
    intrinsics = torch.tensor([[41.3, 0.0, 31.2], [0.0, 40.7, 15.9], [0.0, 0.0, 1.0]])
    ahead = torch.tensor([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
    poses = torch.eye(4).repeat(2, 3, 1, 1)
    for b in range(2):
        for n in range(3):
            yaw, pitch = torch.tensor(0.3 + 2.1 * n + 0.05 * b), torch.tensor(0.02 + 0.01 * b)
            turn = torch.tensor(
                [[yaw.cos(), -yaw.sin(), 0.0], [yaw.sin(), yaw.cos(), 0.0], [0.0, 0.0, 1.0]]
            )
            nod = torch.tensor(
                [[pitch.cos(), 0.0, pitch.sin()], [0.0, 1.0, 0.0], [-pitch.sin(), 0.0, pitch.cos()]]
            )
            poses[b, n, :3, :3] = turn @ nod @ ahead
            poses[b, n, :3, 3] = torch.tensor([0.31, -0.17, 1.53])
    return intrinsics.repeat(2, 3, 1, 1), poses


def _index(device: str, mask: Tensor | None = None) -> SplatIndex:
    intrinsics, poses = (t.to(device) for t in _rig())
    points = frustum_points(IMAGE_HW, 8, DEPTHS_M.to(device), intrinsics, poses)
    mask = None if mask is None else mask.to(device)
    return build_splat_index(points, GRID, z_max_m=2.0, camera_mask=mask)


@pytest.mark.parametrize("masked", [False, True])
def test_the_index_is_the_cpus(masked: bool) -> None:
    mask = torch.tensor([[True, False, True], [True, True, True]]) if masked else None
    on_cpu, on_gpu = _index("cpu", mask), _index("cuda", mask)
    assert 0.1 < float(on_cpu.inside.float().mean()) < 0.9
    for name in ("cell_of", "inside", "point_idx", "bag_starts"):
        assert torch.equal(getattr(on_cpu, name), getattr(on_gpu, name).cpu()), name


@pytest.mark.parametrize("masked", [False, True])
def test_map_and_gradients_are_the_cpus(masked: bool) -> None:
    random = torch.Generator().manual_seed(0)
    context = torch.randn(2, 3, 8, 4, 8, generator=random)
    prob = torch.randn(2, 3, len(DEPTHS_M), 4, 8, generator=random).softmax(dim=2)
    slope = torch.randn(2, 8, *GRID.shape, generator=random)
    mask = torch.tensor([[True, False, True], [False, False, False]]) if masked else None
    found = []
    for device in ("cpu", "cuda"):
        inputs = [t.to(device).requires_grad_() for t in (context, prob)]
        bev = pool(inputs[0], inputs[1], _index(device, mask), GRID)
        gradients = torch.autograd.grad(bev, inputs, slope.to(device))
        found.append([t.detach().cpu() for t in (bev, *gradients)])
    for on_cpu, on_gpu in zip(*found, strict=True):
        assert on_cpu.abs().max() > 0.1
        torch.testing.assert_close(on_gpu, on_cpu, rtol=1e-5, atol=1e-5)
