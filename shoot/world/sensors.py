"""Cameras and lidar of the synthetic city, by casting rays (Embree) and shading what they meet.

A ray meets the ground plane, the standing town or something that moves, whichever is nearest. The images
hold only what a camera would see: nothing in them depends on the ego's route or speed.
"""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from shoot.world import scenery
from shoot.world.ground import ImageArray, paint_ground
from shoot.world.light import Light, light_of
from shoot.world.meshes import FACADE, GLASS, SHADOW, Float32Array, Int32Array
from shoot.world.recording import Look, Recording
from shoot.world.rig import Camera, Rig, rotation_z
from shoot.world.scenery import AgentPose, Lamps, Solid
from shoot.world.town import FloatArray, Town

SIGHT_M = 320.0
LIDAR_REACH_M = 90.0
_AGENT_SIGHT_M = 140.0


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
class _Hits:
    """What the rays of one image met.

    Attributes:
        distance_m: [P]; `SIGHT_M` and more where nothing was met.
        standing, moving: [P] face of that solid, or -1.
        is_ground: [P].
        shade: [P] share of light left by shadows of moving things on the ground.
    """

    distance_m: Float32Array
    standing: Int32Array
    moving: Int32Array
    is_ground: NDArray[np.bool_]
    shade: Float32Array


