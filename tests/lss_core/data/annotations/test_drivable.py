import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely

from lss_core.data.annotations.drivable import DrivableArea, load_drivable_area
from lss_core.data.annotations.map_file import map_path
from lss_core.errors import DataError
from shoot.world.nuscenes.map_layers import merge_layers, town_layers
from shoot.world.nuscenes.tiling import LOCATIONS, TILE_M
from shoot.world.town.roads import make_town

CITY = "boston-seaport"


def _write(root: Path, layers: Any, location: str = CITY) -> Path:
    path = map_path(root, location)
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(layers if isinstance(layers, str) else json.dumps(layers))
    return root


def _layers(rings: dict[str, list[list[tuple[float, float]]]]) -> dict[str, Any]:
    """Map layers with one drivable area of some polygons: outline first, then holes."""
    nodes: list[dict[str, Any]] = []

    def add(ring: list[tuple[float, float]]) -> list[str]:
        new = [{"token": f"n{len(nodes) + i}", "x": x, "y": y} for i, (x, y) in enumerate(ring)]
        nodes.extend(new)
        return [row["token"] for row in new]

    polygons = [
        {
            "token": name,
            "exterior_node_tokens": add(outline),
            "holes": [{"node_tokens": add(hole)} for hole in holes],
        }
        for name, (outline, *holes) in rings.items()
    ]
    area = {"token": "area", "polygon_tokens": list(rings)}
    return {"node": nodes, "polygon": polygons, "drivable_area": [area], "lane": "not read"}


def _box(x: float, y: float, side: float) -> list[tuple[float, float]]:
    return [(x, y), (x + side, y), (x + side, y + side), (x, y + side)]


def test_holes_are_not_drivable_and_what_lies_in_them_may_be(tmp_path: Path) -> None:
    rings = {
        "ring": [_box(100.0, 200.0, 10.0), _box(102.0, 202.0, 6.0)],
        "island": [_box(104.0, 204.0, 2.0)],
        "apart": [_box(130.0, 200.0, 5.0)],
    }
    area = load_drivable_area(_write(tmp_path, _layers(rings)), CITY)
    points_m = np.array(
        [
            [[101.0, 205.0], [103.0, 203.0], [105.0, 205.0]],
            [[132.0, 204.0], [120.0, 204.0], [205.0, 105.0]],
        ]
    )
    assert area.contains(points_m).tolist() == [[True, False, True], [True, False, False]]


def test_edges_between_polygons_are_drivable(tmp_path: Path) -> None:
    rings = {"left": [_box(0.0, 0.0, 4.0)], "right": [_box(4.0, 0.0, 4.0)]}
    area = load_drivable_area(_write(tmp_path, _layers(rings)), CITY)
    assert area.contains(np.array([[4.0, 2.0], [8.0, 2.0], [8.01, 2.0]])).tolist() == [
        True,
        True,
        False,
    ]


def test_fast_is_polygon_by_polygon() -> None:
    rng = np.random.default_rng(0)
    polygons = []
    for centre_m in rng.uniform(0.0, 60.0, (40, 2)):
        hull = shapely.convex_hull(shapely.MultiPoint(centre_m + rng.normal(0.0, 5.0, (9, 2))))
        hole = shapely.affinity.scale(hull, 0.4, 0.4)
        polygons.append(shapely.Polygon(hull.exterior, [hole.exterior]))
    points_m = rng.uniform(-10.0, 70.0, (50, 80, 2))
    slow = np.zeros((50, 80), dtype=bool)
    for polygon in polygons:
        slow |= shapely.contains_xy(polygon, points_m[..., 0], points_m[..., 1])
    assert 0.1 < slow.mean() < 0.9
    np.testing.assert_array_equal(DrivableArea(polygons).contains(points_m), slow)


def test_nothing_is_drivable_on_an_empty_map(tmp_path: Path) -> None:
    area = load_drivable_area(_write(tmp_path, _layers({})), CITY)
    assert area.contains(np.zeros((2, 3, 2))).tolist() == [[False] * 3] * 2
    assert area.contains(np.zeros((0, 2))).shape == (0,)


