"""The ego's sensors in the loop: what cameras and lidar see of all that has happened so far."""

from dataclasses import dataclass
from functools import lru_cache

import cv2
import numpy as np

from lss_core.geometry import FloatArray, invert, rigid_from_yaw
from shoot.simulation.observation import CameraView, LidarScan, Sights
from shoot.world.looks.movers import Movers
from shoot.world.looks.paint import Paint, paint_unlit
from shoot.world.looks.scenery import ego_pose
from shoot.world.nuscenes.capture import JPEG_QUALITY, texel_m
from shoot.world.sensing.rig import Camera, make_rig
from shoot.world.sensing.rig_plans import LIDAR_PERIOD_S, RIG_PLANS, RigName
from shoot.world.sensing.sensors import CitySensors
from shoot.world.town.town import Town
from shoot.world.traffic.recording import Recording
from shoot.world.traffic.scenario import make_look


@dataclass(frozen=True)
class SensorSettings:
    """What the car carries, and what of it is read; the defaults read nothing.

    Attributes:
        rig: Whose car.
        image_scale: Size of the images as a share of the rig's.
        lidar_azimuths: Lidar firings a turn.
        cameras: Channels read, in this order.
        num_scans: Lidar turns read, 0.05 s apart; the last is now.
    """

    rig: RigName = "nuscenes"
    image_scale: float = 0.25
    lidar_azimuths: int = 1024
    cameras: tuple[str, ...] = ()
    num_scans: int = 0


@lru_cache(maxsize=1)
def _paint(town: Town, cell_m: float) -> Paint:
    return paint_unlit(town, cell_m)


class Senses:
    """Sensors, light and weather of one scene, those that a data set has of the same seed.

    Attributes:
        cameras: Those that are read, in order, as mounted.

    Args:
        town: Where.
        seed: Of the scene.
        settings: What is carried and read.
        recording: What moves; later ones are given when asked.
    """

    def __init__(
        self, town: Town, seed: int, settings: SensorSettings, recording: Recording
    ) -> None:
        self._settings = settings
        rig = make_rig(seed, settings.image_scale, settings.lidar_azimuths, RIG_PLANS[settings.rig])
        by_channel = {camera.channel: camera for camera in rig.cameras}
        self.cameras = [by_channel[channel] for channel in settings.cameras]
        paint = _paint(town, texel_m(settings.image_scale))
        self._sensors = CitySensors(town, recording, make_look(seed), rig, seed, paint)

    def look(self, recording: Recording, time_s: float) -> Sights:
        """What is seen at a time; nothing of it depends on what comes later.

        Args:
            recording: All that has happened, up to that time at least.
            time_s: When, in the recording's time.
        """
        self._sensors.recording = recording
        self._sensors.movers = Movers(recording)
        ego_from_town = invert(_town_from_ego(recording, time_s))
        return Sights(
            views=tuple(self._view(camera, time_s, ego_from_town) for camera in self.cameras),
            scans=tuple(
                self._scan(time_s, k * LIDAR_PERIOD_S, ego_from_town)
                for k in range(self._settings.num_scans)
            ),
        )

    def _view(self, camera: Camera, time_s: float, ego_from_town: FloatArray) -> CameraView:
        shutter_s = round(time_s + camera.delay_s, 6)
        picture = self._sensors.image(camera, shutter_s)
        quality = [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY]
        _, encoded = cv2.imencode(".jpg", picture[..., ::-1], quality)
        ego_from_egocam = ego_from_town @ _town_from_ego(self._sensors.recording, shutter_s)
        return CameraView(
            channel=camera.channel,
            jpeg=encoded.tobytes(),
            image_hw=(camera.height_px, camera.width_px),
            rawpixel_from_camera=camera.pixel_from_camera,
            egocam_from_camera=camera.ego_from_camera,
            ego_from_camera=ego_from_egocam @ camera.ego_from_camera,
        )

    def _scan(self, time_s: float, age_s: float, ego_from_town: FloatArray) -> LidarScan:
        turned_s = round(time_s - age_s, 6)
        recording = self._sensors.recording
        sweep = self._sensors.sweep(turned_s)
        ego_from_then = ego_from_town @ _town_from_ego(recording, turned_s)
        return LidarScan(sweep.points, ego_from_then @ self._sensors.rig.ego_from_lidar, age_s)


def _town_from_ego(recording: Recording, time_s: float) -> FloatArray:
    """[4, 4] where the ego is at a time."""
    x, y, yaw = ego_pose(recording, time_s)
    return rigid_from_yaw(np.array([x, y]), yaw)
