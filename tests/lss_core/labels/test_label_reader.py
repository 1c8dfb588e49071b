import json
import logging
import math
import pickle
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from driving_world import VERSION, Thing, standing, to_global, write_drive, write_road
from nuscenes import NuScenes
from tiny_tables import TRAIN_A, VAL, read_table, write_table

from lss_core.data.samples import load_index
from lss_core.errors import DataError
from lss_core.grid import BevGrid
from lss_core.labels import CLASSES, LabelReader, sample_labels

GRID = BevGrid(-8.0, 24.0, -10.0, 12.0, 0.5)
MAP = "boston-seaport"
# As the first sample sees it: a road 8 m wide with a hole, a line on its left.
ROAD = [
    ([(-30.0, -4.0), (60.0, -4.0), (60.0, 4.0), (-30.0, 4.0)],
     [[(10.0, -1.0), (14.0, -1.0), (14.0, 2.0), (10.0, 2.0)]]),
]  # fmt: skip
LINE = [(-30.0, 2.5), (0.0, 2.5), (60.0, 2.5)]


def _write_lines(root: Path, layers: dict[str, list[list[tuple[float, float]]]]) -> None:
    path = root / "maps" / "expansion" / f"{MAP}.json"
    records = json.loads(path.read_text())
    records["line"] = []
    for layer, lines in layers.items():
        records[layer] = []
        for number, line in enumerate(lines):
            token = f"{layer}-{number}"
            places = [to_global(VAL, *place_m) for place_m in line]
            nodes = [{"token": f"{token}-{i}", "x": x, "y": y} for i, (x, y) in enumerate(places)]
            records["node"] += nodes
            records["line"].append({"token": token, "node_tokens": [n["token"] for n in nodes]})
            records[layer].append({"token": f"d-{token}", "line_token": token})
    path.write_text(json.dumps(records))


def _write(root: Path, things: list[Thing]) -> Path:
    write_drive(root, things)
    write_road(root, ROAD, MAP)
    _write_lines(root, {"lane_divider": [LINE, [(1.0, 1.0)]], "road_divider": []})
    return root


def _reader(root: Path, *classes: str, rule: str = "centre", **more: Any) -> LabelReader:
    index = load_index(root, VERSION, ())
    rows = np.arange(len(index.sample_token))
    return LabelReader(index, root, VERSION, rows, GRID, classes or CLASSES, rule, **more)


def _cells(x0: float, x1: float, y0: float, y1: float) -> np.ndarray:
    """[X, Y] cells whose centres lie in a rectangle of the ego frame."""
    x_m, y_m = GRID.centres().numpy().transpose(2, 0, 1)
    return (x_m > x0) & (x_m < x1) & (y_m > y0) & (y_m < y1)


def test_objects_lie_where_they_were_put(tmp_path: Path) -> None:
    # A car 4 m x 2 m ahead to the left, a bus across the road to the right, somebody on foot.
    things = [
        standing(10.1, 5.1, length_m=4.0, width_m=2.0),
        standing(15.1, -6.1, yaw_rad=math.pi / 2, length_m=6.0, width_m=2.0,
                 category="vehicle.bus.rigid"),
        standing(3.1, 3.1, category="human.pedestrian.adult"),
    ]  # fmt: skip
    car, vehicle = _reader(_write(tmp_path, things), "car", "vehicle").read(0)
    is_car = _cells(8.1, 12.1, 4.1, 6.1)
    np.testing.assert_array_equal(car, is_car)
    np.testing.assert_array_equal(vehicle, is_car | _cells(14.1, 16.1, -9.1, -3.1))


def test_each_sample_has_its_own_boxes_in_its_own_frame(tmp_path: Path) -> None:
    # The car goes 10 m/s: 5 m from one sample to the next.
    things = [
        Thing(lambda t: (9.1, 5.1, 0.0), length_m=4.0, keyframes=(0, 1)),
        Thing(lambda t: (9.1 + 10.0 * t, -5.1, 0.0), length_m=4.0, keyframes=(1, 2)),
    ]
    reader = _reader(_write(tmp_path, things), "vehicle")
    stands = [_cells(7.1 - 5.0 * n, 11.1 - 5.0 * n, 4.6, 5.6) for n in (0, 1)]
    goes = _cells(7.1, 11.1, -5.6, -4.6)
    for row, expected in enumerate((stands[0], stands[1] | goes, goes, np.zeros(GRID.shape))):
        np.testing.assert_array_equal(reader.read(row)[0], expected)


