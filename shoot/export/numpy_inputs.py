"""What an exported planner is fed: crops of images and the splat index, of calibration alone.

This file needs NumPy and nothing else. `shoot-export` lays a copy of it beside the exported
planner, to be taken along to machines that have neither shoot nor torch. What it is told of the
planner is the card, the JSON file beside it.

Frames: `ego` has x forward, y left, z up, in metres; a camera z forward, x right, y down. The
centre of the upper left pixel is (0, 0). Matrices act on column vectors.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray


@dataclass(frozen=True)
class Crop:
    """How a camera's image becomes the planner's: resized as a whole, then cut.

    With Pillow: `image.resize(crop.resized_wh, Image.Resampling.BILINEAR).crop(crop.box)`; what
    the box has beyond the image is black.

    Attributes:
        resized_wh: Width and height of the whole image after resizing.
        box: Left, upper, right and lower border of what is kept, in pixels of the resized image.
        pixel_from_rawpixel: [3, 3] where a pixel of the camera's image ends up.
    """

    resized_wh: tuple[int, int]
    box: tuple[int, int, int, int]
    pixel_from_rawpixel: NDArray[np.float64]


def choose_crop(
    card: Mapping[str, Any],
    raw_hw: tuple[int, int],
    rawpixel_from_camera: ArrayLike,
    ego_from_camera: ArrayLike,
) -> Crop:
    """The crop that the planner was evaluated with, for a camera's image.

    Args:
        card: Of the planner.
        raw_hw: Height and width of the camera's image.
        rawpixel_from_camera: [3, 3] its intrinsics; the crop keeps the horizon, if it can.
        ego_from_camera: [4, 4] its pose.
    """
    told = card["images"]
    height, width = int(told["height_px"]), int(told["width_px"])
    raw_h, raw_w = raw_hw
    fit = max(width / raw_w, height / raw_h)
    resized_h, resized_w = max(1, round(raw_h * fit)), max(1, round(raw_w * fit))
    spare_w = resized_w - width
    left = round(0.5 * spare_w) if spare_w > 0 else spare_w // 2
    top = round((1.0 - told["crop_bottom"]) * resized_h) - height
    row = _horizon_row(np.asarray(rawpixel_from_camera), np.asarray(ego_from_camera))
    spare_h = resized_h - height
    if 0 <= top <= spare_h and -0.5 <= row <= raw_h - 0.5:
        horizon_px = (row + 0.5) / raw_h * resized_h
        above, below = (share * height for share in told["horizon"])
        earliest = math.ceil(horizon_px + below) - height
        latest = max(earliest, math.floor(horizon_px - above))
        top = min(max(top, earliest, 0), max(latest, 0), spare_h)
    scale_x, scale_y = resized_w / raw_w, resized_h / raw_h
    # The outer edges of the images meet, not the centres of their outer pixels.
    matrix = [
        [scale_x, 0.0, 0.5 * scale_x - 0.5 - left],
        [0.0, scale_y, 0.5 * scale_y - 0.5 - top],
        [0.0, 0.0, 1.0],
    ]
    return Crop((resized_w, resized_h), (left, top, left + width, top + height), np.array(matrix))


def _horizon_row(
    rawpixel_from_camera: NDArray[np.floating[Any]], ego_from_camera: NDArray[np.floating[Any]]
) -> float:
    """Row in which a camera sees the horizon straight ahead of it; nan if it sees none there."""
    right_up, down_up, _ = ego_from_camera[2, :3]
    if abs(right_up) > abs(down_up):
        return math.nan
    ahead_ego = ego_from_camera[:3, 2] * [1.0, 1.0, 0.0]
    _, v, depth = rawpixel_from_camera @ (ahead_ego @ ego_from_camera[:3, :3])
    return float(v / depth) if depth > 0.0 else math.nan


def make_splat_index(
    card: Mapping[str, Any],
    pixel_from_camera: ArrayLike,
    ego_from_camera: ArrayLike,
    camera_mask: ArrayLike | None = None,
    num_points: int | None = None,
) -> NDArray[np.int64]:
    """[3, P] the planner's `splat_index`: which feature cell lies at which depth in which cell.

    Its rows are the feature cell, counted through cameras, rows and columns; its depth, as a place
    in the card's list; and the grid's cell, X outer, in whose order points are sorted. Points
    outside the grid and those of masked cameras are left out. It changes with the calibration only.

    Args:
        card: Of the planner.
        pixel_from_camera: [N, 3, 3] intrinsics of the planner's images:
            `crop.pixel_from_rawpixel @ rawpixel_from_camera`.
        ego_from_camera: [N, 4, 4] poses of the cameras.
        camera_mask: [N] False for cameras that are missing; their images may be anything.
        num_points: Fill up to as many points, with some that lie in no cell: for runtimes that
            want a fixed size. N times the card's `points_a_camera` is always enough.

    Raises:
        ValueError: If shapes do not belong together, or `num_points` is too small.
    """
    intrinsics = np.asarray(pixel_from_camera, dtype=np.float64)
    poses = np.asarray(ego_from_camera, dtype=np.float64)
    num = len(poses)
    mask = np.ones(num, bool) if camera_mask is None else np.asarray(camera_mask, bool)
    if (intrinsics.shape, poses.shape, mask.shape) != ((num, 3, 3), (num, 4, 4), (num,)):
        raise ValueError(
            "Expected [N, 3, 3] intrinsics, [N, 4, 4] poses and a mask [N] of as many cameras, got "
            f"{list(intrinsics.shape)}, {list(poses.shape)} and {list(mask.shape)}."
        )
    grid, features = card["grid"], card["features"]
    num_cells = grid["num_x"] * grid["num_y"]
    cells = _cells(_points(card, intrinsics, poses), grid)
    cells[~mask] = -1
    # Depths innermost: feature cell times D plus depth.
    flat = np.moveaxis(cells, 1, -1).reshape(-1)
    point_idx = np.flatnonzero(flat >= 0)
    point_idx = point_idx[np.argsort(flat[point_idx], kind="stable")]
    pixel_idx, depth_idx = np.divmod(point_idx, len(features["depths_m"]))
    index: NDArray[np.int64] = np.stack([pixel_idx, depth_idx, flat[point_idx]]).astype(np.int64)
    if num_points is None:
        return index
    if num_points < index.shape[1]:
        raise ValueError(f"{index.shape[1]} points lie on the grid, more than {num_points}.")
    filled = np.zeros((3, num_points), np.int64)
    filled[2] = num_cells  # the cell after the last one, which nobody reads
    filled[:, : index.shape[1]] = index
    return filled


def _points(
    card: Mapping[str, Any],
    pixel_from_camera: NDArray[np.float64],
    ego_from_camera: NDArray[np.float64],
) -> NDArray[np.float32]:
    """[N, D, H, W, 3] where each feature cell would lie at each depth; metres, in `ego`."""
    features = card["features"]
    u_px, v_px = (np.asarray(features[name], np.float64) for name in ("columns_px", "rows_px"))
    depths_m = np.asarray(features["depths_m"], np.float64)
    v_grid, u_grid = np.meshgrid(v_px, u_px, indexing="ij")
    pixels = np.stack([u_grid, v_grid, np.ones_like(u_grid)], axis=-1)
    # In float64, as in training: small errors move points across borders of cells.
    with np.errstate(all="ignore"):
        camera_from_pixel = _inverse(pixel_from_camera)
        ego_from_pixel = ego_from_camera[:, :3, :3] @ camera_from_pixel
        rays = np.einsum("nij,hwj->nhwi", ego_from_pixel, pixels)
        origin_m = ego_from_camera[:, None, None, None, :3, 3]
        points_m = rays[:, None] * depths_m[:, None, None, None] + origin_m
    points: NDArray[np.float32] = points_m.astype(np.float32)
    return points


def _inverse(matrix: NDArray[np.float64]) -> NDArray[np.float64]:
    """Of each of [N, 3, 3]; not finite where there is none, so that it lies in no cell."""
    first, second, third = (matrix[:, :, column] for column in range(3))
    rows = np.stack(
        [np.cross(second, third), np.cross(third, first), np.cross(first, second)], axis=1
    )
    determinant = (first * rows[:, 0]).sum(axis=-1)
    inverse: NDArray[np.float64] = rows / determinant[:, None, None]
    return inverse


def _cells(points_ego: NDArray[np.float32], grid: Mapping[str, Any]) -> NDArray[np.int64]:
    """[...] the cell of each of [..., 3] points; -1 outside. Lower edges are in, upper ones out."""
    lower_m = np.array([grid["x_min_m"], grid["y_min_m"]], np.float32)
    upper = np.array([grid["num_x"], grid["num_y"]], np.float32)
    with np.errstate(invalid="ignore"):
        place = (points_ego[..., :2] - lower_m) / np.float32(grid["cell_m"])
        z_m = points_ego[..., 2]
        inside = ((place >= 0.0) & (place < upper)).all(axis=-1)
        inside &= (z_m >= grid["z_min_m"]) & (z_m < grid["z_max_m"])
    x, y = np.moveaxis(np.where(inside[..., None], place, 0.0).astype(np.int64), -1, 0)
    cells: NDArray[np.int64] = np.where(inside, x * grid["num_y"] + y, -1)
    return cells
