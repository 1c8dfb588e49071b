"""What a driver is given at each planning: what sensors see, how the ego moves, and the world."""

import io
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from lss_core.geometry import FloatArray
from shoot.simulation.vehicle import VehicleState
from shoot.world.town.town import Town
from shoot.world.traffic.live import LiveTraffic


@dataclass(frozen=True)
class CameraView:
    """One camera's image, as a data set would hold it.

    Attributes:
        channel: nuScenes' name of the camera.
        jpeg: The image file.
        image_hw: Height and width in pixels.
        rawpixel_from_camera: [3, 3].
        egocam_from_camera: [4, 4] mounting.
        ego_from_camera: [4, 4] pose at the shutter in `ego` now: the car moved on since.
    """

    channel: str
    jpeg: bytes
    image_hw: tuple[int, int]
    rawpixel_from_camera: FloatArray
    egocam_from_camera: FloatArray
    ego_from_camera: FloatArray

    def open(self) -> Image.Image:
        """The image, not yet decoded."""
        return Image.open(io.BytesIO(self.jpeg), formats=("JPEG",))

    def pixels(self) -> NDArray[np.uint8]:
        """[H, W, 3] red, green, blue."""
        return np.asarray(self.open())


@dataclass(frozen=True)
class LidarScan:
    """One turn of the lidar.

    Attributes:
        points_lidar: [P, 5] x, y, z in metres in `lidar`, intensity 0 to 255, ring.
        ego_from_lidar: [4, 4] the lidar's pose then in `ego` now.
        age_s: How long ago.
    """

    points_lidar: NDArray[np.float32]
    ego_from_lidar: FloatArray
    age_s: float


@dataclass(frozen=True)
class Sights:
    """What the sensors see.

    Attributes:
        views: In the order in which cameras were asked for.
        scans: The newest first.
    """

    views: tuple[CameraView, ...] = ()
    scans: tuple[LidarScan, ...] = ()


@dataclass(frozen=True)
class World:
    """What no planner may see: rule driver, oracle, route gate and scores read it.

    Attributes:
        town: Where.
        traffic: Everybody, now; not to be changed.
        route_at_m: How far along `traffic.route` the ego is.
    """

    town: Town
    traffic: LiveTraffic
    route_at_m: float


@dataclass(frozen=True)
class Observation:
    """What there is to plan from.

    Attributes:
        time_s: Since the route began.
        state: Of the ego, in the town's frame.
        past_m: [P, 3] x, y in metres and heading in rad in `ego` now, every `PHYSICS_S` back from
            now, the latest first.
        sights: What the sensors see that the driver reads.
        world: What no planner may see.
    """

    time_s: float
    state: VehicleState
    past_m: NDArray[np.floating[Any]]
    sights: Sights
    world: World
