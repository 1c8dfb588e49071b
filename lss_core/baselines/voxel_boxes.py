"""Boxes of space above the grid's cells, and the mean of the image features they project to."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import torch
import torch.nn.functional as F
from jaxtyping import Bool, Float, Int
from torch import Tensor

from lss_core.grid import BevGrid

# A box that comes nearer to a camera's plane, or lies behind it, is not seen by it.
_NEAR_M = 0.5


@dataclass(frozen=True)
class VoxelBoxes:
    """Which feature cells each map cell's boxes cover, and by which share.

    Map cells are counted through all samples, X before Y.

    Attributes:
        row_idx: Feature cell and height, as rows of a [B N H W Z] table; sorted by map cell.
        weight: Its share of what the map cell sums.
        bag_starts: First of each map cell's entries in `row_idx`.
    """

    row_idx: Int[Tensor, "P"]
    weight: Float[Tensor, "P"]
    bag_starts: Int[Tensor, "BXY"]


@torch.no_grad()
def find_boxes(
    image_hw: tuple[int, int],
    stride: int,
    grid: BevGrid,
    heights_m: Sequence[float],
    pixel_from_camera: Float[Tensor, "B N 3 3"],
    ego_from_camera: Float[Tensor, "B N 4 4"],
    camera_mask: Bool[Tensor, "B N"] | None = None,
    centers: Literal["cell", "released"] | Float[Tensor, "2"] = "cell",
) -> VoxelBoxes:
    """Project each box of space into each camera, and cut its bounds into feature cells.

    A feature cell is a square of the image on which its feature is constant. A box's weights are
    the shares of its projection's bounding rectangle, as far as that lies in the image, and sum to
    one over the cameras that see it; to none if no camera does. On a GPU the host waits for the
    number of entries.

    Args:
        image_hw: Height and width of the network's image in pixels.
        stride: Pixels per feature cell.
        grid: Cells.
        heights_m: Z + 1 borders of the boxes above a cell, metres above the ego frame's ground.
        pixel_from_camera: Intrinsics of the network's image, augmentation folded in.
        ego_from_camera: Camera poses, rigid.
        camera_mask: False for cameras that are not there.
        centers: Which pixels feature cells stand for, as in `lss_core.camera.frustum_points`.
    """
    height, width = (side // stride for side in image_hw)
    num_samples, num_cameras = pixel_from_camera.shape[:2]
    with torch.autocast(pixel_from_camera.device.type, enabled=False):
        feature_from_ego = _feature_from_ego(
            image_hw, stride, pixel_from_camera.double(), ego_from_camera.double(), centers
        ).float()
        low, high, nearest_m = _bounds(feature_from_ego, grid, heights_m)  # B X Y N Z 2
        sides = low.new_tensor([width, height])
        low, high = low.clamp(min=0.0).minimum(sides), high.clamp(min=0.0).minimum(sides)
        seen = (nearest_m > _NEAR_M) & (high > low).all(dim=-1)
        if camera_mask is not None:
            seen &= camera_mask[:, None, None, :, None]
        num_seen = seen.sum(dim=3, keepdim=True).expand_as(seen)[seen]
        sample, x, y, camera, z = seen.nonzero().unbind(dim=1)
        low, high = low[seen], high[seen]
        first, counts = low.floor().long(), (high.ceil() - low.floor()).long()
        entries = counts.prod(dim=1)
        box = torch.repeat_interleave(torch.arange(len(entries), device=low.device), entries)
        place = torch.arange(len(box), device=low.device) - (entries.cumsum(0) - entries)[box]
        columns = counts[box, 0]
        cell = first[box] + torch.stack([place % columns, place // columns], dim=1)
        covered = (high[box].minimum(cell + 1.0) - low[box].maximum(cell.float())).prod(dim=1)
        area = (high - low).prod(dim=1)
        image = (sample * num_cameras + camera)[box]
        row_idx = ((image * height + cell[:, 1]) * width + cell[:, 0]) * (len(heights_m) - 1)
        map_cell = (sample * grid.num_x + x) * grid.num_y + y
        per_cell = entries.new_zeros(num_samples * grid.num_x * grid.num_y)
        per_cell.index_add_(0, map_cell, entries)
        return VoxelBoxes(
            row_idx=row_idx + z[box],
            weight=covered / (area * num_seen)[box],
            bag_starts=per_cell.cumsum(0) - per_cell,
        )


def pool_boxes(
    rows: Float[Tensor, "B N H W Z C"], boxes: VoxelBoxes, grid: BevGrid
) -> Float[Tensor, "B C X Y"]:
    """Sum over a cell's boxes of the mean feature of each; differentiable in `rows`.

    Args:
        rows: Features of each image, for boxes of each height.
        boxes: Of this batch.
        grid: The grid the boxes stand on.
    """
    sums = F.embedding_bag(
        boxes.row_idx,
        rows.flatten(0, 4),
        boxes.bag_starts,
        mode="sum",
        per_sample_weights=boxes.weight.to(rows.dtype),
    )
    return sums.view(len(rows), *grid.shape, -1).permute(0, 3, 1, 2)


def _feature_from_ego(
    image_hw: tuple[int, int],
    stride: int,
    pixel_from_camera: Float[Tensor, "B N 3 3"],
    ego_from_camera: Float[Tensor, "B N 4 4"],
    centers: Literal["cell", "released"] | Float[Tensor, "2"],
) -> Float[Tensor, "B N 3 4"]:
    """Homogeneous (column, row) of feature cells; cell i reaches from i to i + 1."""
    pixels = pixel_from_camera.new_zeros(3, 3)
    pixels[2, 2] = 1.0
    for axis, side_px in enumerate(reversed(image_hw)):
        spacing_px, first_px = float(stride), (stride - 1) / 2.0
        if centers == "released":
            spacing_px, first_px = (side_px - 1.0) / max(1, side_px // stride - 1), 0.0
        first = centers[axis] if isinstance(centers, Tensor) else first_px
        pixels[axis, axis] = 1.0 / spacing_px
        pixels[axis, 2] = 0.5 - first / spacing_px
    camera_from_ego = ego_from_camera[..., :3, :3].transpose(-1, -2)
    origin = -camera_from_ego @ ego_from_camera[..., :3, 3:]
    return pixels @ pixel_from_camera @ torch.cat([camera_from_ego, origin], dim=-1)


def _bounds(
    feature_from_ego: Float[Tensor, "B N 3 4"], grid: BevGrid, heights_m: Sequence[float]
) -> tuple[Float[Tensor, "B X Y N Z 2"], Float[Tensor, "B X Y N Z 2"], Float[Tensor, "B X Y N Z"]]:
    """Lowest and highest (column, row) of the corners of each box, and their smallest depth."""
    axes = (
        grid.x_min_m + torch.arange(grid.num_x + 1) * grid.cell_m,
        grid.y_min_m + torch.arange(grid.num_y + 1) * grid.cell_m,
        torch.tensor(heights_m),
    )
    x, y, z = (axis.to(feature_from_ego) for axis in axes)
    of_x, of_y, of_z, of_1 = feature_from_ego[:, None, None, :, None].unbind(dim=-1)
    corners = x[:, None, None, None, None] * of_x + (
        y[:, None, None, None] * of_y + (z[:, None] * of_z + of_1)
    )  # B X+1 Y+1 N Z+1 3
    depth_m = corners[..., 2]
    place = corners[..., :2] / depth_m[..., None].clamp(min=_NEAR_M)
    low, high, nearest_m = place, place, depth_m
    for axis in (1, 2, 4):
        low = torch.minimum(*_neighbours(low, axis))
        high = torch.maximum(*_neighbours(high, axis))
        nearest_m = torch.minimum(*_neighbours(nearest_m, axis))
    return low, high, nearest_m


def _neighbours(values: Tensor, axis: int) -> tuple[Tensor, Tensor]:
    """All but the last along an axis, and all but the first."""
    count = values.shape[axis] - 1
    return values.narrow(axis, 0, count), values.narrow(axis, 1, count)
