"""The lit ground: a town's paint with shadows, as one texture with mipmaps.

Rays that meet z = 0 look their colour up here.
"""

from dataclasses import dataclass

import cv2
import numpy as np
import shapely
from numpy.typing import NDArray

from shoot.world.looks.light import Light
from shoot.world.looks.meshes import Float32Array
from shoot.world.looks.paint import MARGIN_M, Canvas, ImageArray, Paint
from shoot.world.town.town import FloatArray, Town

_RED_BLUE, _LOW, _BYTE = np.uint32(0x00FF00FF), np.uint32(0xFF), np.uint32(8)


@dataclass(frozen=True)
class Ground:
    """Mipmapped colours of the plane z = 0.

    Attributes:
        texels: [sum of levels] 8-bit colours, red in the lowest byte, all levels one after another.
        starts, heights, widths: [L] where each level begins, and its rows (y) and columns (x).
        origin_m: [2] lower left corner of texel (0, 0).
        cell_m: Size of a texel of level 0.
        lamp_glow: [Gy, Gx] light of the street lamps, one cell a metre from the same origin.
    """

    texels: NDArray[np.uint32]
    starts: NDArray[np.int32]
    heights: NDArray[np.int32]
    widths: NDArray[np.int32]
    origin_m: FloatArray
    cell_m: float
    lamp_glow: Float32Array

    def colours(
        self, places_m: Float32Array, rays: Float32Array, across_m: Float32Array, taps: int = 3
    ) -> Float32Array:
        """Mean linear colour under each pixel's footprint.

        Seen at a flat angle a footprint is long: it is covered by `taps` texels along the view,
        each from the level whose texel is as wide as a tap is long.

        Args:
            places_m: [2, P] centres of the footprints.
            rays: [3, P] unit view rays.
            across_m: [P] width of the footprints across the ray.
            taps: Texels a footprint.

        Returns:
            [3, P].
        """
        steep = np.maximum(-rays[2], np.float32(1e-3))
        along_m = across_m / steep
        size = np.maximum(across_m, along_m * np.float32(1 / taps)) * np.float32(1 / self.cell_m)
        level = np.rint(np.log2(np.maximum(size, 1))).astype(np.int32)
        np.minimum(level, len(self.starts) - 1, out=level)
        scale = (np.float32(1 / self.cell_m) / (1 << np.arange(len(self.starts)))).astype(
            np.float32
        )[level]
        stretch = along_m * scale / np.sqrt(np.maximum(1 - steep * steep, np.float32(1e-6)))
        stretch *= np.float32(1 / taps)
        step_x, step_y = rays[0] * stretch, rays[1] * stretch
        x = (places_m[0] - np.float32(self.origin_m[0])) * scale
        y = (places_m[1] - np.float32(self.origin_m[1])) * scale
        start, width = self.starts[level], self.widths[level]
        last_column, last_row = width - 1, self.heights[level] - 1
        # Red and blue share one sum, in halves that cannot overflow into each other.
        red_blue = np.zeros(len(x), np.uint32)
        green = np.zeros(len(x), np.uint32)
        for tap in range(taps):
            shift = np.float32(tap - (taps - 1) / 2)
            column = np.clip((x + shift * step_x).astype(np.int32), 0, last_column)
            row = np.clip((y + shift * step_y).astype(np.int32), 0, last_row)
            texel = self.texels[start + row * width + column]
            red_blue += texel & _RED_BLUE
            green += (texel >> _BYTE) & _LOW
        planes = _unpacked(red_blue, green, 255 * taps)
        near = np.flatnonzero(size < 1)
        if len(near):
            stretch = np.float32(0.5 * taps / 2)
            far_m = (stretch * step_x[near], stretch * step_y[near])
            planes[:, near] = self._between_texels(x[near], y[near], *far_m)
        return np.asarray(planes * planes, np.float32)

    def _between_texels(
        self, x: Float32Array, y: Float32Array, far_x: Float32Array, far_y: Float32Array
    ) -> Float32Array:
        """Display colours [3, P] close by, where a texel is larger than a pixel: two smooth taps.

        Places and half the distance between the taps are in texels of level 0.
        """
        red_blue = np.zeros(len(x), np.uint32)
        green = np.zeros(len(x), np.uint32)
        rows, columns = int(self.heights[0]), int(self.widths[0])
        for sign in (-0.5, 0.5):
            u = np.clip(x + np.float32(sign) * far_x - np.float32(0.5), 0, columns - 2)
            v = np.clip(y + np.float32(sign) * far_y - np.float32(0.5), 0, rows - 2)
            column, row = u.astype(np.int32), v.astype(np.int32)
            corner = row * columns + column
            # Weights are whole numbers; those of both taps together sum to 256.
            right = ((u - column) * 16).astype(np.uint32)
            up = ((v - row) * 8).astype(np.uint32)
            for step, weight in (
                (0, (16 - right) * (8 - up)),
                (1, right * (8 - up)),
                (columns, (16 - right) * up),
                (columns + 1, right * up),
            ):
                texel = self.texels[corner + step]
                red_blue += (texel & _RED_BLUE) * weight
                green += ((texel >> _BYTE) & _LOW) * weight
        return _unpacked(red_blue, green, 255 * 256)

    def glow(self, x_m: Float32Array, y_m: Float32Array) -> Float32Array:
        """Light of the street lamps at points ([P] each)."""
        rows, columns = self.lamp_glow.shape
        column = np.clip((x_m - np.float32(self.origin_m[0])).astype(np.int32), 0, columns - 1)
        row = np.clip((y_m - np.float32(self.origin_m[1])).astype(np.int32), 0, rows - 1)
        return np.asarray(self.lamp_glow[row, column], np.float32)


