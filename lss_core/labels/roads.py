"""The map's drivable area and lane boundaries around a car, in its ego frame."""

from pathlib import Path

import numpy as np
import shapely

from lss_core.data.annotations.dividers import divider_lines
from lss_core.data.annotations.drivable import drivable_area
from lss_core.data.annotations.map_file import read_map
from lss_core.geometry import FloatArray
from lss_core.labels.shapes import Shapes, join_shapes, polygon_shapes

# The paper says no width. The devkit draws dividers two pixels wide: this, on the paper's grid.
LINE_WIDTH_M = 1.0


class Layer:
    """Shapes of one location, in `global`."""

    def __init__(self, shapes: Shapes) -> None:
        self._shapes = shapes
        self._bounds_m = shapes.bounds()

    def around(self, global_from_ego: FloatArray, corners_m: FloatArray) -> Shapes:
        """What is near a rectangle of the ego frame's ground plane, in that frame.

        A map has no heights. Its points are taken to lie on the car's ground plane, straight above
        or below their places.

        Args:
            global_from_ego: [4, 4].
            corners_m: [4, 2] of the rectangle.
        """
        turn, origin_m = global_from_ego[:2, :2], global_from_ego[:2, 3]
        patch_m = corners_m @ turn.T + origin_m
        low_m, high_m = patch_m.min(axis=0), patch_m.max(axis=0)
        near = (self._bounds_m[:, :2] <= high_m) & (self._bounds_m[:, 2:] >= low_m)
        shapes = self._shapes.only(np.flatnonzero(near.all(axis=1)))
        turn_back: FloatArray = np.linalg.inv(turn)
        return shapes.moved((shapes.points - origin_m) @ turn_back.T)


def load_drivable(root: Path, location: str) -> Layer:
    """Drivable polygons of a location, as `boston-seaport`; holes are kept.

    Raises:
        DataError: If the map is missing or damaged.
    """
    area = read_map(root, location, lambda records: drivable_area(records, location))
    return Layer(polygon_shapes(area.polygons.tolist()))


def load_lane_boundaries(root: Path, location: str) -> tuple[Layer, Layer]:
    """Lane and road dividers of a location: as lines, and as polygons `LINE_WIDTH_M` wide.

    Raises:
        DataError: If the map is missing or damaged, or has no layers of dividers.
    """
    lines = read_map(root, location, divider_lines)
    strips = shapely.buffer([shapely.LineString(line) for line in lines], 0.5 * LINE_WIDTH_M)
    polygons = [part for part in shapely.get_parts(strips) if not part.is_empty]
    return Layer(join_shapes([[line] for line in lines])), Layer(polygon_shapes(polygons))
