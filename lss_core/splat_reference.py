"""Two slow roads to the same sums, to hold the fast one against: a plain loop, and the paper's."""

import math
from typing import Any

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from lss_core.grid import BevGrid


def lift_splat_loop(
    context: Float[Tensor, "B N C H W"],
    depth_prob: Float[Tensor, "B N D H W"],
    points_ego: Float[Tensor, "B N D H W 3"],
    grid: BevGrid,
    z_min_m: float = -10.0,
    z_max_m: float = 10.0,
) -> Float[Tensor, "B C X Y"]:
    """The definition written down: one point after the other, in float64; differentiable.

    Shares no code with the fast path, not even the grid's rule.
    """
    context, depth_prob = context.double(), depth_prob.double()
    num_samples, num_cameras, num_bins, height, width, _ = points_ego.shape
    maps = []
    for b in range(num_samples):
        cells = [
            [context.new_zeros(context.shape[2]) for _ in range(grid.num_y)]
            for _ in range(grid.num_x)
        ]
        for n in range(num_cameras):
            for d in range(num_bins):
                for i in range(height):
                    for j in range(width):
                        x_m, y_m, z_m = points_ego[b, n, d, i, j].tolist()
                        if not (math.isfinite(x_m) and math.isfinite(y_m) and math.isfinite(z_m)):
                            continue
                        x = math.floor((x_m - grid.x_min_m) / grid.cell_m)
                        y = math.floor((y_m - grid.y_min_m) / grid.cell_m)
                        if not (0 <= x < grid.num_x and 0 <= y < grid.num_y):
                            continue
                        if not z_min_m <= z_m < z_max_m:
                            continue
                        lifted = context[b, n, :, i, j] * depth_prob[b, n, d, i, j]
                        cells[x][y] = cells[x][y] + lifted
        maps.append(torch.stack([torch.stack(row, dim=-1) for row in cells], dim=-2))
    return torch.stack(maps)


def lift_splat_cumsum(
    context: Float[Tensor, "B N C H W"],
    depth_prob: Float[Tensor, "B N D H W"],
    points_ego: Float[Tensor, "B N D H W 3"],
    grid: BevGrid,
    z_min_m: float = -10.0,
    z_max_m: float = 10.0,
) -> Float[Tensor, "B C X Y"]:
    """Lift every point, sort by cell, sum up, subtract at the boundaries.

    Differences of a long running sum lose digits in single precision: give it float64.

    Paper: sections 3.1 and 4.2 (frustum pooling).
    """
    num_samples = len(points_ego)
    lifted = torch.einsum("bnchw,bndhw->bndhwc", context, depth_prob).flatten(0, 4)
    cells, kept = grid.cells(points_ego[..., :2])
    kept &= (points_ego[..., 2] >= z_min_m) & (points_ego[..., 2] < z_max_m)
    sample = torch.arange(num_samples, device=points_ego.device)[:, None, None, None, None]
    bag = ((sample * grid.num_x + cells[..., 0]) * grid.num_y + cells[..., 1]).flatten()
    order = torch.argsort(torch.where(kept.flatten(), bag, bag.new_tensor(2**62)), stable=True)
    order = order[: int(kept.sum())]
    bag = bag[order]
    is_last = torch.ones_like(bag, dtype=torch.bool)
    is_last[:-1] = bag[1:] != bag[:-1]
    sums: Tensor = _SumSortedRows.apply(lifted[order], is_last)
    result = lifted.new_zeros(num_samples * grid.num_x * grid.num_y, lifted.shape[-1])
    result = result.index_put((bag[is_last],), sums)
    return result.view(num_samples, grid.num_x, grid.num_y, -1).permute(0, 3, 1, 2)


class _SumSortedRows(torch.autograd.Function):
    """Sum of each run of rows; the gradient of a sum, handed back to every row of its run."""

    @staticmethod
    def forward(
        ctx: Any, rows: Float[Tensor, "P C"], is_last: Bool[Tensor, "P"]
    ) -> Float[Tensor, "R C"]:
        """Differences of the running sum between the runs' last rows."""
        run_idx = is_last.cumsum(0) - is_last.long()
        ctx.save_for_backward(run_idx)
        totals = rows.cumsum(0)[is_last]
        return torch.cat([totals[:1], totals[1:] - totals[:-1]])

    @staticmethod
    def backward(ctx: Any, *grads: Float[Tensor, "R C"]) -> tuple[Float[Tensor, "P C"], None]:
        """One gather for the whole layer, whatever the sums went through."""
        (run_idx,) = ctx.saved_tensors
        return grads[0][run_idx], None
