"""The ego car's six cameras and its lidar: where they sit, where they look, when they fire.

Laid out as on nuScenes' cars, with round numbers of our own.
"""

from dataclasses import dataclass

import numpy as np

from shoot.world.looks.meshes import Float32Array
from shoot.world.town.town import FloatArray

FULL_WIDTH_PX, FULL_HEIGHT_PX = 1600, 900
LIDAR_RINGS = 32
LIDAR_LOWEST_RAD, LIDAR_HIGHEST_RAD = np.deg2rad(-30.0), np.deg2rad(10.0)


@dataclass(frozen=True)
class CameraPlan:
    """A camera before it was mounted.

    Attributes:
        channel: nuScenes' name.
        position_m: (x, y, z) in `ego`.
        yaw_rad: Viewing direction, left of straight ahead.
        focal_px: Focal length at 1600 x 900.
        delay_s: When it fires, after the lidar's stamp: the turning beam passes it before that.
    """

    channel: str
    position_m: tuple[float, float, float]
    yaw_rad: float
    focal_px: float
    delay_s: float


CAMERA_PLANS = (
    CameraPlan("CAM_FRONT", (1.70, 0.00, 1.50), 0.0, 1265.0, -0.035),
    CameraPlan("CAM_FRONT_RIGHT", (1.55, -0.50, 1.50), np.deg2rad(-55.0), 1265.0, -0.027),
    CameraPlan("CAM_BACK_RIGHT", (1.05, -0.50, 1.55), np.deg2rad(-110.0), 1265.0, -0.020),
    CameraPlan("CAM_BACK", (0.05, 0.00, 1.55), np.deg2rad(180.0), 810.0, -0.010),
    CameraPlan("CAM_BACK_LEFT", (1.05, 0.50, 1.55), np.deg2rad(110.0), 1265.0, -0.002),
    CameraPlan("CAM_FRONT_LEFT", (1.55, 0.50, 1.50), np.deg2rad(55.0), 1265.0, -0.043),
)


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
        cameras: In nuScenes' order, clockwise from the front.
        ego_from_lidar: [4, 4] (lidar: x right, y forward, z up).
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


def make_rig(seed: int, image_scale: float, lidar_azimuths: int) -> Rig:
    """Mount the sensors with small errors: angles 0.5 deg, places 2 cm, focal lengths 1 %."""
    rng = np.random.default_rng([seed, 11])
    width, height = round(FULL_WIDTH_PX * image_scale), round(FULL_HEIGHT_PX * image_scale)
    scale_x, scale_y = width / FULL_WIDTH_PX, height / FULL_HEIGHT_PX
    cameras = []
    for plan in CAMERA_PLANS:
        focal = plan.focal_px * (1 + 0.01 * rng.uniform(-1, 1))
        centre = np.array([808.0, 490.0]) + rng.uniform(-12, 12, 2)
        # Pixel centres lie at whole numbers: images shrink about the corner at (-0.5, -0.5).
        pixel_from_camera = np.array([
            [focal * scale_x, 0.0, (centre[0] + 0.5) * scale_x - 0.5],
            [0.0, focal * scale_y, (centre[1] + 0.5) * scale_y - 0.5],
            [0.0, 0.0, 1.0],
        ])  # fmt: skip
        ahead = np.array([np.cos(plan.yaw_rad), np.sin(plan.yaw_rad), 0.0])
        right = np.array([ahead[1], -ahead[0], 0.0])
        nominal = np.stack([right, np.array([0.0, 0.0, -1.0]), ahead], axis=1)
        pose = np.eye(4)
        pose[:3, :3] = nominal @ _small_rotation(np.deg2rad(0.5) * rng.uniform(-1, 1, 3))
        pose[:3, 3] = np.asarray(plan.position_m) + 0.02 * rng.uniform(-1, 1, 3)
        cameras.append(Camera(plan.channel, width, height, pixel_from_camera, pose, plan.delay_s))
    lidar = np.eye(4)
    lidar[:3, :3] = rotation_z(-np.pi / 2) @ _small_rotation(
        np.deg2rad(0.5) * rng.uniform(-1, 1, 3)
    )
    lidar[:3, 3] = np.array([0.95, 0.0, 1.84]) + 0.02 * rng.uniform(-1, 1, 3)
    return Rig(tuple(cameras), lidar, lidar_azimuths)
