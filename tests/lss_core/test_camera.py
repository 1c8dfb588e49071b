"""Pixels to points and back, and what PIL and OpenCV do to a dot against what our maps say."""

import math

import cv2
import numpy as np
import pytest
import torch
from PIL import Image

from lss_core.camera import (
    crop_map,
    flip_map,
    frustum_points,
    project,
    resize_map,
    rotate_map,
)
from lss_core.geometry import rigid_from_quaternion

# Looks along ego x: camera x (right) is -y, camera y (down) is -z, camera z (forward) is x.
LOOK_FORWARD = np.array(
    [[0.0, 0.0, 1.0, 1.5], [-1.0, 0.0, 0.0, 0.2], [0.0, -1.0, 0.0, 1.6], [0.0, 0.0, 0.0, 1.0]]
)
INTRINSICS = np.array([[200.0, 0.0, 87.0], [0.0, 210.0, 31.0], [0.0, 0.0, 1.0]])


def _frustum(
    pixel_from_camera: np.ndarray,
    ego_from_camera: np.ndarray,
    image_hw: tuple[int, int] = (64, 176),
    stride: int = 16,
    depths_m: tuple[float, ...] = (4.0, 20.0),
    centers: str = "cell",
) -> torch.Tensor:
    return frustum_points(
        image_hw,
        stride,
        depths_m,
        torch.tensor(pixel_from_camera, dtype=torch.float32)[None, None],
        torch.tensor(ego_from_camera, dtype=torch.float32)[None, None],
        centers=centers,  # type: ignore[arg-type]
    )[0, 0]


def _any_pose() -> np.ndarray:
    return rigid_from_quaternion(np.array([1.7, -0.4, 1.5]), np.array([0.5, -0.48, 0.53, -0.46]))


def test_a_feature_cell_is_where_one_works_it_out_by_hand() -> None:
    # Row 2, column 7 of stride 16 is pixel (119.5, 39.5); at 20 m: right 20 * 32.5 / 200 = 3.25 m,
    # down 20 * 8.5 / 210 = 0.8095 m; so 21.5 m ahead, 3.05 m to the right, 0.79 m above ground.
    points = _frustum(INTRINSICS, LOOK_FORWARD)
    assert points.shape == (2, 4, 11, 3)
    assert points.dtype == torch.float32
    np.testing.assert_allclose(points[1, 2, 7].numpy(), [21.5, -3.05, 0.790476], atol=1e-5)


def test_depth_runs_along_the_cameras_axis_not_along_the_ray() -> None:
    points = _frustum(INTRINSICS, LOOK_FORWARD)
    np.testing.assert_allclose(points[0, ..., 0].numpy(), 5.5, atol=1e-5)
    np.testing.assert_allclose(points[1, ..., 0].numpy(), 21.5, atol=1e-5)


def test_cell_centres_are_not_stretched_to_the_images_edges() -> None:
    pose = _any_pose()
    for centers, first_px, last_px in (("cell", 7.5, 167.5), ("released", 0.0, 175.0)):
        points = _frustum(INTRINSICS, pose, centers=centers)
        pixels, _ = project(points.double().numpy(), INTRINSICS, pose)
        np.testing.assert_allclose(pixels[..., 0, 0], first_px, atol=1e-3)
        np.testing.assert_allclose(pixels[..., -1, 0], last_px, atol=1e-3)
        spacing_px = np.diff(pixels[0, 0, :, 0])
        np.testing.assert_allclose(spacing_px, (last_px - first_px) / 10, atol=1e-3)


def test_frustum_points_project_back_to_their_pixels_and_depths() -> None:
    pose = _any_pose()
    pixel_from_camera = rotate_map(0.3, (64, 176)) @ flip_map(176) @ resize_map(0.7) @ INTRINSICS
    points = _frustum(pixel_from_camera, pose, stride=8)
    pixels, depth_m = project(points.double().numpy(), pixel_from_camera, pose)
    v_px, u_px = np.meshgrid(np.arange(8) * 8 + 3.5, np.arange(22) * 8 + 3.5, indexing="ij")
    np.testing.assert_allclose(pixels[0], np.stack([u_px, v_px], axis=-1), atol=1e-3)
    np.testing.assert_allclose(depth_m[0], 4.0, atol=1e-5)
    np.testing.assert_allclose(depth_m[1], 20.0, atol=1e-5)


def test_points_stay_float32_under_autocast() -> None:
    expected = _frustum(INTRINSICS, _any_pose())
    with torch.autocast("cpu", dtype=torch.bfloat16):
        points = _frustum(INTRINSICS, _any_pose())
    assert points.dtype == torch.float32
    assert torch.equal(points, expected)


def test_images_that_are_no_whole_number_of_cells_are_refused() -> None:
    with pytest.raises(ValueError, match="multiples of 16"):
        _frustum(INTRINSICS, LOOK_FORWARD, image_hw=(60, 176))


