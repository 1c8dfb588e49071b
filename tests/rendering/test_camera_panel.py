"""Paths on the ground land where a camera sees them."""

import numpy as np
import pytest
from rendering_case import IMAGE_HW, PIXEL_FROM_CAMERA, looking, straight

from shoot.rendering.camera_panel import project_path, project_ribbon, subdivide
from shoot.rendering.sample_view import from_origin


def test_straight_path_hits_hand_worked_pixels() -> None:
    path_m = np.array([[0.0, 0.0], [30.0, 3.0]])  # y = x / 10: u = 70, v = 60 + 150 / x
    (pixels,) = project_path(path_m, PIXEL_FROM_CAMERA, looking(0.0), IMAGE_HW)
    np.testing.assert_allclose(pixels[:, 0], 70.0, atol=1e-9)
    assert pixels[-1, 1] == pytest.approx(65.0)
    # The image ends at v = 119.5, 2.52 m ahead; the line goes on past it by one step, no more.
    assert pixels[0, 1] > 119.5 >= pixels[1, 1]
    assert pixels[0, 1] < 60.0 + 150.0 / (2.52 - 0.15)


def test_left_of_the_car_is_left_in_the_image() -> None:
    (pixels,) = project_path(
        from_origin(straight(5.0, 0.3)), PIXEL_FROM_CAMERA, looking(0.0), IMAGE_HW
    )
    assert (pixels[:, 0] < 80.0).all()
    (mirrored,) = project_path(
        from_origin(straight(5.0, -0.3)), PIXEL_FROM_CAMERA, looking(0.0), IMAGE_HW
    )
    np.testing.assert_allclose(pixels[:, 0] + mirrored[:, 0], 160.0, atol=1e-9)


def test_nothing_of_a_path_behind_the_camera() -> None:
    ahead_m = from_origin(straight(8.0))
    assert project_path(ahead_m, PIXEL_FROM_CAMERA, looking(np.pi), IMAGE_HW) == []
    assert project_ribbon(ahead_m, 1.85, PIXEL_FROM_CAMERA, looking(np.pi), IMAGE_HW) == []
    assert project_path(-ahead_m, PIXEL_FROM_CAMERA, looking(np.pi), IMAGE_HW) != []


def test_path_that_passes_the_camera_is_cut_before_it() -> None:
    path_m = np.array([[-20.0, 0.4], [20.0, 0.4]])
    parts = project_path(path_m, PIXEL_FROM_CAMERA, looking(0.0), IMAGE_HW)
    assert len(parts) == 1
    assert np.isfinite(parts[0]).all()
    assert parts[0][:, 1].min() == pytest.approx(
        67.5
    )  # 20 m ahead; nothing above, nothing mirrored


def test_path_that_leaves_and_returns_gives_two_parts() -> None:
    path_m = np.array([[20.0, 0.0], [20.0, 30.0], [25.0, 30.0], [25.0, 0.0]])
    assert len(project_path(path_m, PIXEL_FROM_CAMERA, looking(0.0), IMAGE_HW)) == 2


def test_ribbon_is_as_wide_as_the_car() -> None:
    path_m = np.array([[0.0, 0.0], [30.0, 0.0]])
    (outline,) = project_ribbon(path_m, 2.0, PIXEL_FROM_CAMERA, looking(0.0), IMAGE_HW)
    far = outline[np.isclose(outline[:, 1], 65.0)]  # 30 m ahead: one metre is 100 / 30 pixels
    np.testing.assert_allclose(np.sort(far[:, 0]), [80.0 - 100 / 30, 80.0 + 100 / 30])


def test_standing_still_draws_no_line() -> None:
    path_m = np.zeros((21, 2))
    assert project_path(path_m, PIXEL_FROM_CAMERA, looking(0.0), IMAGE_HW) == []
    assert project_ribbon(path_m, 2.0, PIXEL_FROM_CAMERA, looking(0.0), IMAGE_HW) == []


def test_subdividing_keeps_corners_and_bounds_steps() -> None:
    path_m = np.array([[0.0, 0.0], [1.03, 0.0], [1.03, 0.0], [1.03, 2.0]])
    fine = subdivide(path_m, 0.1)
    assert np.linalg.norm(np.diff(fine, axis=0), axis=-1).max() <= 0.1 + 1e-9
    assert np.isclose(fine, [1.03, 0.0]).all(axis=-1).sum() == 1
    np.testing.assert_allclose(fine[[0, -1]], path_m[[0, -1]])
