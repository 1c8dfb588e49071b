"""The pinhole camera: where a pixel looks, where a point lands, what augmentation does to both.

A pixel's centre has whole coordinates: (0, 0) is the centre of the upper left pixel. The camera
frame has x to the right, y down and z forward; depth is z. Resizing, cropping, mirroring and
turning an image are affine maps of the pixel plane, so they fold into the intrinsics:
`pixel_from_camera = pixel_from_rawpixel @ rawpixel_from_camera`.
"""

import math
from collections.abc import Sequence
from typing import Literal

import numpy as np
import torch
from jaxtyping import Float
from numpy.typing import NDArray
from torch import Tensor

FloatArray = NDArray[np.float64]


def frustum_points(
    image_hw: tuple[int, int],
    stride: int,
    depths_m: Float[Tensor, "D"] | Sequence[float],
    pixel_from_camera: Float[Tensor, "B N 3 3"],
    ego_from_camera: Float[Tensor, "B N 4 4"],
    centers: Literal["cell", "released"] | Float[Tensor, "2"] = "cell",
) -> Float[Tensor, "B N D H W 3"]:
    """Where each feature cell would lie in `ego` at each depth, in metres, float32.

    Feature cell i of stride s stands for pixel s * i + (s - 1) / 2, its centre. Computed in float64
    (also under autocast): small errors move points across cell borders.

    Paper: section 3.1 (Lift). Deviation: pixel centres, see docs/deviations.md.

    Args:
        image_hw: Height and width of the network's image in pixels, whole multiples of `stride`.
        stride: Pixels per feature cell.
        depths_m: Depths along the camera's z axis. To copy numbers to a GPU the host waits, for a
            tensor that lies there it does not.
        pixel_from_camera: Intrinsics of the network's image, augmentation folded in.
        ego_from_camera: Camera poses.
        centers: `released` spreads the cells evenly from the first to the last pixel instead, as
            the released perception code does. Two numbers: feature cell (0, 0) stands for this
            pixel (u, v), cell i along an axis for s * i pixels more.

    Raises:
        ValueError: If the image is not a whole number of feature cells.
    """
    height_px, width_px = image_hw
    if height_px % stride or width_px % stride:
        raise ValueError(
            f"An image of {height_px}x{width_px} px is not a whole number of feature cells of "
            f"{stride} px; choose multiples of {stride}."
        )
    device = pixel_from_camera.device
    with torch.autocast(device.type, enabled=False), torch.no_grad():
        depth_m = torch.as_tensor(depths_m, dtype=torch.float64, device=device)
        first_u, first_v = (centers, centers) if isinstance(centers, str) else centers
        u_px = cell_centres(width_px, stride, first_u, device)
        v_px = cell_centres(height_px, stride, first_v, device)
        v_grid, u_grid = torch.meshgrid(v_px, u_px, indexing="ij")
        pixels = torch.stack([u_grid, v_grid, torch.ones_like(u_grid)], dim=-1)  # H W 3
        camera_from_pixel = _inverse(pixel_from_camera.double())
        ego_from_camera64 = ego_from_camera.double()
        # One ray per pixel, of length 1 in z; the rest is scaling by depth.
        ego_from_pixel = ego_from_camera64[..., :3, :3] @ camera_from_pixel
        rays = torch.einsum("bnij,hwj->bnhwi", ego_from_pixel, pixels)
        origin_m = ego_from_camera64[..., :3, 3][:, :, None, None, None]
        points = rays[:, :, None] * depth_m[:, None, None, None] + origin_m
        return points.float()


def cell_centres(
    length_px: int,
    stride: int,
    centers: Literal["cell", "released"] | Float[Tensor, ""],
    device: torch.device,
) -> Float[Tensor, "S"]:
    """Pixel coordinate that each feature cell along one side stands for, float64.

    Args:
        length_px: Of that side, a whole multiple of `stride`.
        stride: Pixels per feature cell.
        centers: As in `frustum_points`, of this axis.
        device: Where they are made.
    """
    count = length_px // stride
    if centers == "released":
        return torch.linspace(0.0, length_px - 1.0, count, dtype=torch.float64, device=device)
    first_px = centers.double() if isinstance(centers, Tensor) else (stride - 1) / 2.0
    return torch.arange(count, dtype=torch.float64, device=device) * stride + first_px


def _inverse(matrix: Float[Tensor, "*S 3 3"]) -> Float[Tensor, "*S 3 3"]:
    """Of each matrix; not finite where there is none.

    `torch.linalg.inv` has the host wait for a GPU to say whether there is one.
    """
    first, second, third = matrix.unbind(dim=-1)
    rows = torch.stack(
        [
            torch.linalg.cross(second, third),
            torch.linalg.cross(third, first),
            torch.linalg.cross(first, second),
        ],
        dim=-2,
    )
    determinant = (first * rows[..., 0, :]).sum(dim=-1)
    return rows / determinant[..., None, None]


