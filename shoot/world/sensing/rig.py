"""The ego car's cameras and its lidar as mounted in one scene: a plan and small errors."""

from dataclasses import dataclass

import numpy as np

from shoot.world.looks.meshes import Float32Array
from shoot.world.sensing.rig_plans import NUSCENES, RigPlan
from shoot.world.town.town import FloatArray

LIDAR_RINGS = 32
LIDAR_LOWEST_RAD, LIDAR_HIGHEST_RAD = np.deg2rad(-30.0), np.deg2rad(10.0)


@dataclass(frozen=True)
class Camera:
    """A mounted camera.

    Attributes:
        channel: nuScenes' name.
        width_px, height_px: Image size; pixel (0, 0) has its centre at (0, 0).
        pixel_from_camera: [3, 3].
        ego_from_camera: [4, 4] (camera: x right, y down, z forward).
        delay_s: When it fires, after the lidar's stamp (negative).
    """

    channel: str
    width_px: int
    height_px: int
    pixel_from_camera: FloatArray
    ego_from_camera: FloatArray
    delay_s: float

    def rays_camera(self) -> Float32Array:
        """Unit view rays [height * width, 3] through the pixels' centres, row by row."""
        u, v = np.meshgrid(np.arange(self.width_px), np.arange(self.height_px))
        k = self.pixel_from_camera
        rays = np.stack(
            [(u - k[0, 2]) / k[0, 0], (v - k[1, 2]) / k[1, 1], np.ones(u.shape)], axis=-1
        )
        rays /= np.linalg.norm(rays, axis=-1, keepdims=True)
        return np.asarray(rays.reshape(-1, 3), np.float32)


@dataclass(frozen=True)
class Rig:
    """All sensors of one scene's car.

    Attributes:
        cameras: In the plan's order.
        ego_from_lidar: [4, 4] (lidar: z up; nuScenes: x right, y forward).
        lidar_azimuths: Firings a turn.
    """

    cameras: tuple[Camera, ...]
    ego_from_lidar: FloatArray
    lidar_azimuths: int

    def rays_lidar(self) -> tuple[Float32Array, Float32Array]:
        """Unit beams [A * 32, 3] in `lidar` and their ring numbers [A * 32], ring 0 lowest."""
        azimuth = -np.arange(self.lidar_azimuths) * 2 * np.pi / self.lidar_azimuths
        height = np.linspace(LIDAR_LOWEST_RAD, LIDAR_HIGHEST_RAD, LIDAR_RINGS)
        ring = np.tile(np.arange(LIDAR_RINGS, dtype=np.float32), self.lidar_azimuths)
        a, e = np.repeat(azimuth, LIDAR_RINGS), np.tile(height, self.lidar_azimuths)
        beams = np.stack([np.cos(e) * np.cos(a), np.cos(e) * np.sin(a), np.sin(e)], axis=1)
        return np.asarray(beams, np.float32), ring


def rotation_z(yaw_rad: float) -> FloatArray:
    """Turn [3, 3] by `yaw_rad` about z."""
    cos, sin = np.cos(yaw_rad), np.sin(yaw_rad)
    return np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])


def _small_rotation(angles_rad: FloatArray) -> FloatArray:
    """Turn [3, 3] about x, then y, then z."""
    (cx, cy, cz), (sx, sy, sz) = np.cos(angles_rad), np.sin(angles_rad)
    about_x = np.array([[1, 0, 0], [0, cx, -sx], [0, sx, cx]])
    about_y = np.array([[cy, 0, sy], [0, 1, 0], [-sy, 0, cy]])
    about_z = np.array([[cz, -sz, 0], [sz, cz, 0], [0, 0, 1]])
    return np.asarray(about_z @ about_y @ about_x, np.float64)