def test_the_map_lies_where_it_was_put(tmp_path: Path) -> None:
    reader = _reader(_write(tmp_path, [standing(9.0, 5.0)]), "drivable", "lane_boundary")
    for row in (0, 1):
        drivable, line = reader.read(row)
        gone_m = 5.0 * row
        hole = _cells(10.0 - gone_m, 14.0 - gone_m, -1.0, 2.0)
        np.testing.assert_array_equal(drivable, _cells(-99, 99, -4.0, 4.0) & ~hole)
        np.testing.assert_array_equal(line, _cells(-99, 99, 2.0, 3.0))


def test_released_labels_are_larger_by_their_borders(tmp_path: Path) -> None:
    _write(tmp_path, [standing(10.1, 5.1, length_m=4.0, width_m=2.0)])
    centre = _reader(tmp_path).read(0)
    released = _reader(tmp_path, rule="released").read(0)
    assert released[0].sum() == 9 * 5
    assert centre[0].sum() == 8 * 4
    for own, theirs in zip(centre, released, strict=True):
        assert (own <= theirs).all()
        assert theirs.sum() > own.sum()


def _tilt(root: Path) -> None:
    """Turn cars and boxes in all directions, and lift them: other numbers for each record."""
    rng = np.random.default_rng(5)
    for table in ("ego_pose", "sample_annotation"):
        rows = read_table(root, table)
        for row in rows:
            turn = np.array(row["rotation"]) + rng.normal(0.0, 0.05, 4)
            row["rotation"] = (turn / np.linalg.norm(turn)).tolist()
            row["translation"][2] -= 18.0 + rng.normal()
        write_table(root, table, rows)


def test_tilted_boxes_stand_where_the_devkit_says(tmp_path: Path) -> None:
    from devkit_labels import box_corners, filled_by_opencv, holds_centres
    from shapely import Polygon

    things = [standing(4.0 + 3 * i, 6.0 - 2.0 * i, 0.4 * i, length_m=4.5) for i in range(6)]
    _tilt(_write(tmp_path, things))
    devkit = NuScenes(VERSION, str(tmp_path), verbose=False)
    centre, released = _reader(tmp_path, "car"), _reader(tmp_path, "car", rule="released")
    for row, token in enumerate(load_index(tmp_path, VERSION, ()).sample_token[:3].tolist()):
        corners = box_corners(devkit, token, "vehicle.car")
        expected = holds_centres([Polygon(points) for points in corners], GRID)
        assert expected.sum() > 50
        np.testing.assert_array_equal(centre.read(row)[0], expected)
        np.testing.assert_array_equal(released.read(row)[0], filled_by_opencv(corners, GRID))


def test_lyfts_categories_are_the_papers(tmp_path: Path) -> None:
    kinds = ["car", "truck", "other_vehicle", "bus", "bicycle", "motorcycle", "pedestrian"]
    things = [standing(3.1 * i, 5.1, category=kind) for i, kind in enumerate(kinds)]
    car, vehicle = _reader(_write(tmp_path, things), "car", "vehicle").read(0)
    np.testing.assert_array_equal(car, _cells(-1.0, 1.0, 4.6, 5.6))
    expected = [_cells(3.1 * i - 1.0, 3.1 * i + 1.0, 4.6, 5.6) for i in range(5)]
    np.testing.assert_array_equal(vehicle, np.any(expected, axis=0))


def test_one_sample_is_one_of_many_also_in_another_process(tmp_path: Path) -> None:
    _write(tmp_path, [standing(10.1, 5.1), standing(20.0, 1.0, category="vehicle.truck")])
    token = str(load_index(tmp_path, VERSION, ()).sample_token[2])
    for rule in ("centre", "released"):
        reader = pickle.loads(pickle.dumps(_reader(tmp_path, rule=rule)))
        labels = sample_labels(tmp_path, VERSION, token, GRID, ("drivable", "car"), rule)
        assert list(labels) == ["drivable", "car"]
        all_of_them = dict(zip(CLASSES, reader.read(2), strict=True))
        for name, mask in labels.items():
            assert mask.dtype == np.uint8
            np.testing.assert_array_equal(mask, all_of_them[name])
            assert mask.any()


