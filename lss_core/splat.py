"""Lift and splat in one step: a cell sums the contexts of pixels that may lie in it, by depth.

A cell's value is a sum of rows of a table (pixels' contexts) with weights (depth probabilities):
an embedding bag. So the tensor of B x N x D x H x W x C lifted features is never built. Which pixel
and depth fall into which cell depends on calibration alone: `build_splat_index` prepares it,
`SplatCache` keeps it.
"""

from collections import OrderedDict
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import torch
import torch.nn.functional as F
from jaxtyping import Bool, Float, Int
from torch import Tensor
from torch.autograd.function import once_differentiable

from lss_core.grid import BevGrid


@dataclass(frozen=True)
class SplatIndex:
    """Which pixel and depth fall into which cell, for one sample.

    Attributes:
        cell_of: The cell (X outer) of each pixel at each depth; -1 outside the grid.
        point_idx: The points inside the grid, as places in `cell_of`, sorted by cell.
        cell_starts: First of each cell's points in `point_idx`; an empty cell starts where the next
            one does.
    """

    cell_of: Int[Tensor, "NHW D"]
    point_idx: Int[Tensor, "P"]
    cell_starts: Int[Tensor, "XY"]

    @property
    def num_bytes(self) -> int:
        """Memory held."""
        return sum(t.nbytes for t in (self.cell_of, self.point_idx, self.cell_starts))


@torch.no_grad()
def build_splat_index(
    points_ego: Float[Tensor, "N D H W 3"],
    grid: BevGrid,
    z_min_m: float = -10.0,
    z_max_m: float = 10.0,
    camera_mask: Bool[Tensor, "N"] | None = None,
) -> SplatIndex:
    """Sort one sample's frustum points into the grid's cells.

    Points outside the grid, outside [z_min_m, z_max_m), not finite, or of a masked camera are left
    out. The sort is stable, so sums always run in the same order.

    Args:
        points_ego: Metres, in `ego`.
        grid: Cells.
        z_min_m: Lower border of the pillars.
        z_max_m: Upper border of the pillars.
        camera_mask: False for cameras that are not there.
    """
    cells, kept = grid.cells(points_ego[..., :2])
    z_m = points_ego[..., 2]
    kept &= (z_m >= z_min_m) & (z_m < z_max_m)
    if camera_mask is not None:
        kept &= camera_mask[:, None, None, None]
    # int32 halves the memory of the cache and of the bag's reads.
    cell_idx = torch.where(kept, cells[..., 0] * grid.num_y + cells[..., 1], -1).int()
    cell_of = cell_idx.permute(0, 2, 3, 1).flatten(0, 2).contiguous()
    point_idx = (cell_of.flatten() >= 0).nonzero()[:, 0]
    sorted_cells, order = torch.sort(cell_of.flatten()[point_idx], stable=True)
    counts = torch.bincount(sorted_cells, minlength=grid.num_x * grid.num_y)
    return SplatIndex(
        cell_of=cell_of,
        point_idx=point_idx[order].int(),
        cell_starts=(counts.cumsum(0) - counts).int(),
    )


def pool(
    context: Float[Tensor, "B N C H W"],
    depth_prob: Float[Tensor, "B N D H W"],
    indices: Sequence[SplatIndex],
    grid: BevGrid,
) -> Float[Tensor, "B C X Y"]:
    """Sum context x depth probability into the grid's cells, differentiably in both.

    In float32 (or float64, if given), also under mixed precision: long sums need the digits.

    Args:
        context: What each pixel has to say.
        depth_prob: How likely each pixel lies at each depth.
        indices: One per sample of the batch.
        grid: The grid the indices were built for.

    Paper: sections 3.1 (Eq. 1) and 3.2.
    """
    with torch.autocast(context.device.type, enabled=False):
        dtype = torch.promote_types(context.dtype, torch.float32)
        # Both are views where channels lie innermost in memory, as convolutions leave them.
        rows = context.to(dtype).permute(0, 1, 3, 4, 2).flatten(0, 3).contiguous()
        weights = depth_prob.to(dtype).permute(0, 1, 3, 4, 2).flatten(0, 3).contiguous()
        bags: Tensor = _SumIntoCells.apply(rows, weights, tuple(indices))
        # A view whose channels lie innermost in memory: the layout convolutions like.
        return bags.view(len(indices), grid.num_x, grid.num_y, -1).permute(0, 3, 1, 2)


