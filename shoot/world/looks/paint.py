"""The ground of a town in no light: asphalt, lines, crossings, pavements and grass.

Colours are kept in display units (square root of linear light), so that 8 bits suffice.
"""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import cv2
import numpy as np
import shapely
import shapely.ops
from numpy.typing import NDArray

from shoot.world.looks.meshes import Float32Array
from shoot.world.town.town import FloatArray, RoadLine, Town

ImageArray = NDArray[np.uint8]

MARGIN_M = 40.0
_SUBPIXEL_BITS = 4
_GRASS, _ASPHALT, _PARKING, _PAVEMENT, _KERB, _YARD = (
    (92, 112, 68), (102, 103, 107), (114, 111, 109), (158, 154, 147), (184, 182, 176),
    (128, 124, 112),
)  # fmt: skip
_WHITE, _YELLOW = (232, 232, 226), (226, 176, 52)
_DASH_M = {"lane": (3.0, 4.0), "centre": (2.5, 3.5)}


class Canvas:
    """An image over the ground that takes metres."""

    def __init__(
        self, size_m: float, cell_m: float, channels: int, colour: tuple[int, ...]
    ) -> None:
        side = int(np.ceil((size_m + 2 * MARGIN_M) / cell_m / 64)) * 64
        self.cell_m = cell_m
        self.image = np.empty((side, side, channels), np.uint8)
        self.image[:] = colour

    def _fixed(self, points_m: FloatArray) -> NDArray[np.int32]:
        cells = (np.asarray(points_m)[:, :2] + MARGIN_M) / self.cell_m - 0.5
        return np.asarray(np.round(cells * 2**_SUBPIXEL_BITS), np.int32)

    def fill(self, outlines_m: Iterable[FloatArray], colour: tuple[int, ...]) -> None:
        """Fill what lies inside an odd number of the outlines."""
        fixed = [self._fixed(outline) for outline in outlines_m]
        if fixed:
            cv2.fillPoly(self.image, fixed, colour, cv2.LINE_AA, _SUBPIXEL_BITS)

    def fill_area(self, area: shapely.Geometry, colour: tuple[int, ...]) -> None:
        """Fill polygons, and leave their holes."""
        for part in polygons_of(area):
            self.fill(
                [np.asarray(ring.coords) for ring in (part.exterior, *part.interiors)], colour
            )

    def stroke(self, points_m: FloatArray, width_m: float, colour: tuple[int, ...]) -> None:
        """Paint a band along a line, cut off square at its ends."""
        line = shapely.LineString(points_m)
        if line.length > 0:
            self.fill_area(line.buffer(width_m / 2, cap_style="flat", join_style="mitre"), colour)


def polygons_of(area: shapely.Geometry) -> Iterator[shapely.Polygon]:
    """The polygons in a polygon or a collection, without empty ones."""
    for part in shapely.get_parts(area):
        if part.geom_type == "Polygon" and not part.is_empty:
            yield part


@dataclass(frozen=True)
class Paint:
    """A town's ground without any light on it: the same for all its scenes.

    Attributes:
        image: [S, S, 4] display colours.
        cell_m: Side of a texel.
    """

    image: ImageArray
    cell_m: float

    def albedo(self, places_m: FloatArray) -> Float32Array:
        """Share of light that the ground gives back at places [P, 2]: what a lidar measures."""
        last = self.image.shape[0] - 1
        cells = np.clip((places_m + MARGIN_M) / self.cell_m, 0, last).astype(np.int64)
        display = self.image[cells[:, 1], cells[:, 0], :3].mean(axis=1) / 255.0
        # Display colours are square roots of light.
        return np.asarray(display**2, np.float32)


def paint_unlit(town: Town, cell_m: float) -> Paint:
    """Paint grass, yards, pavements, asphalt and lines."""
    canvas = Canvas(town.size_m, cell_m, 4, (*_GRASS, 0))
    for house in town.buildings:
        yard = shapely.Polygon(house.outline_m).buffer(3.0, join_style="mitre")
        canvas.fill_area(yard, (*_YARD, 0))
    canvas.fill_area(town.pavement, (*_PAVEMENT, 0))
    for part in polygons_of(town.pavement):
        for ring in (part.exterior, *part.interiors):
            canvas.stroke(np.asarray(ring.coords), 0.3, (*_KERB, 0))
    canvas.fill_area(town.road, (*_ASPHALT, 0))
    canvas.fill_area(town.parking, (*_PARKING, 0))
    _paint_marks(canvas, town)
    _roughen(canvas.image, town.seed)
    return Paint(canvas.image, cell_m)


