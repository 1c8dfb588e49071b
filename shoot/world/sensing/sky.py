"""The sky: its colours from horizon to zenith, and its clouds."""

import cv2
import numpy as np

from shoot.world.looks.light import Light
from shoot.world.looks.meshes import Float32Array


class Sky:
    """The sky over a town, with clouds of its own.

    Args:
        town_seed: The clouds follow from it.
    """

    def __init__(self, town_seed: int) -> None:
        self._clouds = _smooth_noise(np.random.default_rng([town_seed, 5]))

    def colours(self, rays: Float32Array, light: Light) -> Float32Array:
        """Colours [3, P] of the sky along rays [3, P], with clouds."""
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
