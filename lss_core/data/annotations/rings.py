"""The area of rings that cross themselves or each other: inside is what a ring goes around.

Counting crossings alone, a road whose outline overlaps itself would have a hole there.
"""

from collections.abc import Sequence

import numpy as np
import shapely
from numpy.typing import NDArray

from lss_core.geometry import FloatArray

Ring = Sequence[tuple[float, float]]


def area_of_rings(outline: Ring, holes: Sequence[Ring]) -> list[shapely.Polygon]:
    """Valid polygons that cover what the outline goes around and no hole does; none if that is nil.

    Args:
        outline: Points, in either direction.
        holes: The same.
    """
    area = shapely.difference(
        _inside(outline), shapely.union_all([_inside(hole) for hole in holes])
    )
    return [
        part
        for part in shapely.get_parts(area)
        if isinstance(part, shapely.Polygon) and not part.is_empty
    ]


def _inside(ring: Ring) -> shapely.Geometry:
    """What a ring goes around, either way and once or more often."""
    points = np.asarray([*ring, ring[0]], dtype=np.float64)
    # Lines that meet only at their ends part the plane into faces, each inside or out as a whole.
    lines = shapely.unary_union(shapely.LineString(points))
    faces = shapely.get_parts(shapely.polygonize([lines]))
    within = np.asarray(
        [
            _turns(points, shapely.get_coordinates(face.point_on_surface())[0]) != 0
            for face in faces
        ],
        dtype=bool,
    )
    return shapely.union_all(faces[within])


def _turns(points: FloatArray, middle: FloatArray) -> int:
    """How often a closed line goes around a point that is not on it, to the left."""
    azimuth_rad: NDArray[np.float64] = np.arctan2(*(points - middle).T[::-1])
    step_rad = np.diff(azimuth_rad)
    return round(float(((step_rad + np.pi) % (2.0 * np.pi) - np.pi).sum()) / (2.0 * np.pi))
