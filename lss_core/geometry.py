"""Rigid transforms as 4x4 matrices on column vectors: `a_from_c = a_from_b @ b_from_c`."""

from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation, Slerp

FloatArray = NDArray[np.float64]


def rigid_from_quaternion(translation_m: FloatArray, quaternion_wxyz: FloatArray) -> FloatArray:
    """Transform [..., 4, 4] from a translation [..., 3] and a quaternion [..., 4] (w, x, y, z).

    Raises:
        ValueError: If a quaternion is not finite or has no length.
    """
    quaternion = np.asarray(quaternion_wxyz, dtype=np.float64)
    length = np.linalg.norm(quaternion, axis=-1)
    if not np.all(np.isfinite(length)) or np.any(length < 1e-6):
        raise ValueError("A rotation quaternion must be finite and longer than 0.")
    flat = quaternion.reshape(-1, 4)
    rotation = Rotation.from_quat(flat[:, [1, 2, 3, 0]]).as_matrix()
    matrix = np.zeros((*quaternion.shape[:-1], 4, 4))
    matrix[..., :3, :3] = rotation.reshape(*quaternion.shape[:-1], 3, 3)
    matrix[..., :3, 3] = translation_m
    matrix[..., 3, 3] = 1.0
    return matrix


def quaternion_of(a_from_b: FloatArray) -> FloatArray:
    """Quaternion [..., 4] (w, x, y, z), w >= 0, of the rotation of rigid transforms [..., 4, 4]."""
    rotation = Rotation.from_matrix(a_from_b[..., :3, :3].reshape(-1, 3, 3))
    quaternion: FloatArray = rotation.as_quat()[:, [3, 0, 1, 2]]
    quaternion *= np.where(quaternion[:, :1] < 0.0, -1.0, 1.0)
    return quaternion.reshape(*a_from_b.shape[:-2], 4)


def rigid_from_yaw(xy_m: FloatArray, yaw_rad: FloatArray | float) -> FloatArray:
    """Transform [..., 4, 4] that turns by `yaw_rad` [...] about z and moves by `xy_m` [..., 2]."""
    yaw = np.asarray(yaw_rad, dtype=np.float64)
    matrix = np.zeros((*yaw.shape, 4, 4))
    matrix[..., 0, 0] = matrix[..., 1, 1] = np.cos(yaw)
    matrix[..., 1, 0] = np.sin(yaw)
    matrix[..., 0, 1] = -np.sin(yaw)
    matrix[..., 2, 2] = matrix[..., 3, 3] = 1.0
    matrix[..., :2, 3] = xy_m
    return matrix


def invert(a_from_b: FloatArray) -> FloatArray:
    """`b_from_a` of a rigid `a_from_b` [..., 4, 4]."""
    b_from_a = np.zeros_like(a_from_b)
    rotation_t = np.swapaxes(a_from_b[..., :3, :3], -1, -2)
    b_from_a[..., :3, :3] = rotation_t
    b_from_a[..., :3, 3] = -(rotation_t @ a_from_b[..., :3, 3:])[..., 0]
    b_from_a[..., 3, 3] = 1.0
    return b_from_a


def apply(a_from_b: FloatArray, points_b: FloatArray) -> FloatArray:
    """The points [..., 3] of frame b, in frame a."""
    points_a: FloatArray = points_b @ a_from_b[:3, :3].T + a_from_b[:3, 3]
    return points_a


def direction_of(vectors: NDArray[np.floating[Any]]) -> FloatArray:
    """Angle [...] of vectors [..., 2] from the x axis, counter-clockwise, in (-pi, pi].

    To the same bits wherever they lie: numpy's code for AVX-512 takes columns of a larger array one
    way or another by their addresses, with other last digits, but whole arrays always one way.
    """
    x, y = (np.ascontiguousarray(vectors[..., axis], dtype=np.float64) for axis in (0, 1))
    direction: FloatArray = np.asarray(np.arctan2(y, x)).reshape(vectors.shape[:-1])
    return direction


def yaw_of(a_from_b: FloatArray) -> FloatArray:
    """Heading of b's x axis in a's ground plane, in (-pi, pi]."""
    return direction_of(a_from_b[..., :2, 0])


def wrap_angle(angle_rad: FloatArray | float) -> FloatArray:
    """The same direction in [-pi, pi)."""
    wrapped: FloatArray = np.asarray((np.asarray(angle_rad) + np.pi) % (2.0 * np.pi) - np.pi)
    return wrapped


def interpolate_poses(
    times_s: FloatArray,
    global_from_ego: FloatArray,
    query_s: FloatArray,
) -> FloatArray:
    """Poses at other times: linear in position, along the shortest turn in rotation.

    Args:
        times_s: [P], strictly increasing.
        global_from_ego: [P, 4, 4] pose at each time.
        query_s: [Q] times within the first and last of `times_s`.

    Returns:
        [Q, 4, 4].

    Raises:
        ValueError: If times do not increase or a query lies outside them.
    """
    if np.any(np.diff(times_s) <= 0.0):
        raise ValueError("Pose times must increase.")
    if len(query_s) and (query_s.min() < times_s[0] or query_s.max() > times_s[-1]):
        raise ValueError("Poses are asked for outside of the time they were recorded in.")
    result = np.tile(np.eye(4), (len(query_s), 1, 1))
    if len(times_s) == 1:
        result[:] = global_from_ego[0]
        return result
    rotations = Rotation.from_matrix(global_from_ego[:, :3, :3])
    result[:, :3, :3] = Slerp(times_s, rotations)(query_s).as_matrix()
    for axis in range(3):
        result[:, axis, 3] = np.interp(query_s, times_s, global_from_ego[:, axis, 3])
    return result
