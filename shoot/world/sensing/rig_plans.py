"""What cars carry, before it is mounted: where sensors sit, where they look, when they fire.

Laid out as on nuScenes' and on Lyft Level 5's cars, with rounded numbers.
"""

import math
from dataclasses import dataclass
from typing import Literal

LIDAR_PERIOD_S = 0.05
DELAY_ERROR_US = 1500.0
RigName = Literal["nuscenes", "lyft"]


@dataclass(frozen=True)
class CameraPlan:
    """A camera before it was mounted.

    Attributes:
        channel: Its name.
        position_m: (x, y, z) in `ego`.
        yaw_rad: Viewing direction, left of straight ahead.
        pitch_rad: Viewing direction, up from level.
        focal_px: Focal length at the rig's image size.
        centre_px: Principal point (u, v) at that size.
        delay_s: When it fires, after the lidar's stamp: the turning beam passes it before that.
    """

    channel: str
    position_m: tuple[float, float, float]
    yaw_rad: float
    pitch_rad: float
    focal_px: float
    centre_px: tuple[float, float]
    delay_s: float


@dataclass(frozen=True)
class RigPlan:
    """A car's sensors before they were mounted.

    Attributes:
        width_px, height_px: Size of all its images.
        cameras: Its cameras.
        lidar_position_m: (x, y, z) in `ego`.
        lidar_yaw_rad: The lidar's x axis, left of straight ahead; its z axis points up.
    """

    width_px: int
    height_px: int
    cameras: tuple[CameraPlan, ...]
    lidar_position_m: tuple[float, float, float]
    lidar_yaw_rad: float

    @property
    def first_turn(self) -> int:
        """The first lidar turn, from 1, whose cameras all fire after the recording began."""
        earliest_s = min(camera.delay_s for camera in self.cameras) - DELAY_ERROR_US / 1e6
        return max(math.ceil(-earliest_s / LIDAR_PERIOD_S), 1)


def _nuscenes(
    channel: str,
    x_m: float,
    y_m: float,
    z_m: float,
    yaw_deg: float,
    focal_px: float,
    delay_s: float,
) -> CameraPlan:
    """One of six, level; the one at the back takes in more than the others."""
    yaw_rad = math.radians(yaw_deg)
    return CameraPlan(channel, (x_m, y_m, z_m), yaw_rad, 0.0, focal_px, (808.0, 490.0), delay_s)


def _lyft(
    channel: str, x_m: float, y_m: float, z_m: float, yaw_deg: float, delay_s: float
) -> CameraPlan:
    """One of six alike on a roof rack, which leans back a little."""
    yaw_rad = math.radians(yaw_deg)
    pitch_rad = math.radians(1.4) * math.cos(yaw_rad)
    return CameraPlan(channel, (x_m, y_m, z_m), yaw_rad, pitch_rad, 1110.0, (957.0, 538.0), delay_s)


NUSCENES = RigPlan(
    width_px=1600,
    height_px=900,
    cameras=(
        _nuscenes("CAM_FRONT", 1.70, 0.00, 1.50, 0.0, 1265.0, -0.035),
        _nuscenes("CAM_FRONT_RIGHT", 1.55, -0.50, 1.50, -55.0, 1265.0, -0.027),
        _nuscenes("CAM_BACK_RIGHT", 1.05, -0.50, 1.55, -110.0, 1265.0, -0.020),
        _nuscenes("CAM_BACK", 0.05, 0.00, 1.55, 180.0, 810.0, -0.010),
        _nuscenes("CAM_BACK_LEFT", 1.05, 0.50, 1.55, 110.0, 1265.0, -0.002),
        _nuscenes("CAM_FRONT_LEFT", 1.55, 0.50, 1.50, 55.0, 1265.0, -0.043),
    ),
    lidar_position_m=(0.95, 0.0, 1.84),
    lidar_yaw_rad=math.radians(-90.0),
)
# The zoomed camera looks for signals: far ahead, and up.
LYFT = RigPlan(
    width_px=1920,
    height_px=1080,
    cameras=(
        _lyft("CAM_FRONT", 1.50, -0.03, 1.66, 0.0, -0.053),
        _lyft("CAM_FRONT_RIGHT", 1.28, -0.32, 1.68, -60.0, -0.036),
        _lyft("CAM_BACK_RIGHT", 1.04, -0.32, 1.66, -120.0, -0.020),
        _lyft("CAM_BACK", 0.82, 0.00, 1.65, 180.0, -0.103),
        _lyft("CAM_BACK_LEFT", 1.04, 0.32, 1.66, 120.0, -0.086),
        _lyft("CAM_FRONT_LEFT", 1.28, 0.32, 1.68, 60.0, -0.070),
        CameraPlan(
            "CAM_FRONT_ZOOMED", (1.49, 0.04, 1.50), 0.0, math.radians(8.4), 3962.0,
            (935.0, 445.0), -0.053,
        ),
    ),
    lidar_position_m=(1.20, 0.0, 1.83),
    lidar_yaw_rad=math.radians(180.0),
)  # fmt: skip
RIG_PLANS: dict[RigName, RigPlan] = {"nuscenes": NUSCENES, "lyft": LYFT}
