"""Rigid transforms: hand-worked, off-axis, position and heading together."""

import math

import numpy as np
import pytest
from pyquaternion import Quaternion

from lss_core.geometry import (
    apply,
    direction_of,
    interpolate_poses,
    invert,
    rigid_from_quaternion,
    rigid_from_yaw,
    wrap_angle,
    yaw_of,
)


def test_a_car_that_stands_turned_sees_points_where_it_should() -> None:
    # The car stands at (10, 5), looks to +y: its own (2 ahead, 1 left) is global (10 - 1, 5 + 2).
    global_from_ego = rigid_from_yaw(np.array([10.0, 5.0]), np.array(math.pi / 2))
    points = apply(global_from_ego, np.array([[2.0, 1.0, 0.5]]))
    np.testing.assert_allclose(points, [[9.0, 7.0, 0.5]], atol=1e-12)
    assert yaw_of(global_from_ego) == pytest.approx(math.pi / 2)
    back = apply(invert(global_from_ego), points)
    np.testing.assert_allclose(back, [[2.0, 1.0, 0.5]], atol=1e-12)


def test_quaternions_are_w_first_and_turn_as_the_devkits_do() -> None:
    quaternion = np.array([[0.9, 0.1, -0.3, 0.2], [1.0, 0.0, 0.0, 0.0]])  # of any length
    matrices = rigid_from_quaternion(np.array([[1.0, 2.0, 3.0], [0.0, 0.0, 0.0]]), quaternion)
    np.testing.assert_allclose(
        matrices[0, :3, :3], Quaternion(quaternion[0]).rotation_matrix, atol=1e-12
    )
    np.testing.assert_allclose(matrices[0, :3, 3], [1.0, 2.0, 3.0])
    np.testing.assert_allclose(matrices[1], np.eye(4))


@pytest.mark.parametrize("bad", [[0.0, 0.0, 0.0, 0.0], [math.nan, 0.0, 0.0, 1.0]])
def test_quaternions_that_are_none_are_refused(bad: list[float]) -> None:
    with pytest.raises(ValueError, match="quaternion"):
        rigid_from_quaternion(np.zeros(3), np.array(bad))


def test_inverse_and_composition_of_a_stack() -> None:
    rng = np.random.default_rng(0)
    poses = rigid_from_quaternion(rng.normal(size=(5, 3)), rng.normal(size=(5, 4)))
    np.testing.assert_allclose(invert(poses) @ poses, np.tile(np.eye(4), (5, 1, 1)), atol=1e-12)
    np.testing.assert_allclose(invert(poses), np.linalg.inv(poses), atol=1e-12)


@pytest.mark.parametrize(
    ("angle_rad", "wrapped_rad"),
    [(3.5, 3.5 - 2 * math.pi), (-3.5, 2 * math.pi - 3.5), (math.pi, -math.pi), (0.3, 0.3)],
)
def test_wrapping(angle_rad: float, wrapped_rad: float) -> None:
    assert wrap_angle(np.array(angle_rad)) == pytest.approx(wrapped_rad)


def test_interpolation_of_position_and_heading_at_uneven_times() -> None:
    times_s = np.array([0.0, 1.0, 3.0])
    xy_m = np.array([[0.0, 0.0], [4.0, 2.0], [4.0, 8.0]])
    # From 170 to -170 degrees the short way is over 180.
    yaw_rad = np.deg2rad([150.0, 170.0, -170.0])
    poses = interpolate_poses(times_s, rigid_from_yaw(xy_m, yaw_rad), np.array([0.25, 2.0, 3.0]))
    np.testing.assert_allclose(poses[:, :2, 3], [[1.0, 0.5], [4.0, 5.0], [4.0, 8.0]], atol=1e-12)
    np.testing.assert_allclose(
        wrap_angle(yaw_of(poses) - np.deg2rad([155.0, 180.0, -170.0])), 0.0, atol=1e-9
    )


def test_one_pose_is_the_pose_at_its_time() -> None:
    pose = rigid_from_yaw(np.array([[3.0, 4.0]]), np.array([0.4]))
    np.testing.assert_array_equal(interpolate_poses(np.array([2.0]), pose, np.array([2.0])), pose)


@pytest.mark.parametrize(
    ("times_s", "query_s", "word"),
    [
        ([0.0, 0.0, 1.0], [0.5], "increase"),
        ([0.0, 1.0, 2.0], [2.1], "outside"),
        ([0.0, 1.0, 2.0], [-0.1], "outside"),
    ],
)
def test_poses_are_never_made_up(times_s: list[float], query_s: list[float], word: str) -> None:
    poses = np.tile(np.eye(4), (3, 1, 1))
    with pytest.raises(ValueError, match=word):
        interpolate_poses(np.array(times_s), poses, np.array(query_s))


def test_directions_have_the_same_bits_wherever_the_vectors_lie() -> None:
    # Sizes differ, so that memory is handed out at many places.
    rng = np.random.default_rng(0)
    for _ in range(300):
        matrices = rng.normal(size=(int(rng.integers(50, 500)), 4, 4))
        copies = matrices.copy()
        np.testing.assert_array_equal(yaw_of(matrices), yaw_of(copies))
        np.testing.assert_array_equal(
            direction_of(matrices[:, 0, :2]), direction_of(copies[:, 0, :2])
        )


def test_directions_by_hand() -> None:
    vectors = np.array([[[1.0, 0.0], [0.0, 2.0]], [[-3.0, 0.0], [-1.0, -1.0]]])
    expected = np.pi * np.array([[0.0, 0.5], [1.0, -0.75]])
    np.testing.assert_allclose(direction_of(vectors), expected)
    assert direction_of(vectors[0, 1]) == np.pi / 2