def test_projection_by_hand_and_behind_the_camera() -> None:
    points_ego = np.array([[21.5, -3.05, 1.6 - 17.0 / 21.0], [-10.0, 0.0, 0.0]])
    pixels, depth_m = project(points_ego, INTRINSICS, LOOK_FORWARD)
    np.testing.assert_allclose(pixels[0], [119.5, 39.5], atol=1e-9)
    np.testing.assert_allclose(depth_m, [20.0, -11.5], atol=1e-9)
    assert np.isnan(pixels[1]).all()


def _mapped(pixel_map: np.ndarray, u_px: float, v_px: float) -> np.ndarray:
    return (pixel_map @ np.array([u_px, v_px, 1.0]))[:2]


def _image_with_dot(u_px: int, v_px: int, height_px: int = 90, width_px: int = 160) -> np.ndarray:
    image = np.zeros((height_px, width_px), dtype=np.uint8)
    image[v_px - 2 : v_px + 3, u_px - 2 : u_px + 3] = 255
    return image


def _dot(image: np.ndarray) -> np.ndarray:
    """Centre of mass (u, v)."""
    weight = image.astype(np.float64)
    v_px, u_px = np.indices(weight.shape)
    return np.array([(u_px * weight).sum(), (v_px * weight).sum()]) / weight.sum()


@pytest.mark.parametrize("size", [(80, 45), (40, 30), (224, 126)])
def test_resizing_agrees_with_pillow_and_opencv(size: tuple[int, int]) -> None:
    image = _image_with_dot(113, 29)
    expected = _mapped(resize_map(size[0] / 160, size[1] / 90), 113, 29)
    pillow = np.asarray(Image.fromarray(image).resize(size, Image.Resampling.BILINEAR))
    np.testing.assert_allclose(_dot(pillow), expected, atol=0.12)
    opencv = cv2.resize(image, size, interpolation=cv2.INTER_AREA)
    if size[0] < 160:
        np.testing.assert_allclose(_dot(opencv), expected, atol=0.12)


def test_cropping_agrees_with_pillow() -> None:
    image = Image.fromarray(_image_with_dot(113, 29)).crop((50, 17, 150, 80))
    np.testing.assert_allclose(_dot(np.asarray(image)), _mapped(crop_map(50, 17), 113, 29))
    np.testing.assert_allclose(_mapped(crop_map(50, 17), 113, 29), [63.0, 12.0])


def test_mirroring_agrees_with_pillow() -> None:
    image = Image.fromarray(_image_with_dot(113, 29))
    mirrored = image.transpose(Image.Transpose.FLIP_LEFT_RIGHT)
    np.testing.assert_allclose(_dot(np.asarray(mirrored)), _mapped(flip_map(160), 113, 29))
    np.testing.assert_allclose(_mapped(flip_map(160), 113, 29), [46.0, 29.0])


@pytest.mark.parametrize("angle_rad", [0.09, -0.2, 0.5])
def test_turning_agrees_with_pillow(angle_rad: float) -> None:
    image = Image.fromarray(_image_with_dot(103, 29))
    turned = image.rotate(math.degrees(angle_rad), resample=Image.Resampling.BILINEAR)
    expected = _mapped(rotate_map(angle_rad, (90, 160)), 103, 29)
    np.testing.assert_allclose(_dot(np.asarray(turned)), expected, atol=0.05)


def test_turning_agrees_with_opencvs_warp_of_the_same_matrix() -> None:
    pixel_map = rotate_map(0.3, (90, 160)) @ resize_map(0.8)
    image = _image_with_dot(103, 29)
    warped = cv2.warpAffine(image, pixel_map[:2], (160, 90), flags=cv2.INTER_LINEAR)
    np.testing.assert_allclose(_dot(warped), _mapped(pixel_map, 103, 29), atol=0.05)


def test_augmenting_image_and_intrinsics_keeps_a_point_on_its_dot() -> None:
    # A point of the world is drawn in the raw image; after every step the new intrinsics find it.
    pose = _any_pose()
    rawpixel_from_camera = np.array([[120.0, 0.0, 79.5], [0.0, 120.0, 44.5], [0.0, 0.0, 1.0]])
    # Chosen so that the point lands on whole pixel (103, 29) at 10 m.
    point_camera = np.linalg.inv(rawpixel_from_camera) @ np.array([1030.0, 290.0, 10.0])
    point_ego = pose[:3, :3] @ point_camera + pose[:3, 3]
    image = Image.fromarray(_image_with_dot(103, 29))
    image = image.resize((128, 72), Image.Resampling.BILINEAR).crop((10, 6, 126, 70))
    image = image.transpose(Image.Transpose.FLIP_LEFT_RIGHT)
    image = image.rotate(math.degrees(-0.1), resample=Image.Resampling.BILINEAR)
    pixel_from_rawpixel = (
        rotate_map(-0.1, (64, 116)) @ flip_map(116) @ crop_map(10, 6) @ resize_map(0.8)
    )
    pixels, depth_m = project(point_ego, pixel_from_rawpixel @ rawpixel_from_camera, pose)
    assert depth_m == pytest.approx(10.0)
    np.testing.assert_allclose(_dot(np.asarray(image)), pixels, atol=0.1)
