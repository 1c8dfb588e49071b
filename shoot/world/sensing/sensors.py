"""Cameras and lidar of the synthetic city, by casting rays (Embree) and shading what they meet.

The images hold only what a camera would see: nothing in them depends on the ego's route or speed.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from shoot.world.looks.light import Light, light_of
from shoot.world.looks.meshes import Float32Array, Int32Array
from shoot.world.looks.movers import Movers
from shoot.world.looks.paint import ImageArray, Paint
from shoot.world.looks.scenery import Scenery, Solid, ego_pose, join_lamps
from shoot.world.sensing import film
from shoot.world.sensing.casting import cast, objects_met
from shoot.world.sensing.glow import add_glow
from shoot.world.sensing.rig import Camera, Rig, rotation_z
from shoot.world.sensing.shading import Shading
from shoot.world.sensing.view import View, in_sight
from shoot.world.town.town import FloatArray, Town
from shoot.world.traffic.recording import Look, Recording

LIDAR_REACH_M = 90.0


@dataclass(frozen=True)
class Sweep:
    """One turn of the lidar.

    Attributes:
        points: [P, 5] x, y, z in `lidar` in metres, intensity 0 to 255, ring.
        object_ids: [P] parked car i is i, agent k is the number of parked cars + k, else -1.
    """

    points: Float32Array
    object_ids: Int32Array


class CitySensors:
    """All sensors of one scene.

    Args:
        town: What stands.
        recording: What moves.
        look: Light and weather.
        rig: The car's sensors.
        seed: Of the noise; images and sweeps depend on it and their time only.
        paint: The town's painted ground.
    """

    def __init__(
        self,
        town: Town,
        recording: Recording,
        look: Look,
        rig: Rig,
        seed: int,
        paint: Paint,
    ) -> None:
        self.town = town
        self.recording = recording
        self.rig = rig
        self.light: Light = light_of(look)
        self._seed = seed
        self._paint = paint
        self.movers = Movers(recording)
        self._scenery = Scenery(town, self.light)
        self._standing: Solid = self._scenery.solid
        self._shading = Shading(town, self.light, paint, self._standing)
        self._rays = {camera.channel: camera.rays_camera().T.copy() for camera in rig.cameras}
        self._beams, self._rings = rig.rays_lidar()
        self._moving_at_s = float("nan")
        self._moving = self._standing
        self._grain = film.grain_tile(np.random.default_rng([seed, 6]))

    def image(self, camera: Camera, time_s: float) -> ImageArray:
        """Photograph the city.

        Args:
            camera: One of the rig's.
            time_s: When, in the recording's time.

        Returns:
            [H, W, 3] red, green, blue.
        """
        x, y, yaw = ego_pose(self.recording, time_s)
        turn = rotation_z(yaw)
        ego_xy_m = np.array([x, y])
        eye_m = turn @ camera.ego_from_camera[:3, 3] + np.array([x, y, 0.0])
        view = View(camera, eye_m, turn @ camera.ego_from_camera[:3, :3], ego_xy_m, yaw)
        rays = view.town_from_camera.astype(np.float32) @ self._rays[camera.channel]
        agents, window = in_sight(self.movers.at(time_s), view, self.light)
        moving = self.movers.solid(agents, self.light, len(self.town.parked_cars))
        state = self._signal_state(time_s)
        self._scenery.set_signals(state)

        hits = cast(eye_m, np.ascontiguousarray(rays.T), self._standing, moving, window)
        linear = self._shading.light_back(view, rays, hits, moving)
        picture = linear.reshape(3, camera.height_px, camera.width_px)
        lamps = join_lamps(self._scenery.lamps(state), self.movers.lamps(agents, self.light))
        add_glow(picture, lamps, (self._standing, moving), view, self.light)
        number = round(time_s * 1e6)
        rng = np.random.default_rng([self._seed, number, _channel_number(camera.channel)])
        return film.develop(picture, self.light, self._grain, rng)

    def sweep(self, time_s: float) -> Sweep:
        """Turn the lidar once, as if in an instant.

        Each turn's firings start at an angle of their own, as nothing locks them to the car, so
        that several turns together see between the beams of one.
        """
        x, y, yaw = ego_pose(self.recording, time_s)
        turn = rotation_z(yaw)
        lidar_m = turn @ self.rig.ego_from_lidar[:3, 3] + np.array([x, y, 0.0])
        town_from_lidar = turn @ self.rig.ego_from_lidar[:3, :3]
        rng = np.random.default_rng([self._seed, round(time_s * 1e6), 99])
        phase_rad = rng.random() * 2.0 * np.pi / self.rig.lidar_azimuths
        beams_lidar = self._beams @ rotation_z(phase_rad).T.astype(np.float32)
        beams = beams_lidar @ town_from_lidar.T.astype(np.float32)
        moving = self._moving_near(lidar_m, time_s)
        hits = cast(lidar_m, beams, self._standing, moving)
        loss = 0.03 + 0.12 * self.light.wetness
        kept = (hits.distance_m < LIDAR_REACH_M) & (rng.random(len(beams)) > loss)
        # A flat beam on the road returns next to nothing.
        kept &= ~hits.is_ground | (hits.distance_m < 45.0)
        distance = hits.distance_m + rng.normal(0.0, 0.015, len(beams)).astype(np.float32)
        # Of what meets nothing, which is not kept, too.
        ground_m = lidar_m[:2] + beams[:, :2] * np.minimum(hits.distance_m, LIDAR_REACH_M)[:, None]
        albedo = self._paint.albedo(ground_m)
        for faces, solid in ((hits.standing, self._standing), (hits.moving, moving)):
            met = np.flatnonzero(faces >= 0)
            albedo[met] = solid.mesh.rgb[faces[met]].mean(axis=1)
        intensity = np.clip(albedo * 180.0 + rng.normal(0, 3, len(beams)), 0, 255)
        points = np.column_stack(
            [beams_lidar * distance[:, None], np.round(intensity), self._rings]
        )
        objects = objects_met(hits, self._standing, moving)
        return Sweep(np.asarray(points[kept], np.float32), objects[kept])

    def visible_share(
        self, points_m: FloatArray, time_s: float, object_ids: Int32Array
    ) -> FloatArray:
        """Share of each object's points that can be seen from the ego's roof.

        Args:
            points_m: [K, S, 3] points inside each object, in the town's frame.
            time_s: When.
            object_ids: [K] numbers as in `Sweep`.

        Returns:
            [K] shares from 0 to 1.
        """
        count, samples = points_m.shape[:2]
        if count == 0:
            return np.zeros(0)
        x, y, yaw = ego_pose(self.recording, time_s)
        eye_m = rotation_z(yaw) @ np.array([1.0, 0.0, 1.6]) + np.array([x, y, 0.0])
        away = points_m.reshape(-1, 3) - eye_m
        distance = np.linalg.norm(away, axis=1)
        rays = np.asarray(away / distance[:, None], np.float32)
        moving = self._moving_near(eye_m, time_s)
        hits = cast(eye_m, rays, self._standing, moving)
        met = objects_met(hits, self._standing, moving)
        seen = (met == np.repeat(object_ids, samples)) | (hits.distance_m > distance)
        return np.asarray(seen.reshape(count, samples).mean(axis=1), np.float64)

    def _moving_near(self, eye_m: FloatArray, time_s: float) -> Solid:
        """What moves near the ego, without shadows; kept, as it is asked for twice a keyframe."""
        if self._moving_at_s == time_s:
            return self._moving
        moment = self.movers.at(time_s).within(eye_m, LIDAR_REACH_M + 10.0)
        num_parked = len(self.town.parked_cars)
        self._moving = self.movers.solid(moment, self.light, num_parked, with_shadows=False)
        self._moving_at_s = time_s
        return self._moving

    def _signal_state(self, time_s: float) -> NDArray[np.int64]:
        last = len(self.recording.signal_state) - 1
        step = min(max(round(time_s / self.recording.dt_s), 0), last)
        return np.asarray(self.recording.signal_state[step])


def _channel_number(channel: str) -> int:
    return sum(ord(letter) * (place + 1) for place, letter in enumerate(channel))
