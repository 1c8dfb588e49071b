"""The glow of lamps in a picture."""

import numpy as np

from shoot.world.looks.light import Light
from shoot.world.looks.meshes import Float32Array
from shoot.world.looks.scenery import Lamps, Solid
from shoot.world.sensing import film
from shoot.world.sensing.casting import trace
from shoot.world.sensing.view import View


def add_glow(
    picture: Float32Array, lamps: Lamps, solids: tuple[Solid, ...], view: View, light: Light
) -> None:
    """Paint the glow of lit lamps that face the camera and that nothing hides.

    Args:
        picture: [3, H, W] linear light; written to.
        lamps: All that are lit.
        solids: What may hide them.
        view: The camera.
        light: Of the scene.
    """
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
    for solid in solids:
        free &= trace(solid, view.eye_m, rays, reach)[0] < 0
    haze = np.exp(-distance / light.haze_m)
    focal_px, gain = camera.pixel_from_camera[0, 0], light.lamp_gain
    for lamp in chosen[free]:
        size_px = focal_px * lamps.radius_m[lamp] / distance[lamp]
        strength = min(1.0, max(0.25, (size_px / 0.5) ** 2)) * min(1.0, 2.5 * cosine[lamp])
        colour = lamps.rgb[lamp] * np.float32(gain * strength * haze[lamp])
        place = (float(u[lamp]), float(v[lamp]))
        film.add_spot(picture, *place, max(0.75 * size_px, 0.5), colour)
        if light.are_lamps_lit:
            film.add_spot(picture, *place, max(2.6 * size_px, 1.6), colour * np.float32(0.14))