class CitySensors:
    """All sensors of one scene.

    Args:
        town: What stands.
        recording: What moves.
        look: Light and weather.
        rig: The car's sensors.
        seed: Of the noise; images and sweeps depend on it and their time only.
        texel_m: Finest resolution of the painted ground.
    """

    def __init__(
        self,
        town: Town,
        recording: Recording,
        look: Look,
        rig: Rig,
        seed: int,
        texel_m: float = 0.1,
    ) -> None:
        self.town = town
        self.recording = recording
        self.rig = rig
        self.light: Light = light_of(look)
        self._seed = seed
        self._ground = paint_ground(town, self.light, texel_m)
        self._standing: Solid = scenery.standing_solid(town, self.light)
        self._facade = _Facades(self._standing, town)
        self._rays = {camera.channel: camera.rays_camera() for camera in rig.cameras}
        self._beams, self._rings = rig.rays_lidar()
        self._clouds = _smooth_noise(np.random.default_rng([town.seed, 5]))

    def image(self, camera: Camera, time_s: float) -> ImageArray:
        """Photograph the city.

        Args:
            camera: One of the rig's.
            time_s: When, in the recording's time.

        Returns:
            [H, W, 3] red, green, blue.
        """
        x, y, yaw = scenery.ego_pose(self.recording, time_s)
        turn = rotation_z(yaw)
        camera_m = turn @ camera.ego_from_camera[:3, 3] + np.array([x, y, 0.0])
        town_from_camera = turn @ camera.ego_from_camera[:3, :3]
        rays = self._rays[camera.channel] @ town_from_camera.T.astype(np.float32)
        poses = [
            pose
            for pose in scenery.agent_poses(self.recording, time_s)
            if np.hypot(*(pose.xy_m - camera_m[:2])) < _AGENT_SIGHT_M
        ]
        moving = scenery.moving_solid(poses, time_s, self.light, len(self.town.parked_cars))
        state = self._signal_state(time_s)
        scenery.light_signals(self._standing, state, self.light)

        window = self._pixels_of(poses, camera, camera_m, town_from_camera)
        hits = self._cast(camera_m, rays, moving, window)
        ego = (np.array([x, y]), yaw)
        linear = self._shade(camera, camera_m, rays, hits, moving, ego)
        picture = linear.reshape(camera.height_px, camera.width_px, 3)
        lamps = scenery.burning_lamps(self.town, state, poses, self.light)
        self._add_glow(picture, lamps, moving, camera, camera_m, town_from_camera)
        number = int(round(time_s * 1e6))
        rng = np.random.default_rng([self._seed, number, _channel_number(camera.channel)])
        return _develop(picture, self.light, rng)

    def sweep(self, time_s: float) -> Sweep:
        """Turn the lidar once, as if in an instant."""
        x, y, yaw = scenery.ego_pose(self.recording, time_s)
        turn = rotation_z(yaw)
        lidar_m = turn @ self.rig.ego_from_lidar[:3, 3] + np.array([x, y, 0.0])
        town_from_lidar = turn @ self.rig.ego_from_lidar[:3, :3]
        beams = self._beams @ town_from_lidar.T.astype(np.float32)
        poses = scenery.agent_poses(self.recording, time_s)
        moving = scenery.moving_solid(poses, time_s, self.light, len(self.town.parked_cars), False)
        hits = self._cast(lidar_m, beams, moving, None)
        rng = np.random.default_rng([self._seed, int(round(time_s * 1e6)), 99])
        loss = 0.03 + 0.12 * self.light.wetness
        kept = (hits.distance_m < LIDAR_REACH_M) & (rng.random(len(beams)) > loss)
        # A flat beam on the road returns next to nothing.
        kept &= ~hits.is_ground | (hits.distance_m < 45.0)
        noise_m = rng.normal(0.0, 0.015, len(beams)).astype(np.float32)
        distance = hits.distance_m + noise_m
        albedo = np.full(len(beams), 0.14, np.float32)
        objects = np.full(len(beams), scenery.NO_OBJECT, np.int32)
        for faces, solid in ((hits.standing, self._standing), (hits.moving, moving)):
            met = np.flatnonzero(faces >= 0)
            albedo[met] = solid.mesh.rgb[faces[met]].mean(axis=1)
            objects[met] = solid.object_of_face[faces[met]]
        intensity = np.clip(albedo * 180.0 + rng.normal(0, 3, len(beams)), 0, 255).astype(
            np.float32
        )
        points = np.column_stack(
            [self._beams * distance[:, None], np.round(intensity), self._rings]
        )
        return Sweep(np.asarray(points[kept], np.float32), objects[kept])

    def visible_share(
        self, points_m: FloatArray, time_s: float, object_ids: Int32Array
    ) -> FloatArray:
        """Share of each object's points that the ego sees from its roof.

        Args:
            points_m: [K, S, 3] points inside each object, in the town's frame.
            time_s: When.
            object_ids: [K] numbers as in `Sweep`.

        Returns:
            [K] shares from 0 to 1.
        """
        x, y, yaw = scenery.ego_pose(self.recording, time_s)
        eye = rotation_z(yaw) @ np.array([1.0, 0.0, 1.6]) + np.array([x, y, 0.0])
        count, samples = points_m.shape[:2]
        if count == 0:
            return np.zeros(0)
        away = points_m.reshape(-1, 3) - eye
        distance = np.linalg.norm(away, axis=1)
        rays = np.asarray(away / distance[:, None], np.float32)
        poses = scenery.agent_poses(self.recording, time_s)
        moving = scenery.moving_solid(poses, time_s, self.light, len(self.town.parked_cars), False)
        met = np.full(len(rays), scenery.NO_OBJECT, np.int32)
        hits = self._cast(eye, rays, moving, None)
        for faces, solid in ((hits.standing, self._standing), (hits.moving, moving)):
            on = np.flatnonzero(faces >= 0)
            met[on] = solid.object_of_face[faces[on]]
        own = np.repeat(object_ids, samples)
        seen = (met == own) | (hits.distance_m > distance)
        return np.asarray(seen.reshape(count, samples).mean(axis=1), np.float64)

    def _signal_state(self, time_s: float) -> NDArray[np.int64]:
        last = len(self.recording.signal_state) - 1
        step = min(max(int(round(time_s / self.recording.dt_s)), 0), last)
        return self.recording.signal_state[step]

    def _pixels_of(
        self,
        poses: list[AgentPose],
        camera: Camera,
        camera_m: FloatArray,
        town_from_camera: FloatArray,
    ) -> Int32Array:
        """Pixels that something moving (or its shadow) may cover."""
        mask = np.zeros((camera.height_px, camera.width_px), bool)
        sun = self.light.sun_direction
        cast = 0.0 if self.light.shadow >= 0.9 else 1.0 / max(float(sun[2]), 0.25)
        for pose in poses:
            length, width, height = pose.agent.size_m
            half = np.hypot(length, width) / 2 + 0.2
            corners = [
                [pose.xy_m[0] + sx * half, pose.xy_m[1] + sy * half, z]
                for sx in (-1, 1)
                for sy in (-1, 1)
                for z in (0.0, height)
            ]
            if cast > 0:
                slide = -sun[:2] * cast * 0.8 * height
                corners += [[c[0] + slide[0], c[1] + slide[1], 0.0] for c in corners[::2]]
            seen = (np.asarray(corners) - camera_m) @ town_from_camera
            if np.all(seen[:, 2] < 0.1):
                continue
            if np.any(seen[:, 2] < 0.3):
                # Something reaches behind the image plane: its outline has no bounds.
                if np.hypot(*(pose.xy_m - camera_m[:2])) < half + 8:
                    mask[:] = True
                    break
                seen[:, 2] = np.maximum(seen[:, 2], 0.3)
            k = camera.pixel_from_camera
            u = k[0, 0] * seen[:, 0] / seen[:, 2] + k[0, 2]
            v = k[1, 1] * seen[:, 1] / seen[:, 2] + k[1, 2]
            left, right = max(int(u.min()) - 1, 0), min(int(u.max()) + 3, camera.width_px)
            top, bottom = max(int(v.min()) - 1, 0), min(int(v.max()) + 3, camera.height_px)
            if left < right and top < bottom:
                mask[top:bottom, left:right] = True
        return np.flatnonzero(mask).astype(np.int32)

    def _cast(
        self, eye_m: FloatArray, rays: Float32Array, moving: Solid, window: Int32Array | None
    ) -> _Hits:
        count = len(rays)
        down = rays[:, 2] < -1e-4
        ground_m = np.full(count, 2 * SIGHT_M, np.float32)
        np.divide(np.float32(-eye_m[2]), rays[:, 2], out=ground_m, where=down)
        np.minimum(ground_m, 2 * SIGHT_M, out=ground_m)
        reach = np.minimum(ground_m, SIGHT_M)
        standing = np.full(count, -1, np.int32)
        distance = ground_m.copy()
        if self._standing.scene is not None:
            standing, met_m = _trace(self._standing.scene, eye_m, rays, reach)
            distance = np.where(standing >= 0, met_m, ground_m)
        on_moving = np.full(count, -1, np.int32)
        shade = np.ones(count, np.float32)
        if moving.scene is not None and (window is None or len(window)):
            chosen = np.arange(count, dtype=np.int32) if window is None else window
            face, met_m = _trace(
                moving.scene, eye_m, rays[chosen], np.minimum(distance[chosen], SIGHT_M)
            )
            is_shadow = (face >= 0) & (moving.mesh.material[face] == SHADOW)
            dark = chosen[is_shadow]
            on_the_ground = standing[dark] < 0
            shade[dark[on_the_ground]] = moving.lit_rgb[face[is_shadow][on_the_ground], 0]
            solid = (face >= 0) & ~is_shadow
            on_moving[chosen[solid]] = face[solid]
            distance[chosen[solid]] = met_m[solid]
            standing[chosen[solid]] = -1
        is_ground = (standing < 0) & (on_moving < 0) & (ground_m < 1.5 * SIGHT_M)
        return _Hits(distance, standing, on_moving, is_ground, shade)

    def _shade(
        self,
        camera: Camera,
        camera_m: FloatArray,
        rays: Float32Array,
        hits: _Hits,
        moving: Solid,
        ego: tuple[FloatArray, float],
    ) -> Float32Array:
        light = self.light
        eye = camera_m.astype(np.float32)
        pixel_rad = np.float32(1.0 / camera.pixel_from_camera[0, 0])
        rgb = np.empty((len(rays), 3), np.float32)
        albedo = np.zeros((len(rays), 3), np.float32) if light.headlamps > 0 else None

        ground = np.flatnonzero(hits.is_ground)
        distance = hits.distance_m[ground]
        beams = rays[ground]
        xy = eye[:2] + beams[:, :2] * distance[:, None]
        colour = self._ground.colours(xy, beams, distance * pixel_rad)
        if light.wetness > 0:
            colour *= np.float32(1 - 0.42 * light.wetness)
        full = light.ambient_rgb + np.float32(light.sun_direction[2]) * light.sun_rgb
        rgb[ground] = colour * (hits.shade[ground, None] * full)
        if albedo is not None:
            albedo[ground] = colour
        if light.wetness > 0:
            mirror = 0.04 + 0.55 * np.power(1 + beams[:, 2:3], 4)
            rgb[ground] += np.float32(light.wetness) * mirror * light.horizon_rgb * 0.8

        for faces, solid in ((hits.standing, self._standing), (hits.moving, moving)):
            met = np.flatnonzero(faces >= 0)
            face = faces[met]
            rgb[met] = solid.lit_rgb[face]
            if albedo is not None:
                albedo[met] = solid.albedo_rgb[face]
            material = solid.mesh.material[face]
            glass = np.flatnonzero(material == GLASS)
            if len(glass):
                # Panes mirror a little of the sky.
                tilt = np.clip(solid.normals[face[glass], 2:3], 0, 1)
                rgb[met[glass]] += (0.06 + 0.30 * tilt) * light.horizon_rgb
            if solid is self._standing:
                wall = np.flatnonzero(material == FACADE)
                where = met[wall]
                points = eye + rays[where] * hits.distance_m[where, None]
                rgb[where] = self._facade.colours(
                    points, face[wall], rgb[where], hits.distance_m[where] * pixel_rad, light
                )

        sky = np.flatnonzero(hits.distance_m >= SIGHT_M)
        rgb[sky] = self._sky(rays[sky])
        if albedo is not None:
            albedo[sky] = 0
            rgb += albedo * self._lamp_light(eye, rays, hits.distance_m, ego)[:, None]
        near = np.exp(-hits.distance_m / np.float32(light.haze_m))
        near[sky] = 1.0
        rgb *= near[:, None]
        rgb += (1 - near[:, None]) * light.horizon_rgb
        return rgb

    def _lamp_light(
        self,
        eye: Float32Array,
        rays: Float32Array,
        distance_m: Float32Array,
        ego: tuple[FloatArray, float],
    ) -> Float32Array:
        """Light of street lamps and of the ego's headlamps where the rays end, [P]."""
        reach = np.minimum(distance_m, 200.0)[:, None]
        points = eye + rays * reach
        total = self._ground.glow(points[:, :2])
        total *= np.exp(-np.maximum(points[:, 2] - 4.0, 0) / 3.0)
        (x, y), yaw = ego
        cos, sin = np.float32(np.cos(yaw)), np.float32(np.sin(yaw))
        dx, dy = points[:, 0] - np.float32(x), points[:, 1] - np.float32(y)
        ahead, left = cos * dx + sin * dy - 2.6, cos * dy - sin * dx
        ahead_or_0 = np.maximum(ahead, 0)
        beam = np.exp(-np.square(left / (1.2 + 0.42 * ahead_or_0)))
        beam *= np.exp(-np.maximum(points[:, 2] - 0.7 - 0.02 * ahead_or_0, 0) / 0.9)
        beam *= (ahead > 0) / (1 + np.square(ahead_or_0 / 17.0))
        return np.asarray(total + np.float32(0.75 * self.light.headlamps) * beam, np.float32)

    def _sky(self, rays: Float32Array) -> Float32Array:
        light = self.light
        height = np.clip(rays[:, 2:3], 0, 1)
        blend = 1 - np.exp(-3.2 * height)
        colour = light.horizon_rgb * (1 - blend) + light.zenith_rgb * blend
        if light.cloudiness > 0:
            scale = 60.0 / (height[:, 0] + 0.12)
            size = len(self._clouds)
            column = (rays[:, 0] * scale).astype(np.int32) % size
            row = (rays[:, 1] * scale).astype(np.int32) % size
            cloud = self._clouds[row, column] * np.minimum(height[:, 0] * 6, 1)
            bright = light.ambient_rgb + 0.6 * light.sun_rgb
            share = np.float32(light.cloudiness) * cloud[:, None]
            colour = colour * (1 - share) + bright * share
        return np.asarray(colour, np.float32)

    def _add_glow(
        self,
        picture: Float32Array,
        lamps: Lamps,
        moving: Solid,
        camera: Camera,
        camera_m: FloatArray,
        town_from_camera: FloatArray,
    ) -> None:
        """Paint the glow of lit lamps that face the camera and that nothing hides."""
        if len(lamps.points_m) == 0:
            return
        away = lamps.points_m - camera_m
        seen = away @ town_from_camera
        distance = np.linalg.norm(away, axis=1)
        k = camera.pixel_from_camera
        depth = np.maximum(seen[:, 2], 1e-3)
        u = k[0, 0] * seen[:, 0] / depth + k[0, 2]
        v = k[1, 1] * seen[:, 1] / depth + k[1, 2]
        all_round = np.all(lamps.facing == 0, axis=1)
        cosine = np.where(
            all_round, 1.0, -np.sum(lamps.facing * away, axis=1) / np.maximum(distance, 1e-3)
        )
        inside = (u > -8) & (u < camera.width_px + 8) & (v > -8) & (v < camera.height_px + 8)
        chosen = np.flatnonzero((seen[:, 2] > 0.5) & (distance < 160.0) & (cosine > 0.1) & inside)
        if len(chosen) == 0:
            return
        rays = np.asarray(away[chosen] / distance[chosen, None], np.float32)
        reach = np.asarray(distance[chosen] - 0.03, np.float32)
        free = np.ones(len(chosen), bool)
        for solid in (self._standing, moving):
            if solid.scene is not None:
                face, _ = _trace(solid.scene, camera_m, rays, reach)
                free &= face < 0
        haze = np.exp(-distance / self.light.haze_m)
        for lamp in chosen[free]:
            size_px = k[0, 0] * lamps.radius_m[lamp] / distance[lamp]
            strength = min(1.0, max(0.25, (size_px / 0.5) ** 2)) * min(1.0, 2.5 * cosine[lamp])
            colour = lamps.rgb[lamp] * np.float32(strength * haze[lamp])
            _splat(picture, float(u[lamp]), float(v[lamp]), max(0.75 * size_px, 0.5), colour)
            if self.light.headlamps > 0:
                wide = max(2.6 * size_px, 1.6)
                _splat(picture, float(u[lamp]), float(v[lamp]), wide, colour * np.float32(0.14))


