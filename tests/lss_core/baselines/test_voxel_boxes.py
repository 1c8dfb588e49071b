"""Boxes of space and the features they project to, by hand and against a slow loop."""

import itertools
from typing import Literal

import pytest
import torch
from small_rig import IMAGE_HW, rig
from torch import Tensor

from lss_core.baselines.voxel_boxes import find_boxes, pool_boxes
from lss_core.grid import BevGrid

STRIDE = 8
HEIGHTS_M = (-1.0, 0.5, 3.0)
GRID = BevGrid(-4.0, 8.0, -6.0, 6.0, 2.0)
Centers = Literal["cell", "released"] | Tensor


def _rows(num_samples: int, num_cameras: int, channels: int) -> Tensor:
    generator = torch.Generator().manual_seed(1)
    shape = (num_samples, num_cameras, *(s // STRIDE for s in IMAGE_HW), len(HEIGHTS_M) - 1)
    return torch.randn(*shape, channels, generator=generator, dtype=torch.float64)


def _edges(axis: int, centers: Centers) -> list[float]:
    """Pixel coordinates where the feature cells along an axis (u, v) meet."""
    side_px = IMAGE_HW[1 - axis]
    count = side_px // STRIDE
    if isinstance(centers, Tensor):
        middles = [float(centers[axis]) + STRIDE * i for i in range(count)]
    elif centers == "cell":
        middles = [STRIDE * i + (STRIDE - 1) / 2 for i in range(count)]
    else:
        middles = torch.linspace(0.0, side_px - 1.0, count, dtype=torch.float64).tolist()
    half = (middles[1] - middles[0]) / 2
    return [middles[0] - half, *(middle + half for middle in middles)]


def _overlaps(low: float, high: float, edges: list[float]) -> Tensor:
    """Of an interval with each feature cell along an axis."""
    pairs = itertools.pairwise(edges)
    shares = [max(0.0, min(high, right) - max(low, left)) for left, right in pairs]
    return torch.tensor(shares, dtype=torch.float64)


def _loop(rows: Tensor, k: Tensor, poses: Tensor, mask: Tensor, centers: Centers) -> Tensor:
    """The definition written down, one box after the other, in float64."""
    k, poses = k.double(), poses.double()
    result = torch.zeros(len(rows), rows.shape[-1], *GRID.shape, dtype=torch.float64)
    u_edges, v_edges = (_edges(axis, centers) for axis in (0, 1))
    num_heights = len(HEIGHTS_M) - 1
    places = itertools.product(
        range(len(rows)), range(GRID.num_x), range(GRID.num_y), range(num_heights)
    )
    for b, x, y, z in places:
        borders = (
            [GRID.x_min_m + x * GRID.cell_m, GRID.x_min_m + (x + 1) * GRID.cell_m],
            [GRID.y_min_m + y * GRID.cell_m, GRID.y_min_m + (y + 1) * GRID.cell_m],
            HEIGHTS_M[z : z + 2],
        )
        corners = torch.tensor([[*c, 1.0] for c in itertools.product(*borders)]).double()
        means = []
        for n in range(rows.shape[1]):
            if not mask[b, n]:
                continue
            pixels = (corners @ torch.linalg.inv(poses[b, n]).T)[:, :3] @ k[b, n].T
            if pixels[:, 2].min() <= 0.5:
                continue
            u, v = pixels[:, 0] / pixels[:, 2], pixels[:, 1] / pixels[:, 2]
            of_u = _overlaps(float(u.min()), float(u.max()), u_edges)
            of_v = _overlaps(float(v.min()), float(v.max()), v_edges)
            if of_u.sum() * of_v.sum() > 0.0:
                shares = of_v[:, None] * of_u / (of_u.sum() * of_v.sum())
                means.append(torch.einsum("hw,hwc->c", shares, rows[b, n, :, :, z]))
        if means:
            result[b, :, x, y] += torch.stack(means).mean(dim=0)
    return result


@pytest.mark.parametrize("centers", ["cell", "released", torch.tensor([1.5, -2.0])])
def test_agrees_with_box_by_box(centers: Centers) -> None:
    _, k, poses = rig()
    mask = torch.tensor([[True, True, True], [True, False, True]])
    rows = _rows(2, 3, 4)
    boxes = find_boxes(IMAGE_HW, STRIDE, GRID, HEIGHTS_M, k, poses, mask, centers)
    result = pool_boxes(rows, boxes, GRID)
    expected = _loop(rows, k, poses, mask, centers)
    assert 0.3 < (expected != 0.0).double().mean() < 1.0
    torch.testing.assert_close(result, expected, atol=1e-4, rtol=1e-4)


def test_a_box_by_hand() -> None:
    """8 to 10 m ahead, 0 to 2 m to the left, 1 m above and below the camera's own height."""
    grid = BevGrid(8.0, 10.0, -2.0, 2.0, 2.0)
    k = torch.tensor([[[[32.0, 0.0, 33.5], [0.0, 32.0, 31.5], [0.0, 0.0, 1.0]]]])
    pose = torch.eye(4).repeat(1, 1, 1, 1)
    pose[..., :3, :3] = torch.tensor([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
    boxes = find_boxes((64, 64), 8, grid, (-1.0, 1.0), k, pose)
    rows = torch.arange(64.0).view(1, 1, 8, 8, 1, 1)
    result = pool_boxes(rows, boxes, grid)
    # Left: u from 33.5 - 32 * 2 / 8 = 25.5 to 33.5 px, feature columns 3.25 to 4.25; right: 4.25 to
    # 5.25. Both: v 31.5 -+ 4 px, feature rows 3.5 to 4.5; row i, column j say 8 i + j.
    left, right = 8.0 * 3.5 + 3.25, 8.0 * 3.5 + 4.25
    torch.testing.assert_close(result, torch.tensor([[[[right, left]]]]))


def test_gradients_are_those_of_small_changes() -> None:
    _, k, poses = rig(1, 2)
    boxes = find_boxes(IMAGE_HW, STRIDE, GRID, HEIGHTS_M, k, poses)
    rows = _rows(1, 2, 1).requires_grad_()
    assert torch.autograd.gradcheck(lambda r: pool_boxes(r, boxes, GRID), rows, fast_mode=True)


def test_without_a_camera_no_box_is_seen() -> None:
    _, k, poses = rig()
    mask = torch.zeros(2, 3, dtype=torch.bool)
    boxes = find_boxes(IMAGE_HW, STRIDE, GRID, HEIGHTS_M, k, poses, mask)
    assert len(boxes.row_idx) == 0
    assert pool_boxes(_rows(2, 3, 4), boxes, GRID).abs().max() == 0.0
