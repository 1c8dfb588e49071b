"""Lift and splat in one step: a cell sums the contexts of pixels that may lie in it, by depth.

A cell's value is a sum of rows of a table (pixels' contexts) with weights (depth probabilities):
an embedding bag. So the tensor of B x N x D x H x W x C lifted features is never built. Which pixel
and depth fall into which cell depends on calibration alone: `build_splat_index` prepares it,
`SplatCache` keeps it.
"""

from collections import OrderedDict
from dataclasses import dataclass
from typing import Any

import torch
import torch.nn.functional as F
from jaxtyping import Bool, Float, Int
from torch import Tensor
from torch.autograd.function import once_differentiable

from lss_core.grid import BevGrid

# A bag of points outside the grid; short, as a GPU sums a bag's points one after the other.
_SPARE_BAG = 256


@dataclass(frozen=True)
class SplatIndex:
    """Which pixel and depth fall into which cell, for the samples of a batch.

    Cells and pixels are counted through all samples. No size depends on where points lie, so that a
    GPU can make it while the host goes on.

    Attributes:
        num_samples: B.
        cell_of: The cell (X outer) of each pixel at each depth; without meaning outside the grid.
        inside: Whether it lies in a cell.
        point_idx: All points, as places in `cell_of`, sorted by cell; those outside the grid last.
        bag_starts: First of each cell's points in `point_idx`; an empty cell starts where the next
            one does. Then R more, which cut what lies outside the grid into short bags that nobody
            reads.
    """

    num_samples: int
    cell_of: Int[Tensor, "BNHW D"]
    inside: Bool[Tensor, "BNHW D"]
    point_idx: Int[Tensor, "P"]
    bag_starts: Int[Tensor, "Q"]

    @property
    def num_bytes(self) -> int:
        """Memory held."""
        tensors = (self.cell_of, self.inside, self.point_idx, self.bag_starts)
        return sum(tensor.nbytes for tensor in tensors)