def test_rings_that_enclose_nothing_are_passed_over(tmp_path: Path) -> None:
    rings = {"line": [[(0.0, 0.0), (1.0, 1.0)]], "road": [_box(0.0, 0.0, 4.0), [(1.0, 1.0)]]}
    area = load_drivable_area(_write(tmp_path, _layers(rings)), CITY)
    assert len(area.polygons) == 1
    assert area.contains(np.array([1.0, 1.0]))


_SQUARE = _box(0.0, 0.0, 4.0)
# The outline overlaps itself between x = 6 m and 8 m: the second arm lies on the first.
_LOOP = [(0.0, 0.0), (8.0, 0.0), (8.0, 8.0), (2.0, 8.0), (2.0, 6.0), (6.0, 6.0), (6.0, -4.0),
         (0.0, -4.0)]  # fmt: skip


@pytest.mark.parametrize(
    ("rings", "inside", "outside"),
    [
        ([[(0.0, 0.0), (4.0, 4.0), (4.0, 0.0), (0.0, 4.0)]], [(0.5, 2), (3.5, 2)], [(2, 0.5)]),
        ([_LOOP], [(7.0, 4.0), (3.0, 7.0), (6.5, 3.0), (3.0, -2.0)], [(3.0, 3.0), (7.0, -2.0)]),
        ([_SQUARE * 2], [(1.0, 3.0), (2.0, 2.0)], [(5.0, 2.0)]),
        ([_SQUARE, _box(3.0, 3.0, 4.0)], [(1.0, 1.0)], [(3.5, 3.5), (6.0, 6.0)]),
        ([_SQUARE, _box(1, 1, 2), _box(2, 2, 1.5)], [(0.5, 0.5)], [(2.5, 2.5), (1.5, 1.5)]),
        ([[*_SQUARE, (0.0, 9.0)]], [(2.0, 2.0)], [(1.0, 8.0)]),
    ],
    ids=["bow tie", "a loop", "twice around", "a hole across the edge", "holes overlap", "a spike"],
)  # fmt: skip
def test_polygons_that_cross_are_drivable_where_they_go_around(
    tmp_path: Path, rings: Any, inside: Any, outside: Any, caplog: pytest.LogCaptureFixture
) -> None:
    for turn in (1, -1):
        layers = _layers({"road": [ring[::turn] for ring in rings], "good": [_box(50.0, 0.0, 1.0)]})
        caplog.clear()
        area = load_drivable_area(_write(tmp_path, layers), CITY)
        assert area.contains(np.asarray(inside, dtype=float)).all()
        assert not area.contains(np.asarray(outside, dtype=float)).any()
        assert all(polygon.is_valid for polygon in area.polygons)
        assert f"1 drivable polygons of the map of {CITY} cross themselves" in caplog.text
        assert "'road'" in caplog.text


@pytest.mark.parametrize(
    "change",
    [lambda ring: ring[::-1], lambda ring: [*ring, ring[0]], lambda ring: [ring[0], *ring]],
    ids=["clockwise", "closed", "a node twice"],
)
def test_whole_polygons_are_written_in_many_ways(
    tmp_path: Path, change: Any, caplog: pytest.LogCaptureFixture
) -> None:
    layers = _layers({"road": [change(_SQUARE), change(_box(1.0, 1.0, 1.0))]})
    area = load_drivable_area(_write(tmp_path, layers), CITY)
    assert [polygon.area for polygon in area.polygons] == [15.0]
    assert not caplog.records


