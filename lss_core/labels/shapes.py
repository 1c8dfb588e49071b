"""Polygons and lines as flat arrays of points, so that all of them are moved at once."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import shapely
from numpy.typing import NDArray

from lss_core.geometry import FloatArray


@dataclass(frozen=True)
class Shapes:
    """N polygons with holes, or N lines, of P points in R rings.

    A polygon is its outline, counter-clockwise, then its holes, clockwise; no ring repeats its
    first point. A line is one ring that is not closed.

    Attributes:
        points: [P, 2].
        ring_start: [R + 1] where each ring's points begin.
        shape_start: [N + 1] where each shape's rings begin.
    """

    points: FloatArray
    ring_start: NDArray[np.int64]
    shape_start: NDArray[np.int64]

    def __len__(self) -> int:
        """How many there are."""
        return len(self.shape_start) - 1

    def moved(self, points: FloatArray) -> "Shapes":
        """The same with points elsewhere."""
        return replace(self, points=points)

    def rings(self, shape: int) -> list[FloatArray]:
        """The rings of a shape, [., 2] each."""
        first, stop = self.shape_start[shape : shape + 2]
        return np.split(
            self.points[self.ring_start[first] : self.ring_start[stop]],
            self.ring_start[first + 1 : stop] - self.ring_start[first],
        )

    def bounds(self) -> FloatArray:
        """[N, 4] least x, least y, largest x, largest y of each."""
        if not len(self):
            return np.zeros((0, 4))
        start = self.ring_start[self.shape_start[:-1]]
        low = np.minimum.reduceat(self.points, start)
        high = np.maximum.reduceat(self.points, start)
        return np.concatenate([low, high], axis=1)

    def only(self, wanted: NDArray[np.int64]) -> "Shapes":
        """Some of them, by number."""
        return join_shapes([self.rings(number) for number in wanted.tolist()])


def join_shapes(shapes: Sequence[Sequence[FloatArray]]) -> Shapes:
    """Shapes from the rings of each, of one point or more."""
    rings = [ring for shape in shapes for ring in shape]
    return Shapes(
        np.concatenate([np.zeros((0, 2)), *rings]),
        np.cumsum([0, *map(len, rings)]),
        np.cumsum([0, *map(len, shapes)]),
    )


def quadrangles(corners: FloatArray) -> Shapes:
    """Shapes of four corners each, [N, 4, 2], counter-clockwise."""
    start = np.arange(len(corners) + 1)
    return Shapes(corners.reshape(-1, 2), 4 * start, start)


def polygon_shapes(polygons: Sequence[shapely.Polygon]) -> Shapes:
    """Shapes of valid polygons."""
    return join_shapes(
        [
            [_turned(polygon.exterior, True), *(_turned(r, False) for r in polygon.interiors)]
            for polygon in polygons
        ]
    )


def _turned(ring: shapely.LinearRing, is_outline: bool) -> FloatArray:
    """The points of a ring but the last: an outline's counter-clockwise, a hole's clockwise."""
    points: FloatArray = shapely.get_coordinates(ring)[:-1]
    return points if bool(shapely.is_ccw(ring)) == is_outline else points[::-1]
