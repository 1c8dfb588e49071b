"""From linear light to a picture: glow of lamps, drops on the lens, display curve, grain."""

import cv2
import numpy as np

from shoot.world.looks.light import Light
from shoot.world.looks.meshes import Float32Array
from shoot.world.looks.paint import ImageArray

_TILE_PX = 1024


def grain_tile(rng: np.random.Generator) -> Float32Array:
    """Noise of unit strength to cut the grain of each image from, [1024, 1024]."""
    return rng.standard_normal((_TILE_PX, _TILE_PX), dtype=np.float32)


def add_spot(
    picture: Float32Array, u_px: float, v_px: float, sigma_px: float, rgb: Float32Array
) -> None:
    """Add a round spot of light to a linear picture [3, H, W], in place."""
    reach = int(np.ceil(2.8 * sigma_px))
    left, right = max(int(u_px) - reach, 0), min(int(u_px) + reach + 2, picture.shape[2])
    top, bottom = max(int(v_px) - reach, 0), min(int(v_px) + reach + 2, picture.shape[1])
    if left >= right or top >= bottom:
        return
    across = np.exp(-0.5 * np.square((np.arange(left, right) - u_px) / sigma_px)).astype(np.float32)
    down = np.exp(-0.5 * np.square((np.arange(top, bottom) - v_px) / sigma_px)).astype(np.float32)
    picture[:, top:bottom, left:right] += rgb[:, None, None] * (down[:, None] * across)


def develop(
    picture: Float32Array, light: Light, grain: Float32Array, rng: np.random.Generator
) -> ImageArray:
    """Turn linear light [3, H, W] into an 8-bit picture [H, W, 3] (red, green, blue)."""
    shown = np.clip(picture, 0, 1)
    np.sqrt(shown, out=shown)
    shown *= np.float32(255)
    if light.wetness > 0:
        _wet_lens(shown, rng)
    for plane in shown:
        plane += np.float32(255 * light.noise) * _cut(grain, plane.shape, rng)
    np.rint(shown, out=shown)
    planes = np.clip(shown, 0, 255).astype(np.uint8)
    return np.asarray(cv2.merge(list(planes)), np.uint8)


def _cut(grain: Float32Array, shape: tuple[int, ...], rng: np.random.Generator) -> Float32Array:
    """A piece of the tile, repeated where the picture is larger than the tile."""
    height, width = shape
    top, left = (int(value) for value in rng.integers(0, _TILE_PX, 2))
    if height + top <= _TILE_PX and width + left <= _TILE_PX:
        return np.asarray(grain[top : top + height, left : left + width])
    rows, columns = (np.arange(height) + top) % _TILE_PX, (np.arange(width) + left) % _TILE_PX
    return np.asarray(grain[rows][:, columns])


def _wet_lens(shown: Float32Array, rng: np.random.Generator) -> None:
    """Drops: discs in which the picture is blurred and a little brighter, in place."""
    height, width = shown.shape[1:]
    for _ in range(int(rng.integers(5, 14))):
        u, v = int(rng.integers(0, width)), int(rng.integers(0, height))
        radius = max(int(rng.uniform(0.008, 0.024) * width), 1)
        left, right = max(u - radius, 0), min(u + radius + 1, width)
        top, bottom = max(v - radius, 0), min(v + radius + 1, height)
        down, across = np.arange(top, bottom) - v, np.arange(left, right) - u
        away = np.hypot(down[:, None], across)
        inside = np.clip(radius + 0.5 - away, 0, 1).astype(np.float32) * np.float32(0.75)
        patch = shown[:, top:bottom, left:right]
        mean = patch.mean(axis=(1, 2), keepdims=True)
        patch += inside * (mean * np.float32(1.05) - patch)
