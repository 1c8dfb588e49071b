"""Where cars may drive: the drivable area of nuScenes' map expansion."""

import logging
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import shapely
from numpy.typing import NDArray

from lss_core.data.annotations.map_file import MapRecords, read_map
from lss_core.data.annotations.rings import area_of_rings
from lss_core.geometry import FloatArray
from lss_core.legible import legible

logger = logging.getLogger(__name__)


class DrivableArea:
    """Polygons with holes, in `global`; what lies in one of them is drivable."""

    def __init__(self, polygons: Sequence[shapely.Polygon]) -> None:
        self.polygons = np.asarray(polygons, dtype=object)
        shapely.prepare(self.polygons)
        self._tree = shapely.STRtree(self.polygons)

    def contains(self, xy_m: FloatArray) -> NDArray[np.bool_]:
        """Whether points [..., 2] in `global` are drivable [...]; edges are.

        Drivable polygons meet at edges, and a point on such an edge is on the road. It is fastest
        if the points of each row of the first axis lie near each other: only polygons that the
        bounding box of a row meets are asked.
        """
        inside = np.zeros(xy_m.shape[:-1], dtype=bool)
        if not inside.size:
            return inside
        rows_m = xy_m.reshape(len(xy_m) if xy_m.ndim > 1 else 1, -1, 2)
        rows_inside = inside.reshape(rows_m.shape[:-1])
        bounds = shapely.box(*rows_m.min(axis=1).T, *rows_m.max(axis=1).T)
        row, polygon = self._tree.query(bounds)
        order = np.argsort(polygon, kind="stable")
        row, polygon = row[order], polygon[order]
        for number, first, num in zip(
            *np.unique(polygon, return_index=True, return_counts=True), strict=True
        ):
            near = row[first : first + num]
            x_m, y_m = rows_m[near, :, 0], rows_m[near, :, 1]
            rows_inside[near] |= shapely.intersects_xy(self.polygons[number], x_m, y_m)
        return inside


def load_drivable_area(root: Path, location: str) -> DrivableArea:
    """The drivable area of a location, as `boston-seaport`.

    Polygons that cross themselves are drivable where their outline goes around, and not in their
    holes; a warning counts them, and those that enclose nothing.

    Args:
        root: Of the data set, holds `maps`.
        location: As the `log` table names it.

    Raises:
        DataError: If the map is missing or damaged, or the location is no name of a file.
    """
    return read_map(root, location, lambda records: drivable_area(records, location))


def drivable_area(records: MapRecords, location: str) -> DrivableArea:
    """The drivable area that a map's records say; `load_drivable_area` tells the rest.

    Raises:
        ValueError: If a node has no place.
        KeyError: If a token leads nowhere.
    """
    place = records.places()
    polygon_of = {polygon.token: polygon for polygon in records.polygon}
    polygons: list[shapely.Polygon] = []
    mended, empty = [], []
    # Several areas may share a polygon.
    wanted = dict.fromkeys(token for area in records.drivable_area for token in area.polygon_tokens)
    for token in wanted:
        record = polygon_of[token]
        outline = [place[node] for node in record.exterior_node_tokens]
        holes = [[place[node] for node in hole.node_tokens] for hole in record.holes]
        # A ring of less than three points encloses nothing.
        holes = [hole for hole in holes if len(hole) >= 3]
        parts = [shapely.Polygon(outline, holes)] if len(outline) >= 3 else []
        if parts and not parts[0].is_valid:
            parts = area_of_rings(outline, holes)
            mended.append(token)
        if not parts:
            empty.append(token)
        polygons += parts
    _warn(location, "cross themselves, and are drivable where their outline goes around", mended)
    _warn(location, "enclose nothing, and are passed over", empty)
    return DrivableArea(polygons)


def _warn(location: str, what: str, tokens: list[str]) -> None:
    if tokens:
        logger.warning(
            "%d drivable polygons of the map of %s %s; the first is '%s'.",
            len(tokens),
            legible(location),
            what,
            legible(tokens[0]),
        )