def quaternion_wxyz(rotation: FloatArray) -> list[float]:
    """Quaternion (w, x, y, z), w >= 0, of a rotation [3, 3]."""
    # The largest of the four components is found first: dividing by it is always safe.
    r = rotation
    squares = np.array([
        1 + r[0, 0] + r[1, 1] + r[2, 2],
        1 + r[0, 0] - r[1, 1] - r[2, 2],
        1 - r[0, 0] + r[1, 1] - r[2, 2],
        1 - r[0, 0] - r[1, 1] + r[2, 2],
    ])  # fmt: skip
    products = np.array([
        [squares[0], r[2, 1] - r[1, 2], r[0, 2] - r[2, 0], r[1, 0] - r[0, 1]],
        [r[2, 1] - r[1, 2], squares[1], r[1, 0] + r[0, 1], r[0, 2] + r[2, 0]],
        [r[0, 2] - r[2, 0], r[1, 0] + r[0, 1], squares[2], r[2, 1] + r[1, 2]],
        [r[1, 0] - r[0, 1], r[0, 2] + r[2, 0], r[2, 1] + r[1, 2], squares[3]],
    ])  # fmt: skip
    quaternion = products[int(np.argmax(squares))]
    quaternion = quaternion / np.linalg.norm(quaternion)
    if quaternion[0] < 0:
        quaternion = -quaternion
    return [float(value) for value in quaternion]


def make_rig(seed: int, image_scale: float, lidar_azimuths: int, plan: RigPlan = NUSCENES) -> Rig:
    """Mount the sensors with small errors: angles 0.5 deg, places 2 cm, focal lengths 1 %."""
    rng = np.random.default_rng([seed, 11])
    width, height = round(plan.width_px * image_scale), round(plan.height_px * image_scale)
    scale_x, scale_y = width / plan.width_px, height / plan.height_px
    cameras = []
    for camera in plan.cameras:
        focal = camera.focal_px * (1 + 0.01 * rng.uniform(-1, 1))
        centre = np.asarray(camera.centre_px) + rng.uniform(-12, 12, 2)
        # Pixel centres lie at whole numbers: images shrink about the corner at (-0.5, -0.5).
        pixel_from_camera = np.array([
            [focal * scale_x, 0.0, (centre[0] + 0.5) * scale_x - 0.5],
            [0.0, focal * scale_y, (centre[1] + 0.5) * scale_y - 0.5],
            [0.0, 0.0, 1.0],
        ])  # fmt: skip
        pose = np.eye(4)
        errors = _small_rotation(np.deg2rad(0.5) * rng.uniform(-1, 1, 3))
        pose[:3, :3] = _ego_from_camera(camera.yaw_rad, camera.pitch_rad) @ errors
        pose[:3, 3] = np.asarray(camera.position_m) + 0.02 * rng.uniform(-1, 1, 3)
        cameras.append(
            Camera(camera.channel, width, height, pixel_from_camera, pose, camera.delay_s)
        )
    lidar = np.eye(4)
    lidar[:3, :3] = rotation_z(plan.lidar_yaw_rad) @ _small_rotation(
        np.deg2rad(0.5) * rng.uniform(-1, 1, 3)
    )
    lidar[:3, 3] = np.asarray(plan.lidar_position_m) + 0.02 * rng.uniform(-1, 1, 3)
    return Rig(tuple(cameras), lidar, lidar_azimuths)


def _ego_from_camera(yaw_rad: float, pitch_rad: float) -> FloatArray:
    """Axes [3, 3] of a camera that looks to the left by `yaw_rad` and up by `pitch_rad`."""
    level = np.array([np.cos(yaw_rad), np.sin(yaw_rad), 0.0])
    right, up = np.array([level[1], -level[0], 0.0]), np.array([0.0, 0.0, 1.0])
    ahead = np.cos(pitch_rad) * level + np.sin(pitch_rad) * up
    down = np.sin(pitch_rad) * level - np.cos(pitch_rad) * up
    return np.stack([right, down, ahead], axis=1)