def _paint_marks(canvas: Canvas, town: Town) -> None:
    white, yellow = (*_WHITE, 0), (*_YELLOW, 0)
    for line in town.lines:
        points = np.asarray(line.points_m, float)
        if line.kind == "stop":
            canvas.stroke(points, 0.55, white)
        elif line.kind == "edge":
            canvas.stroke(points, 0.16, white)
        elif line.kind == "lane":
            for dash in _dashes(points, *_DASH_M["lane"]):
                canvas.stroke(dash, 0.18, white)
        elif _is_double(line, town):
            # Seen from a car the two bands and the gap between them must stay apart.
            for side in (-0.17, 0.17):
                canvas.stroke(_shifted(points, side), 0.15, yellow)
        else:
            for dash in _dashes(points, *_DASH_M["centre"]):
                canvas.stroke(dash, 0.18, yellow)
    for bay in polygons_of(town.parking):
        for ring in (bay.exterior, *bay.interiors):
            canvas.stroke(np.asarray(ring.coords), 0.1, (*(210, 210, 205), 0))
    for crosswalk in town.crosswalks:
        for stripe in crosswalk_stripes(crosswalk.outline_m, crosswalk.path_m):
            canvas.fill([stripe], white)


def _is_double(line: RoadLine, town: Town) -> bool:
    """Whether a centre line parts two lanes a side (RoadLine does not say)."""
    middle = np.asarray(line.points_m)[len(line.points_m) // 2]
    best, is_double = np.inf, False
    for lane in town.lanes:
        if lane.turn is None:
            gap = float(np.min(np.hypot(*(lane.centreline_m - middle).T)))
            if gap < best - 1e-6:
                best, is_double = gap, lane.left_lane is not None or lane.right_lane is not None
    return is_double


def _shifted(points_m: FloatArray, left_m: float) -> FloatArray:
    step = np.gradient(points_m, axis=0)
    normal = np.stack([-step[:, 1], step[:, 0]], axis=1)
    length = np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-9)
    return np.asarray(points_m + left_m * normal / length, np.float64)


def _dashes(points_m: FloatArray, dash_m: float, gap_m: float) -> Iterator[FloatArray]:
    line = shapely.LineString(points_m)
    for start_m in np.arange(0.5 * gap_m, line.length - 0.5 * dash_m, dash_m + gap_m):
        dash = shapely.ops.substring(line, start_m, min(start_m + dash_m, line.length))
        if dash.geom_type == "LineString":
            yield np.asarray(dash.coords)


def crosswalk_stripes(
    outline_m: FloatArray, path_m: FloatArray, stripe_m: float = 0.6, gap_m: float = 0.6
) -> list[FloatArray]:
    """Bars [4, 2] across the way people walk, from kerb to kerb."""
    along = path_m[1] - path_m[0]
    length_m = float(np.hypot(*along))
    along = along / max(length_m, 1e-9)
    across = np.array([-along[1], along[0]])
    offsets = (np.asarray(outline_m) - path_m[0]) @ across
    low, high = float(offsets.min()), float(offsets.max())
    count = max(int((length_m + gap_m - 0.3) // (stripe_m + gap_m)), 1)
    first_m = (length_m - count * stripe_m - (count - 1) * gap_m) / 2
    stripes = []
    for k in range(count):
        start = path_m[0] + (first_m + k * (stripe_m + gap_m)) * along
        end = start + stripe_m * along
        stripes.append(
            np.array(
                [
                    start + low * across,
                    end + low * across,
                    end + high * across,
                    start + high * across,
                ]
            )
        )
    return stripes


def _roughen(image: ImageArray, seed: int) -> None:
    """Grain and patches, so that bare asphalt shows its distance, in place."""
    rng = np.random.default_rng([seed, 7])
    side = image.shape[0]
    tile = rng.normal(0.0, 5.0, (512, 512))
    coarse = rng.normal(0.0, 4.0, (side // 64 + 2, side // 64 + 2))
    for sign, change in ((1, cv2.add), (-1, cv2.subtract)):
        fine = np.repeat(np.clip(sign * tile, 0, 255).astype(np.uint8), 4, axis=1).reshape(
            512, 512, 4
        )
        patches = np.repeat(np.clip(sign * coarse, 0, 255).astype(np.uint8), 4, axis=1)
        patches = patches.reshape(*coarse.shape, 4)
        # Band by band, so that no temporary is as large as the ground.
        smooth = cv2.resize(patches, (side, side), interpolation=cv2.INTER_LINEAR)
        wide = np.tile(fine, (1, -(-side // 512), 1))[:, :side]
        for top in range(0, side, 512):
            band = image[top : top + 512]
            change(band, wide[: len(band)], dst=band)
            change(band, smooth[top : top + 512], dst=band)