def _unpacked(red_blue: NDArray[np.uint32], green: NDArray[np.uint32], white: int) -> Float32Array:
    """Sums of packed texels as planes [3, P] of display colours, 0 to 1."""
    planes = np.empty((3, len(green)), np.float32)
    planes[0], planes[1] = red_blue & np.uint32(0xFFFF), green
    planes[2] = red_blue >> np.uint32(16)
    planes *= np.float32(1 / white)
    return planes


def light_ground(paint: Paint, town: Town, light: Light) -> Ground:
    """Lay shadows on the paint and prepare its mipmaps; the paint stays as it is."""
    lit = paint.image.copy()
    _shade(lit, paint.cell_m, town, light)
    texels, starts, heights, widths = _mipmaps(lit)
    side_m = lit.shape[0] * paint.cell_m
    origin_m = np.array([-MARGIN_M, -MARGIN_M])
    return Ground(
        texels,
        starts,
        heights,
        widths,
        origin_m,
        paint.cell_m,
        _lamp_glow(town, side_m, light.street_lamps),
    )


def _shade(image: ImageArray, cell_m: float, town: Town, light: Light) -> None:
    """Darken what houses, trees and parked cars keep the sun from, in place."""
    shadows = Canvas(town.size_m, 2 * cell_m, 1, (255,))
    sun = light.sun_direction
    slide = -sun[:2] / max(float(sun[2]), 0.1)
    # Display units are the square root of light.
    cast = round(255 * light.shadow**0.5)
    if cast < 250:
        for house in town.buildings:
            base = np.asarray(house.outline_m)
            shadows.fill_area(_hull(base, base + slide * house.height_m), (cast,))
        for thing in town.props:
            if thing.kind == "tree":
                disc = shapely.Point(*(thing.xy_m + slide * 0.7 * thing.height_m)).buffer(
                    thing.radius_m
                )
                shadows.fill_area(disc, (cast,))
        for parked in town.parked_cars:
            base = footprint(parked.xy_m, parked.yaw_rad, parked.size_m)
            shadows.fill_area(_hull(base, base + slide * 0.8 * parked.size_m[2]), (cast,))
    for parked in town.parked_cars:
        base = footprint(parked.xy_m, parked.yaw_rad, parked.size_m + 0.2)
        shadows.fill([base], (min(cast, 130),))
    soft = cv2.GaussianBlur(shadows.image, (5, 5), 1.2)
    side = image.shape[0]
    full = cv2.resize(soft, (side, side), interpolation=cv2.INTER_LINEAR)
    # Work in bands: a temporary of the whole ground would be twice its size.
    for top in range(0, side, 512):
        band = image[top : top + 512]
        image[top : top + 512] = cv2.multiply(
            band, cv2.merge([full[top : top + 512]] * 4), scale=1 / 255
        )


def _hull(first_m: FloatArray, second_m: FloatArray) -> shapely.Geometry:
    return shapely.MultiPoint(np.concatenate([first_m, second_m])).convex_hull


def footprint(xy_m: FloatArray, yaw_rad: float, size_m: FloatArray) -> FloatArray:
    """Corners [4, 2] of a box on the ground, counter-clockwise from rear right."""
    half_l, half_w = size_m[0] / 2, size_m[1] / 2
    local = np.array([[-half_l, -half_w], [half_l, -half_w], [half_l, half_w], [-half_l, half_w]])
    cos, sin = np.cos(yaw_rad), np.sin(yaw_rad)
    return np.asarray(local @ np.array([[cos, sin], [-sin, cos]]) + xy_m, np.float64)


def _mipmaps(
    image: ImageArray,
) -> tuple[NDArray[np.uint32], NDArray[np.int32], NDArray[np.int32], NDArray[np.int32]]:
    levels = [image]
    while min(levels[-1].shape[:2]) > 16:
        height, width = levels[-1].shape[:2]
        levels.append(
            cv2.resize(levels[-1], (width // 2, height // 2), interpolation=cv2.INTER_AREA)
        )
    flat = [np.ascontiguousarray(level).view(np.uint32).reshape(-1) for level in levels]
    heights = np.array([level.shape[0] for level in levels], np.int32)
    widths = np.array([level.shape[1] for level in levels], np.int32)
    starts = np.concatenate([[0], np.cumsum(heights * widths)[:-1]]).astype(np.int32)
    return np.concatenate(flat), starts, heights, widths


def _lamp_glow(town: Town, side_m: float, strength: float) -> Float32Array:
    """Pools of light under the lamp posts, in linear light on a grid of one metre."""
    cells = int(np.ceil(side_m))
    glow = np.zeros((cells, cells), np.float32)
    if strength <= 0:
        return glow
    reach = 22
    offsets = np.arange(-reach, reach + 1, dtype=np.float32)
    for thing in town.props:
        if thing.kind != "lamp_post":
            continue
        x, y = np.asarray(thing.xy_m) + MARGIN_M
        column, row = int(x), int(y)
        if min(column, row) < reach or max(column, row) >= cells - reach:
            continue
        dx = (offsets + column + 0.5 - x)[None, :]
        dy = (offsets + row + 0.5 - y)[:, None]
        height2 = np.float32(max(thing.height_m, 4.0) ** 2)
        pool = (height2 / (height2 + 1.2 * (dx**2 + dy**2))) ** 2
        glow[row - reach : row + reach + 1, column - reach : column + reach + 1] += pool
    return np.asarray(np.minimum(glow, 1.5) * np.float32(0.30 * strength), np.float32)
