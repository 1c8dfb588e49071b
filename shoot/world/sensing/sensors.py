"""Cameras and lidar of the synthetic city, by casting rays (Embree) and shading what they meet.

The images hold only what a camera would see: nothing in them depends on the ego's route or speed.
"""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from shoot.world.looks.facades import Facades
from shoot.world.looks.ground import light_ground
from shoot.world.looks.light import Light, light_of
from shoot.world.looks.meshes import FACADE, GLASS, Float32Array, Int32Array
from shoot.world.looks.movers import Moment, Movers
from shoot.world.looks.paint import ImageArray, Paint
from shoot.world.looks.scenery import Lamps, Scenery, Solid, ego_pose, join_lamps
from shoot.world.sensing import film
from shoot.world.sensing.casting import SIGHT_M, Hits, cast, objects_met, trace
from shoot.world.sensing.rig import Camera, Rig, rotation_z
from shoot.world.town.town import FloatArray, Town
from shoot.world.traffic.recording import AGENT_SIGHT_M, Look, Recording

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


@dataclass(frozen=True)
class _View:
    """One camera at one instant, in the town's frame.

    Attributes:
        camera: The camera.
        eye_m: [3] its optical centre.
        town_from_camera: [3, 3] its directions.
        ego_xy_m, ego_yaw_rad: The car then.
    """

    camera: Camera
    eye_m: FloatArray
    town_from_camera: FloatArray
    ego_xy_m: FloatArray
    ego_yaw_rad: float

    def project(self, points_m: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Pixel coordinates u, v and depth of points [P, 3]; only depths above 0 lie ahead."""
        seen = (points_m - self.eye_m) @ self.town_from_camera
        depth = np.maximum(seen[:, 2], 1e-3)
        k = self.camera.pixel_from_camera
        return (
            k[0, 0] * seen[:, 0] / depth + k[0, 2],
            k[1, 1] * seen[:, 1] / depth + k[1, 2],
            seen[:, 2],
        )


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
        self._ground = light_ground(paint, town, self.light)
        self.movers = Movers(recording)
        self._scenery = Scenery(town, self.light)
        self._standing: Solid = self._scenery.solid
        self._facades = Facades(self._standing, town)
        self._rays = {camera.channel: camera.rays_camera().T.copy() for camera in rig.cameras}
        self._beams, self._rings = rig.rays_lidar()
        self._moving_at_s = float("nan")
        self._moving = self._standing
        self._clouds = _smooth_noise(np.random.default_rng([town.seed, 5]))
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
        view = _View(camera, eye_m, turn @ camera.ego_from_camera[:3, :3], ego_xy_m, yaw)
        rays = view.town_from_camera.astype(np.float32) @ self._rays[camera.channel]
        in_sight, window = self._in_sight(self.movers.at(time_s), view)
        moving = self.movers.solid(in_sight, self.light, len(self.town.parked_cars))
        state = self._signal_state(time_s)
        self._scenery.set_signals(state)

        hits = cast(eye_m, np.ascontiguousarray(rays.T), self._standing, moving, window)
        linear = self._shade(view, rays, hits, moving)
        picture = linear.reshape(3, camera.height_px, camera.width_px)
        lamps = join_lamps(self._scenery.lamps(state), self.movers.lamps(in_sight, self.light))
        self._add_glow(picture, lamps, moving, view)
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

    def _in_sight(self, moment: Moment, view: _View) -> tuple[Moment, Int32Array]:
        """Agents that may be in the picture, and the pixels they and their shadows may cover."""
        camera = view.camera
        mask = np.zeros((camera.height_px, camera.width_px), bool)
        moment = moment.within(view.eye_m, AGENT_SIGHT_M)
        if len(moment.index) == 0:
            return moment, np.zeros(0, np.int32)
        sun = self.light.sun_direction
        cast_m = 0.0 if self.light.shadow >= 0.9 else 0.8 / max(float(sun[2]), 0.25)
        places, sizes = moment.xy_m, moment.size_m
        radius = np.hypot(sizes[:, 0], sizes[:, 1]) / 2 + 0.2
        square = np.array([[-1.0, -1.0], [-1.0, 1.0], [1.0, -1.0], [1.0, 1.0]])
        corners = np.zeros((len(sizes), 12, 3))
        corners[..., :2] = (places[:, None] + radius[:, None, None] * square)[:, [0, 1, 2, 3] * 3]
        corners[:, 4:8, 2] = sizes[:, 2:]
        corners[:, 8:, :2] -= (cast_m * sizes[:, 2:] * sun[:2])[:, None]
        seen = (corners - view.eye_m) @ view.town_from_camera
        k = camera.pixel_from_camera
        depth = np.maximum(seen[..., 2], 0.3)
        u = k[0, 0] * seen[..., 0] / depth + k[0, 2]
        v = k[1, 1] * seen[..., 1] / depth + k[1, 2]
        left, right = u.min(axis=1) - 1, u.max(axis=1) + 3
        top, bottom = v.min(axis=1) - 1, v.max(axis=1) + 3
        # What reaches behind the image plane has no bounds in it, but still a side it is on.
        cut = np.any(seen[..., 2] < 0.3, axis=1)
        side = np.sign(seen[..., 0])
        left[cut & ~np.all(side > 0, axis=1)] = 0
        right[cut & ~np.all(side < 0, axis=1)] = camera.width_px
        top[cut], bottom[cut] = 0, camera.height_px
        near = ~np.all(seen[..., 2] < 0.1, axis=1)
        near &= (left < camera.width_px) & (right > 0) & (top < camera.height_px) & (bottom > 0)
        for i in np.flatnonzero(near):
            rows = slice(max(int(top[i]), 0), int(bottom[i]))
            mask[rows, max(int(left[i]), 0) : int(right[i])] = True
        return moment.select(near), np.flatnonzero(mask).astype(np.int32)

    def _shade(self, view: _View, rays: Float32Array, hits: Hits, moving: Solid) -> Float32Array:
        """Linear light [3, P] that comes back along rays [3, P]."""
        # Colours are kept as three planes: numpy is several times faster on them than on triples.
        light, eye = self.light, view.eye_m.astype(np.float32)
        pixel_rad = np.float32(1.0 / view.camera.pixel_from_camera[0, 0])
        rgb = np.zeros(rays.shape, np.float32)
        albedo = np.zeros(rays.shape, np.float32) if light.headlamps > 0 else None

        ground = np.flatnonzero(hits.is_ground)
        distance, beams = hits.distance_m[ground], rays[:, ground]
        places = eye[:2, None] + beams[:2] * distance
        colour = self._ground.colours(places, beams, distance * pixel_rad)
        if light.wetness > 0:
            colour *= np.float32(1 - 0.42 * light.wetness)
        full = light.ambient_rgb + np.float32(light.sun_direction[2]) * light.sun_rgb
        shone = colour * full[:, None]
        shone *= hits.shade[ground]
        if light.wetness > 0:
            steep = 1 + beams[2]
            mirror = np.float32(0.04) + np.float32(0.3) * steep * steep * steep * steep
            shone += np.float32(0.8 * light.wetness) * light.horizon_rgb[:, None] * mirror
        rgb[:, ground] = shone
        if albedo is not None:
            albedo[:, ground] = colour

        for faces, solid in ((hits.standing, self._standing), (hits.moving, moving)):
            met = np.flatnonzero(faces >= 0)
            face = faces[met]
            shone = np.take(solid.lit_rgb, face, axis=1)
            if albedo is not None:
                albedo[:, met] = np.take(solid.albedo_rgb, face, axis=1)
            material = solid.mesh.material[face]
            glass = np.flatnonzero(material == GLASS)
            if len(glass):
                # Panes mirror a little of the sky.
                tilt = np.clip(solid.normals[face[glass], 2], 0, 1)
                shone[:, glass] += light.horizon_rgb[:, None] * (
                    np.float32(0.06) + np.float32(0.3) * tilt
                )
            wall = np.flatnonzero(material == FACADE)
            if len(wall):
                where = met[wall]
                away = hits.distance_m[where]
                points = eye[:, None] + rays[:, where] * away
                shone[:, wall] = self._facades.colours(
                    points, face[wall], shone[:, wall], away * pixel_rad, light
                )
            rgb[:, met] = shone

        sky = np.flatnonzero(hits.distance_m >= SIGHT_M)
        if albedo is not None:
            rgb += albedo * self._lamp_light(view, rays, hits.distance_m)
        clear = np.exp(hits.distance_m * np.float32(-1 / light.haze_m))
        rgb -= light.horizon_rgb[:, None]
        rgb *= clear
        rgb += light.horizon_rgb[:, None]
        rgb[:, sky] = self._sky(rays[:, sky])
        return rgb

    def _lamp_light(
        self, view: _View, rays: Float32Array, distance_m: Float32Array
    ) -> Float32Array:
        """Light of street lamps and of the ego's headlamps where the rays end, [P]."""
        reach = np.minimum(distance_m, np.float32(200.0))
        x, y, z = view.eye_m.astype(np.float32)[:, None] + rays * reach
        total = self._ground.glow(x, y)
        total *= np.exp(np.minimum((4 - z) / 3, 0))
        cos, sin = np.float32(np.cos(view.ego_yaw_rad)), np.float32(np.sin(view.ego_yaw_rad))
        dx, dy = x - np.float32(view.ego_xy_m[0]), y - np.float32(view.ego_xy_m[1])
        ahead, left = cos * dx + sin * dy - np.float32(2.6), cos * dy - sin * dx
        forward = np.maximum(ahead, 0)
        spread = left / (np.float32(1.2) + np.float32(0.42) * forward)
        rise = np.maximum(z - np.float32(0.7) - np.float32(0.02) * forward, 0)
        beam = np.exp(-(spread * spread) - rise / np.float32(0.9))
        beam /= 1 + np.square(forward / np.float32(17.0))
        beam *= ahead > 0
        return np.asarray(total + np.float32(0.75 * self.light.headlamps) * beam, np.float32)

    def _sky(self, rays: Float32Array) -> Float32Array:
        """Colours [3, P] of the sky, with clouds."""
        light = self.light
        height = np.clip(rays[2], 0, 1)
        blend = 1 - np.exp(np.float32(-3.2) * height)
        colour = (
            light.horizon_rgb[:, None] + (light.zenith_rgb - light.horizon_rgb)[:, None] * blend
        )
        if light.cloudiness > 0:
            scale = np.float32(60.0) / (height + np.float32(0.12))
            size = len(self._clouds)
            column = (rays[0] * scale).astype(np.int32) % size
            row = (rays[1] * scale).astype(np.int32) % size
            share = (
                self._clouds[row, column] * np.minimum(height * 6, 1) * np.float32(light.cloudiness)
            )
            bright = light.ambient_rgb + np.float32(0.6) * light.sun_rgb
            colour += share * (bright[:, None] - colour)
        return np.asarray(colour, np.float32)

    def _add_glow(self, picture: Float32Array, lamps: Lamps, moving: Solid, view: _View) -> None:
        """Paint the glow of lit lamps that face the camera and that nothing hides."""
        if len(lamps.points_m) == 0:
            return
        camera = view.camera
        away = lamps.points_m - view.eye_m
        distance = np.linalg.norm(away, axis=1)
        u, v, depth = view.project(lamps.points_m)
        towards = -np.sum(lamps.facing * away, axis=1) / np.maximum(distance, 1e-3)
        cosine = np.where(np.any(lamps.facing != 0, axis=1), towards, 1.0)
        inside = (u > -8) & (u < camera.width_px + 8) & (v > -8) & (v < camera.height_px + 8)
        chosen = np.flatnonzero((depth > 0.5) & (distance < 160.0) & (cosine > 0.1) & inside)
        if len(chosen) == 0:
            return
        rays = np.asarray(away[chosen] / distance[chosen, None], np.float32)
        reach = np.asarray(distance[chosen] - 0.03, np.float32)
        free = np.ones(len(chosen), bool)
        for solid in (self._standing, moving):
            free &= trace(solid, view.eye_m, rays, reach)[0] < 0
        haze = np.exp(-distance / self.light.haze_m)
        focal_px, gain = camera.pixel_from_camera[0, 0], self.light.lamp_gain
        for lamp in chosen[free]:
            size_px = focal_px * lamps.radius_m[lamp] / distance[lamp]
            strength = min(1.0, max(0.25, (size_px / 0.5) ** 2)) * min(1.0, 2.5 * cosine[lamp])
            colour = lamps.rgb[lamp] * np.float32(gain * strength * haze[lamp])
            place = (float(u[lamp]), float(v[lamp]))
            film.add_spot(picture, *place, max(0.75 * size_px, 0.5), colour)
            if self.light.are_lamps_lit:
                film.add_spot(picture, *place, max(2.6 * size_px, 1.6), colour * np.float32(0.14))


def _smooth_noise(rng: np.random.Generator) -> Float32Array:
    """Clouds that repeat without a seam, [256, 256], 0 to 1."""
    total = np.zeros((256, 256), np.float32)
    for size, weight in ((4, 1.0), (8, 0.6), (16, 0.35), (32, 0.2)):
        coarse = rng.random((size, size)).astype(np.float32)
        wrapped = np.pad(coarse, 2, mode="wrap")
        scale = 256 // size
        fine = cv2.resize(wrapped, None, fx=scale, fy=scale, interpolation=cv2.INTER_CUBIC)
        total += weight * fine[2 * scale : 2 * scale + 256, 2 * scale : 2 * scale + 256]
    total -= total.min()
    total /= total.max()
    return np.asarray(np.clip(1.8 * total - 0.5, 0, 1), np.float32)


def _channel_number(channel: str) -> int:
    return sum(ord(letter) * (place + 1) for place, letter in enumerate(channel))
