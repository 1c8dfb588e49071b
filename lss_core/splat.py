"""Lift and splat in one step: a cell sums the contexts of pixels that may lie in it, by depth.

A cell's value is a sum of rows of a table (pixels' contexts) with weights (depth probabilities):
an embedding bag. So the tensor of B x N x D x H x W x C lifted features is never built. Which pixel
and depth fall into which cell depends on calibration alone: `build_splat_index` prepares it,
`SplatCache` keeps it.
"""

from collections import OrderedDict
from collections.abc import Sequence
from dataclasses import dataclass

import torch
import torch.nn.functional as F
from jaxtyping import Bool, Float, Int
from torch import Tensor

from lss_core.grid import BevGrid


@dataclass(frozen=True)
class SplatIndex:
    """Which pixel and depth fall into which cell, for one sample; points outside the grid are gone.

    Attributes:
        pixel_idx: Row of each kept point's pixel among the sample's N*H*W pixels, sorted by cell.
        depth_idx: Place of each kept point among the sample's N*D*H*W depth probabilities.
        cell_starts: First point of each of the X*Y cells (X outer); an empty cell starts where the
            next one does.
        num_pixels: N*H*W.
        num_depths: N*D*H*W.
    """

    pixel_idx: Int[Tensor, "P"]
    depth_idx: Int[Tensor, "P"]
    cell_starts: Int[Tensor, "XY"]
    num_pixels: int
    num_depths: int

    @property
    def num_bytes(self) -> int:
        """Memory held."""
        return sum(t.nbytes for t in (self.pixel_idx, self.depth_idx, self.cell_starts))


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
    num_cameras, num_bins, height, width = points_ego.shape[:4]
    cells, kept = grid.cells(points_ego[..., :2])
    z_m = points_ego[..., 2]
    kept &= (z_m >= z_min_m) & (z_m < z_max_m)
    if camera_mask is not None:
        kept &= camera_mask[:, None, None, None]
    depth_idx = kept.flatten().nonzero()[:, 0]
    cell_idx = (cells[..., 0] * grid.num_y + cells[..., 1]).flatten()[depth_idx]
    cell_idx, order = torch.sort(cell_idx, stable=True)
    depth_idx = depth_idx[order]
    area = height * width
    pixel_idx = depth_idx // (num_bins * area) * area + depth_idx % area
    counts = torch.bincount(cell_idx, minlength=grid.num_x * grid.num_y)
    # int32 halves the memory of the cache and of the bag's reads.
    return SplatIndex(
        pixel_idx=pixel_idx.int(),
        depth_idx=depth_idx.int(),
        cell_starts=(counts.cumsum(0) - counts).int(),
        num_pixels=num_cameras * area,
        num_depths=num_cameras * num_bins * area,
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
        rows = context.to(dtype).permute(0, 1, 3, 4, 2).flatten(0, 3)
        weights = depth_prob.to(dtype).flatten()
        joined = _join(indices)
        bags = F.embedding_bag(
            joined.pixel_idx,
            rows,
            joined.cell_starts,
            mode="sum",
            per_sample_weights=weights.index_select(0, joined.depth_idx),
        )
        # A view whose channels lie innermost in memory: the layout convolutions like.
        return bags.view(len(indices), grid.num_x, grid.num_y, -1).permute(0, 3, 1, 2)


def _join(indices: Sequence[SplatIndex]) -> SplatIndex:
    """One index for a batch whose samples lie one behind the other."""
    if len(indices) == 1:
        return indices[0]
    pixel_idx, depth_idx, cell_starts = [], [], []
    num_points = num_pixels = num_depths = 0
    for index in indices:
        pixel_idx.append(index.pixel_idx + num_pixels)
        depth_idx.append(index.depth_idx + num_depths)
        cell_starts.append(index.cell_starts + num_points)
        num_points += len(index.pixel_idx)
        num_pixels += index.num_pixels
        num_depths += index.num_depths
    return SplatIndex(
        pixel_idx=torch.cat(pixel_idx),
        depth_idx=torch.cat(depth_idx),
        cell_starts=torch.cat(cell_starts),
        num_pixels=num_pixels,
        num_depths=num_depths,
    )


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
