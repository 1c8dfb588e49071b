import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from driving_world import (
    VERSION,
    Thing,
    standing,
    to_global,
    write_drive,
)
from tiny_tables import TRAIN_A, VAL, read_table, write_table

from lss_core.config import CAMERAS
from lss_core.data.annotations.boxes import Boxes, has_annotations, read_boxes
from lss_core.data.samples import SampleIndex, load_index
from lss_core.data.tables import reading as tables
from lss_core.errors import DataError

CYCLIST = Thing(
    lambda t: (4.0 + 3.0 * t, -2.0, 0.3 - 0.1 * t),
    length_m=1.7,
    width_m=0.6,
    category="vehicle.bicycle",
    keyframes=range(3, 9),
)


def _index(root: Path) -> SampleIndex:
    return load_index(root, VERSION, CAMERAS[:1])


def _read(root: Path) -> Boxes:
    index = _index(root)
    return read_boxes(root / VERSION, index, np.arange(len(index.scene_name)))


def test_a_track_is_what_was_written(tmp_path: Path) -> None:
    boxes = _read(write_drive(tmp_path, [standing(9.0, 5.0), CYCLIST]))
    number = boxes.category.tolist().index("vehicle.bicycle")
    assert boxes.size_m[number].tolist() == [1.7, 0.6]
    track = boxes.track(number)
    time_s = 0.5 * np.arange(3, 9)
    np.testing.assert_allclose(boxes.time_s[track] - _index(tmp_path).time_s[0], time_s, atol=1e-6)
    expected = [to_global(VAL, 4.0 + 3.0 * t, -2.0) for t in time_s]
    np.testing.assert_allclose(boxes.xy_m[track], expected, atol=1e-9)
    np.testing.assert_allclose(boxes.yaw_rad[track], VAL.yaw_rad + 0.3 - 0.1 * time_s)


def test_only_vehicles_and_people_are_read(tmp_path: Path) -> None:
    kinds = ["vehicle.bus.rigid", "human.pedestrian.child", "animal", "movable_object.barrier"]
    things = [standing(9.0, 5.0, category=kind) for kind in kinds]
    boxes = _read(write_drive(tmp_path, things))
    assert sorted(boxes.category) == ["human.pedestrian.child", "vehicle.bus.rigid"]
    assert len(boxes.time_s) == 2 * 17


def test_a_scene_with_barriers_only_is_annotated(tmp_path: Path) -> None:
    write_drive(tmp_path, [standing(9.0, 5.0, category="movable_object.barrier")], (TRAIN_A, VAL))
    boxes = _read(tmp_path)
    names = _index(tmp_path).scene_name
    assert boxes.annotated.tolist() == [name == VAL.name for name in names]
    assert len(boxes.scene) == len(boxes.time_s) == 0
    assert list(boxes.of_scene(0)) == []


def test_only_wanted_scenes_are_read(tmp_path: Path) -> None:
    write_drive(tmp_path, [CYCLIST], (TRAIN_A, VAL))
    index = _index(tmp_path)
    own = index.scene_name.tolist().index(VAL.name)
    there = read_boxes(tmp_path / VERSION, index, np.array([own]))
    assert there.scene.tolist() == [own]
    assert [len(there.of_scene(scene)) for scene in range(2)] == [own == 0, own == 1]
    elsewhere = read_boxes(tmp_path / VERSION, index, np.array([1 - own]))
    assert len(elsewhere.scene) == 0
    assert not elsewhere.annotated.any()


def test_pieces_change_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    write_drive(tmp_path, [standing(9.0, 5.0), CYCLIST, standing(1.0, 8.0)])
    whole = _read(tmp_path)
    monkeypatch.setattr(tables, "_PIECE_BYTES", 400)
    pieces = _read(tmp_path)
    for name in ("scene", "category", "size_m", "start", "time_s", "xy_m", "yaw_rad"):
        np.testing.assert_array_equal(getattr(pieces, name), getattr(whole, name))