class _SumIntoCells(torch.autograd.Function):
    """A cell's bag of pixels; backward, a pixel's bag of cells: both are sums of weighted rows.

    Autograd's own gradient of the first bag would sort its points by pixel at every call, but they
    stand sorted in the index.
    """

    @staticmethod
    def forward(
        ctx: Any,
        rows: Float[Tensor, "BNHW C"],
        weights: Float[Tensor, "BNHW D"],
        indices: tuple[SplatIndex, ...],
    ) -> Float[Tensor, "BXY C"]:
        """Sum of the rows of each cell's points, weighted."""
        ctx.save_for_backward(rows, weights)
        ctx.indices = indices
        point_idx, cell_starts = _join(indices)
        point_weights = weights.flatten().index_select(0, point_idx)
        pixel_idx = point_idx.floor_divide_(weights.shape[1])
        return F.embedding_bag(
            pixel_idx, rows, cell_starts, mode="sum", per_sample_weights=point_weights
        )

    @staticmethod
    @once_differentiable
    def backward(
        ctx: Any, *grads: Float[Tensor, "BXY C"]
    ) -> tuple[Float[Tensor, "BNHW C"], Float[Tensor, "BNHW D"], None]:
        """Each pixel collects from the cells of its depths; the weights are the same."""
        rows, weights = ctx.saved_tensors
        grad_rows, grad_weights = torch.empty_like(rows), torch.empty_like(weights)
        first_pixel = first_cell = 0
        for index in ctx.indices:
            pixels = slice(first_pixel, first_pixel + len(index.cell_of))
            cells = slice(first_cell, first_cell + len(index.cell_starts))
            outside = index.cell_of < 0
            with torch.enable_grad():
                inside = weights[pixels].masked_fill(outside, 0.0).requires_grad_()
                collected = F.embedding_bag(
                    index.cell_of.clamp(min=0),
                    grads[0][cells].contiguous(),
                    mode="sum",
                    per_sample_weights=inside,
                )
            grad_rows[pixels] = collected.detach()
            # A weight's gradient is the product of its pixel's row and its cell's gradient: what
            # the weight of this second bag gets when the rows come back to it as gradients.
            (grad,) = torch.autograd.grad(collected, inside, rows[pixels])
            grad_weights[pixels] = grad.masked_fill(outside, 0.0)
            first_pixel, first_cell = pixels.stop, cells.stop
        return grad_rows, grad_weights, None


def _join(indices: Sequence[SplatIndex]) -> tuple[Int[Tensor, "P"], Int[Tensor, "BXY"]]:
    """Points and cell starts of a batch whose samples lie one behind the other."""
    point_idx = torch.cat([index.point_idx for index in indices])
    cell_starts = torch.cat([index.cell_starts for index in indices])
    num_places = num_points = num_cells = 0
    for index in indices:
        points = slice(num_points, num_points + len(index.point_idx))
        cells = slice(num_cells, num_cells + len(index.cell_starts))
        point_idx[points] += num_places
        cell_starts[cells] += num_points
        num_places += index.cell_of.numel()
        num_points, num_cells = points.stop, cells.stop
    return point_idx, cell_starts


def lift_splat(
    context: Float[Tensor, "B N C H W"],
    depth_prob: Float[Tensor, "B N D H W"],
    points_ego: Float[Tensor, "B N D H W 3"],
    grid: BevGrid,
    z_min_m: float = -10.0,
    z_max_m: float = 10.0,
) -> Float[Tensor, "B C X Y"]:
    """Sum context x depth probability over the points in each pillar, straight from points.

    The plain door: builds an index per sample, uses it once.

    Args:
        context: What each pixel has to say.
        depth_prob: How likely each pixel lies at each depth.
        points_ego: Where each pixel would lie at each depth; metres, in `ego`. Not differentiated.
        grid: Cells; a point on an upper border is outside.
        z_min_m: Points below are dropped.
        z_max_m: Points at or above are dropped.

    Paper: sections 3.1 (Eq. 1) and 3.2.
    """
    indices = [build_splat_index(points, grid, z_min_m, z_max_m) for points in points_ego]
    return pool(context, depth_prob, indices, grid)


class SplatCache:
    """Keeps the indices of the calibrations used last: an unchanged calibration costs nothing.

    Calibration changes between scenes, augmentation changes it at every sample: the key is the
    calibration itself, and the memory is bounded.

    Attributes:
        hits: Look-ups answered.
        misses: Look-ups not answered.
    """

    def __init__(self, max_entries: int = 4096, max_bytes: int = 512 * 2**20) -> None:
        self.max_entries = max_entries
        self.max_bytes = max_bytes
        self.hits = 0
        self.misses = 0
        self._num_bytes = 0
        self._entries: OrderedDict[bytes, SplatIndex] = OrderedDict()

    def __len__(self) -> int:
        return len(self._entries)

    def __getstate__(self) -> dict[str, object]:
        # Copies of a model, and models sent to other processes, fill a cache of their own.
        return {"max_entries": self.max_entries, "max_bytes": self.max_bytes}

    def __setstate__(self, state: dict[str, int]) -> None:
        self.__init__(**state)  # type: ignore[misc]

    def clear(self) -> None:
        """Forget all indices."""
        self._entries.clear()
        self._num_bytes = 0

    @staticmethod
    def keys(
        pixel_from_camera: Float[Tensor, "B N 3 3"],
        ego_from_camera: Float[Tensor, "B N 4 4"],
        camera_mask: Bool[Tensor, "B N"],
    ) -> list[bytes]:
        """One key per sample: the bytes of its calibration, its mask and the name of the device."""
        device = str(pixel_from_camera.device).encode()
        parts = [
            t.detach().cpu().contiguous().numpy()
            for t in (pixel_from_camera, ego_from_camera, camera_mask)
        ]
        return [
            device + b"".join(part[b].tobytes() for part in parts)
            for b in range(len(pixel_from_camera))
        ]

    def get(self, key: bytes) -> SplatIndex | None:
        """The index kept under a key, or None."""
        index = self._entries.get(key)
        if index is None:
            self.misses += 1
            return None
        self.hits += 1
        self._entries.move_to_end(key)
        return index

    def put(self, key: bytes, index: SplatIndex) -> None:
        """Keep an index; those not used for longest make room."""
        old = self._entries.pop(key, None)
        self._num_bytes += index.num_bytes - (old.num_bytes if old else 0)
        self._entries[key] = index
        while len(self._entries) > 1 and (
            len(self._entries) > self.max_entries or self._num_bytes > self.max_bytes
        ):
            _, dropped = self._entries.popitem(last=False)
            self._num_bytes -= dropped.num_bytes