def _trace(
    scene: scenery.EmbreeScene, eye_m: FloatArray, rays: Float32Array, reach_m: Float32Array
) -> tuple[Int32Array, Float32Array]:
    """First face each ray meets within its reach (-1 for none), and how far away."""
    origins = np.empty((len(rays), 3), np.float32)
    origins[:] = eye_m
    out = scene.run(origins, rays, dists=np.asarray(reach_m, np.float32), output=1)
    return out["primID"], out["tfar"]


class _Facades:
    """Windows on the walls, from where on the wall a ray arrives."""

    def __init__(self, solid: Solid, town: Town) -> None:
        count = len(solid.mesh.faces)
        self._tangent = np.stack([-solid.normals[:, 1], solid.normals[:, 0]], axis=1)
        corner = solid.mesh.vertices_m[solid.mesh.faces][:, :, :2]
        along = np.einsum("fvx,fx->fv", corner, self._tangent)
        self._start = along.min(axis=1)
        self._length = np.maximum(along.max(axis=1) - self._start, 1.0)
        house = np.clip(solid.mesh.tag, 0, max(len(town.buildings) - 1, 0))
        house[solid.mesh.material != FACADE] = 0
        style = np.array([b.style for b in town.buildings] or [0], np.int64)[house]
        height = np.array([b.height_m for b in town.buildings] or [0.0], np.float32)[house]
        step = np.array([2.6, 3.4, 1.9, 4.2], np.float32)[style % 4]
        self._step = self._length / np.maximum(np.floor(self._length / step), 1)
        self._width = np.array([0.46, 0.62, 0.56, 0.86], np.float32)[style % 4]
        self._floor = np.array([3.1, 3.4, 3.2, 3.6], np.float32)[style % 4]
        self._floors = np.floor((height - 0.5) / self._floor)
        self._tall = np.array([0.50, 0.56, 0.66, 0.46], np.float32)[style % 4]
        self._house = house.astype(np.int64)
        if len(self._step) != count:
            raise AssertionError("one entry a face")

    def colours(
        self,
        points_m: Float32Array,
        face: Int32Array,
        wall_rgb: Float32Array,
        pixel_m: Float32Array,
        light: Light,
    ) -> Float32Array:
        """Wall or window colours [P, 3] of points on walls; far windows melt into their mean."""
        along = np.einsum("px,px->p", points_m[:, :2], self._tangent[face]) - self._start[face]
        column = along / self._step[face]
        row = points_m[:, 2] / self._floor[face]
        column_number, row_number = np.floor(column), np.floor(row)
        dx, dy = np.abs(column - column_number - 0.5), np.abs(row - row_number - 0.52)
        ground_floor = row_number < 1
        half_w = np.where(ground_floor, 0.43, self._width[face] / 2)
        half_h = np.where(ground_floor, 0.38, self._tall[face] / 2)
        soft_x = np.maximum(pixel_m / self._step[face], 0.01)
        soft_y = np.maximum(pixel_m / self._floor[face], 0.01)
        cover = np.clip((half_w - dx) / soft_x + 0.5, 0, 1) * np.clip(
            (half_h - dy) / soft_y + 0.5, 0, 1
        )
        melt = np.clip(2.0 * np.maximum(soft_x, soft_y) - 0.5, 0, 1)
        cover = cover * (1 - melt) + melt * 4 * half_w * half_h
        cover = np.where(row_number < self._floors[face], cover, 0.0).astype(np.float32)[:, None]
        key = (
            column_number.astype(np.int64) * 7919
            + row_number.astype(np.int64) * 104729
            + self._house[face] * 1299709
            + (self._tangent[face, 0] * 8).astype(np.int64) * 15485863
        )
        luck = ((key * 2654435761) % 65536).astype(np.float32)[:, None] / 65536
        pane = (0.05 + 0.16 * luck) * light.horizon_rgb + 0.02 * light.ambient_rgb
        warm = np.array([0.75, 0.55, 0.28], np.float32) * (0.35 + 0.65 * np.mod(luck * 7, 1.0))
        pane = np.where(luck < light.lit_windows, np.maximum(pane, warm * 0.8), pane)
        return np.asarray(wall_rgb * (1 - cover) + pane * cover, np.float32)


