"""The light that comes back along rays: of the ground, of surfaces, of haze and of the sky."""

import numpy as np

from shoot.world.looks.facades import Facades
from shoot.world.looks.ground import light_ground
from shoot.world.looks.light import Light
from shoot.world.looks.meshes import FACADE, GLASS, Float32Array
from shoot.world.looks.paint import Paint
from shoot.world.looks.scenery import Solid
from shoot.world.sensing.casting import SIGHT_M, Hits
from shoot.world.sensing.sky import Sky
from shoot.world.sensing.view import View
from shoot.world.town.town import Town


class Shading:
    """Shades what rays meet in one scene.

    Args:
        town: What stands.
        light: Of the scene.
        paint: The town's painted ground.
        standing: The town as rays meet it.
    """

    def __init__(self, town: Town, light: Light, paint: Paint, standing: Solid) -> None:
        self._light = light
        self._ground = light_ground(paint, town, light)
        self._standing = standing
        self._facades = Facades(standing, town)
        self._sky = Sky(town.seed)

    def light_back(self, view: View, rays: Float32Array, hits: Hits, moving: Solid) -> Float32Array:
        """Linear light [3, P] that comes back along rays [3, P].

        Args:
            view: Where they start.
            rays: Directions, in the town's frame.
            hits: What they meet.
            moving: What moves.
        """
        # Colours are kept as three planes: numpy is several times faster on them than on triples.
        light, eye = self._light, view.eye_m.astype(np.float32)
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
        rgb[:, sky] = self._sky.colours(rays[:, sky], light)
        return rgb

    def _lamp_light(self, view: View, rays: Float32Array, distance_m: Float32Array) -> Float32Array:
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
        return np.asarray(total + np.float32(0.75 * self._light.headlamps) * beam, np.float32)
