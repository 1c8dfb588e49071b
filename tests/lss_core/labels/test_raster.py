from collections.abc import Sequence

import cv2
import numpy as np
import pytest
import shapely

from lss_core.geometry import FloatArray
from lss_core.labels.raster import draw_rounded, fill_centres, fill_rounded
from lss_core.labels.shapes import join_shapes, polygon_shapes, quadrangles

SIZE = (40, 30)


def _polygons(seed: int, num: int = 12) -> list[shapely.Polygon]:
    """Overlapping polygons with holes, some beyond the border, in either direction."""
    rng = np.random.default_rng(seed)
    polygons = []
    for number, centre in enumerate(rng.uniform(-5.0, [45.0, 35.0], (num, 2))):
        hull = shapely.convex_hull(shapely.MultiPoint(centre + rng.normal(0.0, 4.0, (9, 2))))
        hole = shapely.affinity.scale(hull, 0.5, 0.4).exterior
        polygon = shapely.Polygon(hull.exterior, [hole])
        polygons.append(shapely.reverse(polygon) if number % 2 else polygon)
    return polygons


def _holds_centres(polygons: Sequence[shapely.Geometry]) -> np.ndarray:
    x, y = np.meshgrid(*(np.arange(num) + 0.5 for num in SIZE), indexing="ij")
    return np.any([shapely.contains_xy(polygon, x, y) for polygon in polygons], axis=0)


@pytest.mark.parametrize("seed", range(4))
def test_cells_are_those_whose_centres_lie_in_a_polygon(seed: int) -> None:
    polygons = _polygons(seed)
    expected = _holds_centres(polygons)
    assert 0.1 < expected.mean() < 0.9
    np.testing.assert_array_equal(fill_centres(polygon_shapes(polygons), SIZE), expected)


def test_a_hole_is_of_its_own_polygon() -> None:
    ring = shapely.box(2.0, 3.0, 22.0, 25.0) - shapely.box(6.0, 6.0, 18.0, 20.0)
    island = shapely.box(10.0, 8.0, 12.0, 13.0)
    for fill in (fill_centres, fill_rounded):
        mask = fill(polygon_shapes([ring, island]), SIZE)
        assert mask[3, 10] == mask[10, 9] == 1
        assert mask[8, 9] == mask[14, 9] == mask[30, 10] == 0


def _box(x0: float, y0: float, x1: float, y1: float) -> FloatArray:
    return np.array([(x0, y0), (x1, y0), (x1, y1), (x0, y1)])


def test_lower_edges_are_in_and_upper_ones_out() -> None:
    # Through centres of cells: from (2.5, 3.5) to (5.5, 9.5).
    mask = fill_centres(quadrangles(_box(2.5, 3.5, 5.5, 9.5)[None]), SIZE)
    assert np.argwhere(mask).tolist() == [[x, y] for x in (2, 3, 4) for y in range(3, 9)]


def test_polygons_that_share_edges_share_no_cell_and_leave_none_out() -> None:
    # Corners on centres, so that edges run through many.
    nodes = np.random.default_rng(1).integers(0, 10, (30, 2)) + 10.5
    parts = shapely.get_parts(shapely.delaunay_triangles(shapely.MultiPoint(nodes)))
    one_by_one = sum(fill_centres(polygon_shapes([part]), SIZE).astype(int) for part in parts)
    whole = fill_centres(polygon_shapes([shapely.union_all(parts)]), SIZE)
    np.testing.assert_array_equal(one_by_one, whole)
    assert whole.sum() > 30


def test_rounded_polygons_are_what_opencv_fills() -> None:
    shapes = polygon_shapes(_polygons(7))
    expected = np.zeros(SIZE, dtype=np.uint8)
    for number in range(len(shapes)):
        rings = [np.round(ring)[:, ::-1].astype(np.int32) for ring in shapes.rings(number)]
        one = np.zeros(SIZE, dtype=np.uint8)
        cv2.fillPoly(one, rings, 1)
        expected |= one
    np.testing.assert_array_equal(fill_rounded(shapes, SIZE), expected)
    assert expected.sum() > 1.1 * fill_centres(shapes, SIZE).sum()


def test_rounding_takes_corners_to_cells_with_their_borders() -> None:
    # 4 x 2 cells become 5 x 3: the cells from (3, 5) to (7, 7), whichever way is x.
    corners = _box(2.6, 5.4, 6.6, 7.4)
    assert np.argwhere(fill_rounded(quadrangles(corners[None]), SIZE)).tolist() == [
        [x, y] for x in range(3, 8) for y in range(5, 8)
    ]


def test_lines_are_drawn_through_rounded_points() -> None:
    lines = join_shapes([[np.array([(2.4, 3.0), (8.6, 3.0)])], [np.array([(20.0, 4), (20, 9)])]])
    mask = draw_rounded(lines, 1, SIZE)
    assert np.argwhere(mask).tolist() == [
        *([x, 3] for x in range(2, 10)), *([20, y] for y in range(4, 10)),
    ]  # fmt: skip


def test_without_shapes_all_cells_are_empty() -> None:
    for fill in (fill_centres, fill_rounded, lambda shapes, size: draw_rounded(shapes, 1, size)):
        assert fill(join_shapes([]), SIZE).shape == SIZE
        assert not fill(quadrangles(np.zeros((0, 4, 2))), SIZE).any()


def test_shapes_keep_rings_and_bounds() -> None:
    shapes = polygon_shapes(_polygons(3))
    some = shapes.only(np.array([4, 9]))
    for number, old in enumerate((4, 9)):
        for ring, before in zip(some.rings(number), shapes.rings(old), strict=True):
            np.testing.assert_array_equal(ring, before)
    expected = [shapely.MultiPoint(some.rings(number)[0]).bounds for number in (0, 1)]
    np.testing.assert_array_equal(some.bounds(), expected)
    assert join_shapes([]).bounds().shape == (0, 4)
