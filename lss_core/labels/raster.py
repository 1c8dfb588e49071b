"""Shapes to cells, by two rules. A cell (i, j) is the square from (i, j) to (i + 1, j + 1).

`centre`: a cell is in a polygon if its centre is. `released`: corners are rounded to whole cells
and filled with `cv2.fillPoly`, borders included, as in the code that the paper's authors released;
what is filled is larger than the polygon.
"""

import cv2
import numpy as np
from numpy.typing import NDArray

from lss_core.geometry import FloatArray
from lss_core.labels.shapes import Shapes

Mask = NDArray[np.uint8]
# What int32 can hold; OpenCV counts in 64 bits.
_FARTHEST = 2.0**30


def fill_centres(shapes: Shapes, num_cells: tuple[int, int]) -> Mask:
    """[X, Y] 1 where a cell's centre lies in one of the polygons, or in several.

    A polygon has its lower borders and not its upper ones, so that of polygons that share an edge
    one has a centre on it. Along each row of cells, edges are met from below: one that enters its
    polygon counts +1 for all centres above it, one that leaves it -1. The sum is how many polygons
    a centre lies in.

    Args:
        shapes: Polygons, in cells.
        num_cells: (X, Y).
    """
    num_x, num_y = num_cells
    start = shapes.points
    next_point = np.arange(1, len(start) + 1)
    next_point[shapes.ring_start[1:] - 1] = shapes.ring_start[:-1]
    stop = start[next_point]
    enters = start[:, 0] < stop[:, 0]
    # From low to high x, so that an edge of two polygons is the same to both.
    low, high = np.where(enters[:, None], (start, stop), (stop, start))
    first = _first_centre(low[:, 0], num_x)
    num = _first_centre(high[:, 0], num_x) - first
    met = np.flatnonzero(num)
    edge = np.repeat(met, num[met])
    x = np.arange(len(edge)) - np.repeat(np.cumsum(num[met]) - num[met], num[met]) + first[edge]
    slope = (high[met, 1] - low[met, 1]) / (high[met, 0] - low[met, 0])
    crossing = low[edge, 1] + (x + 0.5 - low[edge, 0]) * np.repeat(slope, num[met])
    place = x * (num_y + 1) + _first_centre(crossing, num_y)
    size = num_x * (num_y + 1)
    change = np.bincount(place[enters[edge]], minlength=size)
    change -= np.bincount(place[~enters[edge]], minlength=size)
    within = np.cumsum(change.reshape(num_x, num_y + 1)[:, :num_y], axis=1)
    mask: Mask = (within > 0).astype(np.uint8)
    return mask


def fill_rounded(shapes: Shapes, num_cells: tuple[int, int]) -> Mask:
    """[X, Y] 1 in what OpenCV fills of the polygons' rounded corners, less their holes.

    Borders are filled, those of holes, too.

    Args:
        shapes: Polygons, in cells.
        num_cells: (X, Y).
    """
    mask: Mask = np.zeros(num_cells, dtype=np.uint8)
    # One by one: where two of a single call overlap, OpenCV would leave a hole.
    for number in range(len(shapes)):
        cv2.fillPoly(mask, [_rounded(ring) for ring in shapes.rings(number)], 1)
    return mask


def draw_rounded(lines: Shapes, width: int, num_cells: tuple[int, int]) -> Mask:
    """[X, Y] 1 in what OpenCV draws of lines through rounded points.

    Args:
        lines: In cells.
        width: Of the lines, in cells.
        num_cells: (X, Y).
    """
    mask: Mask = np.zeros(num_cells, dtype=np.uint8)
    points = [_rounded(lines.rings(number)[0]) for number in range(len(lines))]
    cv2.polylines(mask, points, False, 1, width)
    return mask


def _first_centre(place: FloatArray, num: int) -> NDArray[np.int64]:
    """The first cell whose centre is not below a place, from 0 to `num`, which is beyond all."""
    first: NDArray[np.int64] = np.clip(np.ceil(place - 0.5), 0, num).astype(np.int64)
    return first


def _rounded(points: FloatArray) -> NDArray[np.int32]:
    """Whole cells; OpenCV has the column first."""
    places = np.clip(np.round(points), -_FARTHEST, _FARTHEST)
    return np.ascontiguousarray(places[:, ::-1]).astype(np.int32)
