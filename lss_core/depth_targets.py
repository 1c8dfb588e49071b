"""How far away what a camera sees is, according to the lidar."""

import torch
from jaxtyping import Float, Int
from torch import Tensor

from lss_core.batch import Batch


def nearest_depths(
    points_ego: Float[Tensor, "P 3"],
    pixel_from_camera: Float[Tensor, "N 3 3"],
    ego_from_camera: Float[Tensor, "N 4 4"],
    image_hw: tuple[int, int],
    stride: int,
) -> Float[Tensor, "N H W"]:
    """Depth of the nearest point in each feature cell, in metres; infinite where there is none.

    Worked out in float64, also under mixed precision, and given in float32.

    Args:
        points_ego: Metres, in `ego`.
        pixel_from_camera: Intrinsics of the network's images, augmentation folded in.
        ego_from_camera: Camera poses.
        image_hw: Of the network's images, in pixels.
        stride: Pixels a feature cell.
    """
    height, width = (side // stride for side in image_hw)
    with torch.autocast(points_ego.device.type, enabled=False):
        camera_from_ego = torch.linalg.inv(ego_from_camera.double())
        points_camera = points_ego.double() @ camera_from_ego[:, :3, :3].transpose(1, 2)
        points_camera = points_camera + camera_from_ego[:, None, :3, 3]
        pixels = points_camera @ pixel_from_camera.double().transpose(1, 2)
    depth_m = points_camera[..., 2]
    is_ahead = depth_m > 0.0
    pixels = pixels[..., :2] / torch.where(is_ahead, depth_m, 1.0)[..., None]
    # A pixel's centre has whole numbers, so the first cell begins at -0.5.
    cells = ((pixels + 0.5) / stride).floor()
    upper = cells.new_tensor([width, height])
    inside = is_ahead & ((cells >= 0) & (cells < upper)).all(dim=-1)
    camera, point = inside.nonzero(as_tuple=True)
    column, row = cells[camera, point].long().unbind(dim=-1)
    depth_m = depth_m.float()
    nearest_m: Tensor = depth_m.new_full((len(pixel_from_camera) * height * width,), torch.inf)
    place = (camera * height + row) * width + column
    nearest_m = nearest_m.scatter_reduce(0, place, depth_m[camera, point], "amin")
    return nearest_m.view(-1, height, width)


def depth_bins(depth_m: Float[Tensor, "*S"], depths_m: tuple[float, ...]) -> Int[Tensor, "*S"]:
    """Index of the nearest of evenly spaced depths; -1 if it is more than half a step beyond them.

    Args:
        depth_m: Along the camera's z axis; infinite where it is not known.
        depths_m: The depths to choose from.

    Raises:
        ValueError: If there are fewer than two depths.
    """
    if len(depths_m) < 2:
        raise ValueError(f"There must be two depths or more to choose from, got {len(depths_m)}.")
    bins = ((depth_m - depths_m[0]) / (depths_m[1] - depths_m[0])).round()
    known = (bins >= 0) & (bins < len(depths_m))
    return torch.where(known, bins, -1.0).long()


def depth_loss(
    depth_prob: Float[Tensor, "B N D H W"], bins: Int[Tensor, "B N H W"]
) -> Float[Tensor, ""]:
    """Mean cross-entropy of the known depths, in nats; 0 where none is known."""
    known = bins >= 0
    at_bin = depth_prob.float().gather(2, bins.clamp(min=0)[:, :, None])[:, :, 0]
    total: Tensor = -(at_bin.clamp(min=1e-6).log() * known).sum()
    return total / known.sum().clamp(min=1)


def batch_depth_bins(
    batch: Batch, image_hw: tuple[int, int], stride: int, depths_m: tuple[float, ...]
) -> Int[Tensor, "B N H W"]:
    """Index of the depth in each feature cell of a batch that has points; -1 where unknown.

    Args:
        batch: With points of the keyframe's sweep.
        image_hw: Of the network's images, in pixels.
        stride: Pixels a feature cell.
        depths_m: The depths to choose from.
    """
    bins = []
    for b, (start, count) in enumerate(
        zip(batch.point_offsets.tolist(), batch.point_counts.tolist(), strict=True)
    ):
        nearest_m = nearest_depths(
            batch.points[start : start + count, :3],
            batch.pixel_from_camera[b],
            batch.ego_from_camera[b],
            image_hw,
            stride,
        )
        there = batch.camera_mask[b, :, None, None]
        bins.append(torch.where(there, depth_bins(nearest_m, depths_m), -1))
    return torch.stack(bins)