def test_polygons_of_no_area_are_named(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    flat = [(0.0, 0.0), (1.0, 1.0), (2.0, 2.0)]
    layers = _layers({"flat": [flat], "covered": [_SQUARE, _box(-1.0, -1.0, 9.0)]})
    area = load_drivable_area(_write(tmp_path, layers), CITY)
    assert len(area.polygons) == 0
    assert "2 drivable polygons" in caplog.text
    assert "enclose nothing, and are passed over; the first is 'flat'" in caplog.text


def test_towns_are_drivable_where_the_devkit_says(tmp_path: Path) -> None:
    from nuscenes.map_expansion.map_api import NuScenesMap

    # Two towns side by side, as shoot-make-world writes them.
    origins_m = np.array([[0.0, 0.0], [TILE_M, 0.0]])
    towns = [
        town_layers(make_town(seed), f"town-{seed}", origin_m)
        for seed, origin_m in zip((3, 8), origins_m, strict=True)
    ]
    location = LOCATIONS[0]
    _write(tmp_path, merge_layers(towns, location.canvas_m), location.name)
    area = load_drivable_area(tmp_path, location.name)
    theirs = NuScenesMap(str(tmp_path), location.name)
    polygons = [
        theirs.extract_polygon(token)
        for record in theirs.drivable_area
        for token in record["polygon_tokens"]
    ]
    assert sum(len(polygon.interiors) for polygon in polygons) > 2
    rng = np.random.default_rng(0)
    points_m = rng.uniform([0.0, 0.0], [2.0 * TILE_M, TILE_M], (4000, 2))
    expected = np.zeros(len(points_m), dtype=bool)
    for polygon in polygons:
        expected |= shapely.contains_xy(polygon, *points_m.T)
    assert 0.05 < expected.mean() < 0.95
    inside = area.contains(points_m)
    np.testing.assert_array_equal(inside, expected)
    for number in range(40):
        layers = theirs.layers_on_point(*points_m[number], layer_names=["drivable_area"])
        assert inside[number] == bool(layers["drivable_area"])


def test_a_missing_map_says_what_to_get(tmp_path: Path) -> None:
    with pytest.raises(DataError, match=r"boston-seaport\.json' is missing.*map-expansion-v1\.3"):
        load_drivable_area(tmp_path, CITY)


_GOOD = _layers({"road": [_box(0.0, 0.0, 4.0)]})


@pytest.mark.parametrize(
    "layers",
    [
        "",
        "[1, 2",
        json.dumps(_GOOD)[:-40],
        [],
        {name: _GOOD[name] for name in ("node", "polygon")},
        _GOOD | {"node": _GOOD["node"][1:]},
        _GOOD | {"polygon": []},
        _GOOD | {"node": [{"token": "n0", "x": "east", "y": 0.0}]},
    ],
)
def test_a_damaged_map_says_what_to_get(tmp_path: Path, layers: Any) -> None:
    with pytest.raises(DataError, match=r"boston-seaport\.json' is damaged.*map-expansion-v1\.3"):
        load_drivable_area(_write(tmp_path, layers), CITY)


def test_numbers_that_are_none_elsewhere_do_no_harm(tmp_path: Path) -> None:
    layers = _GOOD | {"traffic_light": [{"pose": float("nan")}]}
    assert load_drivable_area(_write(tmp_path, layers), CITY).contains(np.array([2.0, 2.0]))


def test_an_unreadable_map_is_named(tmp_path: Path) -> None:
    map_path(tmp_path, CITY).mkdir(parents=True)
    with pytest.raises(DataError, match=r"boston-seaport\.json' cannot be read"):
        load_drivable_area(tmp_path, CITY)


@pytest.mark.real
def test_a_real_map_is_drivable_where_the_devkit_says(real_root: Path) -> None:
    from nuscenes.map_expansion.map_api import NuScenesMap

    theirs = NuScenesMap(str(real_root), "singapore-onenorth")
    area = load_drivable_area(real_root, "singapore-onenorth")
    low, high = (
        np.min([p.bounds[:2] for p in area.polygons], 0),
        np.max([p.bounds[2:] for p in area.polygons], 0),
    )
    points_m = np.random.default_rng(0).uniform(low, high, (300, 2))
    inside = area.contains(points_m)
    assert 0.1 < inside.mean() < 0.9
    for point_m, here in zip(points_m, inside, strict=True):
        layers = theirs.layers_on_point(*point_m, layer_names=["drivable_area"])
        assert here == bool(layers["drivable_area"])