def test_rows_that_were_not_asked_about_are_refused(tmp_path: Path) -> None:
    _write(tmp_path, [standing(9.0, 5.0)])
    index = load_index(tmp_path, VERSION, ())
    reader = LabelReader(index, tmp_path, VERSION, np.array([5, 3]), GRID, ("car",))
    assert reader.read(3).shape == (1, *GRID.shape)
    for row in (4, 16):
        with pytest.raises(KeyError, match=f"sample {row} were not asked for"):
            reader.read(row)


def test_scenes_without_annotations_are_counted(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    write_drive(tmp_path, [standing(9.0, 5.0)], (TRAIN_A, VAL))
    index = load_index(tmp_path, VERSION, ())
    own = np.isin(index.scene_name[index.sample_scene], [TRAIN_A.name])
    reader = _reader(tmp_path, "car")
    assert f"1 of 2 scenes have no annotations, the first is {TRAIN_A.name}" in caplog.text
    assert not any(reader.read(row).any() for row in np.flatnonzero(own).tolist())
    with pytest.raises(DataError, match=r"Nobody annotated the 1 scenes asked for"):
        LabelReader(index, tmp_path, VERSION, np.flatnonzero(own), GRID, ("car",))


def test_unknown_kinds_of_objects_are_named(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level(logging.WARNING)
    _reader(_write(tmp_path, [standing(9.0, 5.0, category="REGULAR_VEHICLE")]), "vehicle")
    assert "None of 17 annotations is of class 'vehicle'; they are of REGULAR_VEHICLE" in (
        caplog.text
    )


def test_what_is_not_there_is_named(tmp_path: Path) -> None:
    _write(tmp_path, [standing(9.0, 5.0)])
    with pytest.raises(DataError, match=r"no labels 'tram'; choose among car, vehicle, drivable"):
        _reader(tmp_path, "car", "tram")
    with pytest.raises(DataError, match=r"each once"):
        _reader(tmp_path, "car", "car")
    with pytest.raises(DataError, match=r"no rule 'nearest'.*centre, released"):
        _reader(tmp_path, rule="nearest")
    with pytest.raises(DataError, match=r"No sample has the token 'nobody'"):
        sample_labels(tmp_path, VERSION, "nobody", GRID)
    write_road(tmp_path, ROAD, MAP)
    with pytest.raises(DataError, match=r"no layers 'lane_divider' and 'road_divider'"):
        _reader(tmp_path)
    assert _reader(tmp_path, "drivable").read(0).any()
    (tmp_path / "maps" / "expansion" / f"{MAP}.json").unlink()
    with pytest.raises(DataError, match=r"boston-seaport\.json' is missing"):
        _reader(tmp_path)
    (tmp_path / VERSION / "sample_annotation.json").unlink()
    with pytest.raises(DataError, match=r"lacks tables of annotations.*no labels of car"):
        _reader(tmp_path, "car", "drivable")


@pytest.mark.real
def test_real_labels_are_the_devkits(real_root: Path) -> None:
    from devkit_labels import check_labels
    from nuscenes.map_expansion.map_api import NuScenesMap

    from lss_core.labels.roads import LINE_WIDTH_M

    version, grid = "v1.0-mini", BevGrid()
    devkit = NuScenes(version, str(real_root), verbose=False)
    maps = NuScenesMap(str(real_root), "singapore-onenorth")
    index = load_index(real_root, version, ())
    rows = np.array([0, 20])
    by_rule = [
        LabelReader(index, real_root, version, rows, grid, rule=rule)
        for rule in ("centre", "released")
    ]
    for row in rows.tolist():
        centre, released = (dict(zip(CLASSES, r.read(row), strict=True)) for r in by_rule)
        token = str(index.sample_token[row])
        check_labels(devkit, maps, token, grid, centre, released, LINE_WIDTH_M)