@torch.no_grad()
def build_splat_index(
    points_ego: Float[Tensor, "B N D H W 3"],
    grid: BevGrid,
    z_min_m: float = -10.0,
    z_max_m: float = 10.0,
    camera_mask: Bool[Tensor, "B N"] | None = None,
) -> SplatIndex:
    """Sort the frustum points of a batch into the grid's cells.

    Points outside the grid, outside [z_min_m, z_max_m), not finite, or of a masked camera are in no
    cell. The sort is stable, so sums always run in the same order. On a GPU the host does not wait.

    Args:
        points_ego: Metres, in `ego`.
        grid: Cells.
        z_min_m: Lower border of the pillars.
        z_max_m: Upper border of the pillars.
        camera_mask: False for cameras that are not there.
    """
    num_samples, num_cells = len(points_ego), len(points_ego) * grid.num_x * grid.num_y
    cells, kept = grid.cells(points_ego[..., :2])
    z_m = points_ego[..., 2]
    kept &= (z_m >= z_min_m) & (z_m < z_max_m)
    if camera_mask is not None:
        kept &= camera_mask[:, :, None, None, None]
    sample = torch.arange(num_samples, device=cells.device)[:, None, None, None, None]
    # int32 halves the memory of the cache and of the bag's reads.
    cell_idx = ((sample * grid.num_x + cells[..., 0]) * grid.num_y + cells[..., 1]).int()
    cell_of, inside = (t.permute(0, 1, 3, 4, 2).flatten(0, 3) for t in (cell_idx, kept))
    bag = torch.where(inside, cell_of, num_cells).flatten()
    counts = torch.zeros(num_cells + 1, dtype=torch.int32, device=bag.device)
    counts.scatter_add_(0, bag.long(), torch.ones_like(bag))
    starts = counts.cumsum(0, dtype=torch.int32) - counts
    spare = torch.arange(-(-len(bag) // _SPARE_BAG), dtype=torch.int32, device=bag.device)
    spare_starts = (starts[num_cells:] + _SPARE_BAG * spare).clamp(max=len(bag))
    return SplatIndex(
        num_samples=num_samples,
        cell_of=cell_of.contiguous(),
        inside=inside.contiguous(),
        point_idx=torch.sort(bag, stable=True).indices.int(),
        bag_starts=torch.cat([starts[:num_cells], spare_starts]),
    )


def pool(
    context: Float[Tensor, "B N C H W"],
    depth_prob: Float[Tensor, "B N D H W"],
    index: SplatIndex,
    grid: BevGrid,
) -> Float[Tensor, "B C X Y"]:
    """Sum context x depth probability into the grid's cells, differentiably in both.

    In float32 (or float64, if given), also under mixed precision: long sums need the digits.

    Args:
        context: What each pixel has to say.
        depth_prob: How likely each pixel lies at each depth.
        index: Of this batch.
        grid: The grid the index was built for.

    Paper: sections 3.1 (Eq. 1) and 3.2.
    """
    with torch.autocast(context.device.type, enabled=False):
        dtype = torch.promote_types(context.dtype, torch.float32)
        # Both are views where channels lie innermost in memory, as convolutions leave them.
        rows = context.to(dtype).permute(0, 1, 3, 4, 2).flatten(0, 3).contiguous()
        weights = depth_prob.to(dtype).permute(0, 1, 3, 4, 2).flatten(0, 3).contiguous()
        num_cells = index.num_samples * grid.num_x * grid.num_y
        bags: Tensor = _SumIntoCells.apply(rows, weights, index, num_cells)
        # A view whose channels lie innermost in memory: the layout convolutions like.
        return bags.view(index.num_samples, *grid.shape, -1).permute(0, 3, 1, 2)


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
        index: SplatIndex,
        num_cells: int,
    ) -> Float[Tensor, "BXY C"]:
        """Sum of the rows of each cell's points, weighted."""
        ctx.save_for_backward(rows, weights)
        ctx.index = index
        bags = F.embedding_bag(
            index.point_idx // weights.shape[1],
            rows,
            index.bag_starts,
            mode="sum",
            per_sample_weights=weights.flatten().index_select(0, index.point_idx),
        )
        return bags[:num_cells]

    @staticmethod
    @once_differentiable
    def backward(
        ctx: Any, *grads: Float[Tensor, "BXY C"]
    ) -> tuple[Float[Tensor, "BNHW C"], Float[Tensor, "BNHW D"], None, None]:
        """Each pixel collects from the cells of its depths; the weights are the same."""
        rows, weights = ctx.saved_tensors
        cell_of, inside = ctx.index.cell_of, ctx.index.inside
        with torch.enable_grad():
            own = torch.where(inside, weights, 0.0).requires_grad_()
            collected = F.embedding_bag(
                cell_of, grads[0].contiguous(), mode="sum", per_sample_weights=own
            )
        # A weight's gradient is the product of its pixel's row and its cell's gradient: what the
        # weight of this second bag gets when the rows come back to it as gradients.
        (grad,) = torch.autograd.grad(collected, own, rows)
        return collected.detach(), grad.masked_fill_(~inside, 0.0), None, None


def lift_splat(
    context: Float[Tensor, "B N C H W"],
    depth_prob: Float[Tensor, "B N D H W"],
    points_ego: Float[Tensor, "B N D H W 3"],
    grid: BevGrid,
    z_min_m: float = -10.0,
    z_max_m: float = 10.0,
) -> Float[Tensor, "B C X Y"]:
    """Sum context x depth probability over the points in each pillar, straight from points.

    The plain door: builds an index, uses it once.

    Args:
        context: What each pixel has to say.
        depth_prob: How likely each pixel lies at each depth.
        points_ego: Where each pixel would lie at each depth; metres, in `ego`. Not differentiated.
        grid: Cells; a point on an upper border is outside.
        z_min_m: Points below are dropped.
        z_max_m: Points at or above are dropped.

    Paper: sections 3.1 (Eq. 1) and 3.2.
    """
    index = build_splat_index(points_ego, grid, z_min_m, z_max_m)
    return pool(context, depth_prob, index, grid)


class SplatCache:
    """Keeps the indices of the calibrations used last: an unchanged calibration costs nothing.

    Calibration changes between scenes, augmentation changes it at every sample: the key is the
    calibration itself, and the memory is bounded. For calibrations on the host: from a GPU's memory
    the key would have to be fetched, which takes longer than the GPU needs for another index.

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
    def key(
        pixel_from_camera: Float[Tensor, "B N 3 3"],
        ego_from_camera: Float[Tensor, "B N 4 4"],
        camera_mask: Bool[Tensor, "B N"],
    ) -> bytes:
        """What tells a batch from others: the bytes of its calibrations and masks."""
        parts = (pixel_from_camera, ego_from_camera, camera_mask)
        shape = str(tuple(camera_mask.shape)).encode()
        return shape + b"".join(part.detach().contiguous().numpy().tobytes() for part in parts)

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