def project(
    points_ego: FloatArray,
    pixel_from_camera: FloatArray,
    ego_from_camera: FloatArray,
) -> tuple[FloatArray, FloatArray]:
    """Pixel [..., 2] where points [..., 3] of `ego` appear in one camera, and their depth [...].

    Depth is in metres along the camera's z axis. Pixels of points that are not in front of the
    camera (depth <= 0) are nan.

    Args:
        points_ego: Metres, in `ego`.
        pixel_from_camera: [3, 3] intrinsics.
        ego_from_camera: [4, 4] camera pose.
    """
    offset_m = np.asarray(points_ego, dtype=np.float64) - ego_from_camera[:3, 3]
    points_camera = offset_m @ ego_from_camera[:3, :3]  # the inverse of a rotation is its transpose
    depth_m: FloatArray = points_camera[..., 2]
    homogeneous = points_camera @ np.asarray(pixel_from_camera, dtype=np.float64).T
    in_front = depth_m > 0.0
    safe_depth_m = np.where(in_front, depth_m, 1.0)
    pixels: FloatArray = np.where(
        in_front[..., None], homogeneous[..., :2] / safe_depth_m[..., None], np.nan
    )
    return pixels, depth_m


def field_of_view(
    pixel_from_camera: FloatArray, width_px: FloatArray | NDArray[np.int64]
) -> FloatArray:
    """Horizontal angle [...] between what the outer edges of an image's first and last column see.

    Args:
        pixel_from_camera: [..., 3, 3] intrinsics.
        width_px: [...] columns of the image.
    """
    focal_px, centre_px = pixel_from_camera[..., 0, 0], pixel_from_camera[..., 0, 2]
    left, right = centre_px + 0.5, width_px - 0.5 - centre_px
    angle: FloatArray = np.arctan2(left, focal_px) + np.arctan2(right, focal_px)
    return angle


def horizon_line(pixel_from_camera: FloatArray, ego_from_camera: FloatArray) -> FloatArray:
    """The line a, b, c of pixels u, v with a u + b v + c = 0 where level rays of `ego` end.

    `b` is positive for a camera that stands upright: pixels below the horizon are on its positive
    side.

    Args:
        pixel_from_camera: [3, 3] intrinsics.
        ego_from_camera: [4, 4] camera pose.
    """
    # A pixel's ray is level if it has no share of the vertical, which is row 2 of the rotation.
    line: FloatArray = -ego_from_camera[2, :3] @ np.linalg.inv(pixel_from_camera)
    return line


def horizon_row(pixel_from_camera: FloatArray, ego_from_camera: FloatArray) -> float | None:
    """Row at which a camera sees the horizon straight ahead of it, be it in its image or not.

    None for a camera that looks straight up or down, and for one that lies on its side: its horizon
    runs from top to bottom.

    Args:
        pixel_from_camera: [3, 3] intrinsics.
        ego_from_camera: [4, 4] camera pose; `ego` stands level.
    """
    right_up, down_up, _ = ego_from_camera[2, :3]
    if abs(right_up) > abs(down_up):
        return None
    level = ego_from_camera[:3, 2] * [1.0, 1.0, 0.0]
    # All level points in one direction appear in one row, whatever their distance.
    pixel, _ = project(ego_from_camera[:3, 3] + level, pixel_from_camera, ego_from_camera)
    return float(pixel[1]) if np.isfinite(pixel[1]) else None


def resize_map(scale_x: float, scale_y: float | None = None) -> FloatArray:
    """Pixel map [3, 3] of resizing: the outer edges of the images meet, not the outer centres.

    Args:
        scale_x: New width / old width.
        scale_y: New height / old height; the same as `scale_x` if not given.
    """
    scale_y = scale_x if scale_y is None else scale_y
    return np.array(
        [
            [scale_x, 0.0, 0.5 * scale_x - 0.5],
            [0.0, scale_y, 0.5 * scale_y - 0.5],
            [0.0, 0.0, 1.0],
        ]
    )


def crop_map(left_px: float | int, top_px: float | int) -> FloatArray:
    """Pixel map [3, 3] of a crop whose upper left pixel is (left_px, top_px) of the whole image."""
    return np.array([[1.0, 0.0, -left_px], [0.0, 1.0, -top_px], [0.0, 0.0, 1.0]])


def flip_map(width_px: int) -> FloatArray:
    """Pixel map [3, 3] of mirroring left to right: column 0 becomes column width_px - 1."""
    return np.array([[-1.0, 0.0, width_px - 1.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])


def rotate_map(angle_rad: float, image_hw: tuple[int, int]) -> FloatArray:
    """Pixel map [3, 3] of turning the content about the centre, counter-clockwise to the eye."""
    height_px, width_px = image_hw
    centre_u, centre_v = (width_px - 1) / 2.0, (height_px - 1) / 2.0
    cos, sin = math.cos(angle_rad), math.sin(angle_rad)
    # v grows downwards, so the counter-clockwise turn has its signs the other way round.
    return np.array(
        [
            [cos, sin, centre_u - cos * centre_u - sin * centre_v],
            [-sin, cos, centre_v + sin * centre_u - cos * centre_v],
            [0.0, 0.0, 1.0],
        ]
    )