def _splat(picture: Float32Array, u: float, v: float, sigma_px: float, rgb: Float32Array) -> None:
    """Add a round spot of light to a linear picture, in place."""
    reach = int(np.ceil(2.8 * sigma_px))
    left, right = max(int(u) - reach, 0), min(int(u) + reach + 2, picture.shape[1])
    top, bottom = max(int(v) - reach, 0), min(int(v) + reach + 2, picture.shape[0])
    if left >= right or top >= bottom:
        return
    across = np.exp(-0.5 * np.square((np.arange(left, right) - u) / sigma_px)).astype(np.float32)
    down = np.exp(-0.5 * np.square((np.arange(top, bottom) - v) / sigma_px)).astype(np.float32)
    picture[top:bottom, left:right] += (down[:, None] * across[None, :])[..., None] * rgb


def _develop(picture: Float32Array, light: Light, rng: np.random.Generator) -> ImageArray:
    """Linear light to an 8-bit picture: display curve, rain on the lens, noise."""
    shown = np.sqrt(np.clip(picture, 0.0, 1.0))
    height, width = shown.shape[:2]
    if light.wetness > 0:
        _rain(shown, rng)
    tile = rng.standard_normal((height, width), dtype=np.float32)
    tint = rng.standard_normal((height, width), dtype=np.float32)
    grain = np.float32(light.noise * 255)
    shown *= 255
    shown += (grain * tile)[..., None]
    shown[..., 0] += 0.4 * grain * tint
    shown[..., 2] -= 0.4 * grain * tint
    return np.asarray(np.clip(np.rint(shown), 0, 255), np.uint8)


def _rain(shown: Float32Array, rng: np.random.Generator) -> None:
    """Drops on the lens: discs in which the picture is blurred and a little brighter, in place."""
    height, width = shown.shape[:2]
    mask = np.zeros((height, width), np.float32)
    for _ in range(int(rng.integers(4, 12))):
        centre = (int(rng.integers(0, width)), int(rng.integers(0, height)))
        radius = max(int(rng.uniform(0.008, 0.022) * width), 1)
        cv2.circle(mask, centre, radius, 0.75, -1, cv2.LINE_AA)
    if height > 60:
        mask = cv2.GaussianBlur(mask, (3, 3), 0.8)
    small = cv2.resize(
        shown, (max(width // 6, 1), max(height // 6, 1)), interpolation=cv2.INTER_AREA
    )
    blurred = cv2.resize(small, (width, height), interpolation=cv2.INTER_LINEAR)
    shown += mask[..., None] * (blurred * 1.04 - shown)


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