def test_no_annotations_are_no_boxes(tmp_path: Path) -> None:
    boxes = _read(write_drive(tmp_path))
    assert len(boxes.scene) == 0
    assert boxes.start.tolist() == [0]
    assert not boxes.annotated.any()


def test_the_index_needs_no_annotations(tmp_path: Path) -> None:
    write_drive(tmp_path, [CYCLIST])
    assert has_annotations(tmp_path / VERSION)
    for name in ("sample_annotation", "instance", "category"):
        (tmp_path / VERSION / f"{name}.json").unlink()
    assert not has_annotations(tmp_path / VERSION)
    assert len(_index(tmp_path).sample_token) == 17


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"instance_token": "nobody"}, r"instance\.json' has no record 'nobody'"),
        (
            {"size": [1.0, 0.0, 1.0]},
            r"Record '.*sample_annotation\.json' has size \[1\.0, 0\.0, 1\.0\]",
        ),
        ({"rotation": [0.0] * 4}, r"sample_annotation\.json' has rotation"),
        ({"translation": [float("nan"), 0.0, 0.0]}, r"has translation \[nan"),
        ({"size": [1.0, 2.0]}, r"sample_annotation\.json' is not as it should be"),
    ],
)
def test_bad_annotation_is_named(tmp_path: Path, change: dict[str, Any], message: str) -> None:
    write_drive(tmp_path, [CYCLIST])
    rows = read_table(tmp_path, "sample_annotation")
    write_table(tmp_path, "sample_annotation", [rows[0], rows[1] | change, *rows[2:]])
    with pytest.raises(DataError, match=message):
        _read(tmp_path)


@pytest.mark.real
def test_boxes_are_the_devkits(real_root: Path) -> None:
    from nuscenes.nuscenes import NuScenes

    devkit = NuScenes("v1.0-mini", dataroot=str(real_root), verbose=False)
    index = load_index(real_root, "v1.0-mini", CAMERAS)
    boxes = read_boxes(real_root / "v1.0-mini", index, np.array([0]))
    assert boxes.annotated.all()
    theirs = {}
    for annotation in devkit.sample_annotation:
        if annotation["category_name"].startswith(("vehicle.", "human.")):
            box = devkit.get_box(annotation["token"])
            row = index.row_of(annotation["sample_token"])
            key = (round(index.time_s[row], 4), *(round(value, 6) for value in box.center[:2]))
            theirs[key] = (box.orientation.yaw_pitch_roll[0], box.wlh[1], box.wlh[0])
    assert len(theirs) == len(boxes.time_s) > 2000
    for number in range(len(boxes.scene)):
        track = boxes.track(number)
        assert (np.diff(boxes.time_s[track]) > 0.0).all()
        for time_s, xy_m, yaw_rad in zip(
            boxes.time_s[track], boxes.xy_m[track], boxes.yaw_rad[track], strict=True
        ):
            key = (round(float(time_s), 4), *(round(float(value), 6) for value in xy_m))
            expected = theirs.pop(key)
            assert abs(np.angle(np.exp(1j * (yaw_rad - expected[0])))) < 1e-6
            np.testing.assert_allclose(boxes.size_m[number], expected[1:])
    assert not theirs


def test_tables_written_by_hand_are_read_by_the_devkit(tmp_path: Path) -> None:
    # So that what the other tests write means what nuScenes means by it.
    write_drive(tmp_path, [CYCLIST])
    record = json.loads((tmp_path / VERSION / "sample_annotation.json").read_text())[0]
    from nuscenes.utils.data_classes import Box
    from pyquaternion import Quaternion

    box = Box(record["translation"], record["size"], Quaternion(record["rotation"]))
    front_m = box.bottom_corners()[:2, :2].mean(axis=1)
    length_m = 2.0 * np.linalg.norm(front_m - box.center[:2])
    assert length_m == pytest.approx(CYCLIST.length_m)
    heading_rad = np.arctan2(*(front_m - box.center[:2])[::-1])
    boxes = _read(tmp_path)
    assert heading_rad == pytest.approx(boxes.yaw_rad[-1], abs=1e-6)
