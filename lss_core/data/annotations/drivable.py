"""Where cars may drive: the drivable area of nuScenes' map expansion."""

import logging
import math
from collections.abc import Sequence
from pathlib import Path

import msgspec
import numpy as np
import shapely
from numpy.typing import NDArray

from lss_core.data.annotations.rings import area_of_rings
from lss_core.data.tables.file_names import is_plain
from lss_core.data.tables.reading import decode_json
from lss_core.errors import DataError
from lss_core.geometry import FloatArray
from lss_core.legible import legible

logger = logging.getLogger(__name__)

_DAMAGE = (
    ValueError,
    OverflowError,
    RecursionError,
    msgspec.ValidationError,  # of late a ValueError
    shapely.errors.ShapelyError,
)


class _Node(msgspec.Struct, gc=False):
    token: str
    x: float
    y: float


class _Hole(msgspec.Struct, gc=False):
    node_tokens: list[str]


class _Polygon(msgspec.Struct, gc=False):
    token: str
    exterior_node_tokens: list[str]
    holes: list[_Hole]


class _Area(msgspec.Struct, gc=False):
    polygon_tokens: list[str]


class _Map(msgspec.Struct, gc=False):
    node: list[_Node]
    polygon: list[_Polygon]
    drivable_area: list[_Area]


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


def map_path(root: Path, location: str) -> Path:
    """Where a data set has the map expansion of a location.

    Raises:
        DataError: If the location is no name of a file.
    """
    if not is_plain(location):
        raise DataError(
            f"The location '{location}' of the log table cannot be the name of a map's file; name "
            "it otherwise there."
        )
    return root / "maps" / "expansion" / f"{location}.json"


def has_map(root: Path, location: str) -> bool:
    """Whether a data set has the map expansion of a location."""
    return is_plain(location) and map_path(root, location).is_file()


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
    path = map_path(root, location)
    anew = "unpack the nuScenes map expansion (nuScenes-map-expansion-v1.3.zip)"
    try:
        layers: _Map = decode_json(path.read_bytes(), _Map)
        return DrivableArea(_polygons(layers, location))
    except FileNotFoundError as error:
        raise DataError(f"The map '{path}' is missing; {anew} into '{root / 'maps'}'.") from error
    except OSError as error:
        raise DataError(f"The map '{path}' cannot be read: {error}.") from error
    except KeyError as error:
        raise DataError(f"The map '{path}' is damaged (no record {error}); {anew} anew.") from error
    except _DAMAGE as error:
        raise DataError(f"The map '{path}' is damaged ({error}); {anew} anew.") from error


def _polygons(layers: _Map, location: str) -> list[shapely.Polygon]:
    place = {node.token: (node.x, node.y) for node in layers.node}
    lost = next((token for token, xy in place.items() if not all(map(math.isfinite, xy))), None)
    if lost is not None:
        raise ValueError(f"node '{lost}' has no place")
    polygon_of = {polygon.token: polygon for polygon in layers.polygon}
    polygons: list[shapely.Polygon] = []
    mended, empty = [], []
    # Several areas may share a polygon.
    wanted = dict.fromkeys(token for area in layers.drivable_area for token in area.polygon_tokens)
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
    return polygons


def _warn(location: str, what: str, tokens: list[str]) -> None:
    if tokens:
        logger.warning(
            "%d drivable polygons of the map of %s %s; the first is '%s'.",
            len(tokens),
            legible(location),
            what,
            legible(tokens[0]),
        )
