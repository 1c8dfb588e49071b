"""Tables as Lyft Level 5 has them: an imitation, and the real ones where they are."""

import hashlib
import json
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from driving_world import Thing, standing, write_drive
from nuscenes.nuscenes import NuScenes
from pyquaternion import Quaternion
from tiny_tables import VERSION, read_table, write_table

from lss_core.config import CAMERAS
from lss_core.data.annotations.boxes import Boxes, read_boxes
from lss_core.data.samples import SampleIndex, load_index, rows_of_split
from lss_core.errors import DataError

LYFT = "v1.01-train"
BELOW_M = -18.62
SEVEN = (*CAMERAS, "CAM_FRONT_ZOOMED")
NAMES = {"vehicle.car": "car", "vehicle.bus.rigid": "bus", "human.pedestrian.adult": "pedestrian"}
THINGS = [
    standing(9.0, 5.0, 0.4),
    standing(20.0, -4.0, category="vehicle.bus.rigid", length_m=11.0),
    Thing(lambda t: (5.0 + t, 7.0, 0.1), category="human.pedestrian.adult", keyframes=range(4)),
]
Row = dict[str, Any]


def long_token(token: str) -> str:
    """64 digits; what is no token stays empty."""
    return token and hashlib.sha256(token.encode()).hexdigest()


def with_long_tokens(row: Row) -> Row:
    def change(name: str, value: Any) -> Any:
        if name.endswith("tokens"):
            return [long_token(token) for token in value]
        return long_token(value) if name.endswith("token") or name in {"prev", "next"} else value

    return {name: change(name, value) for name, value in row.items()}


def write_as_lyft(source: Path, root: Path) -> Path:
    """The same drive in Lyft's manner; returns `root`."""
    shutil.copytree(source, root)
    (root / VERSION).rename(root / LYFT)
    tables = {path.stem: read_table(root, path.stem, LYFT) for path in (root / LYFT).glob("*.json")}
    front = {"token": "front", "channel": "LIDAR_FRONT_LEFT", "modality": "lidar"}
    tables["sensor"].append(front)
    mount = next(row for row in tables["calibrated_sensor"] if row["sensor_token"] == "LIDAR_TOP")
    tables["calibrated_sensor"].append(mount | {"token": "front-mount", "sensor_token": "front"})
    for row in list(tables["sample_data"]):
        if row["filename"].endswith("bin"):
            del row["width"], row["height"]
            if row["is_key_frame"]:  # its pose is the other lidar's
                own = {"token": row["token"] + "f", "calibrated_sensor_token": "front-mount"}
                tables["sample_data"].append(row | own | {"filename": "lidar/none.bin"})
    for name in ("sample", "sample_data", "ego_pose"):
        for row in tables[name]:
            row["timestamp"] += 0.25
    for row in tables["ego_pose"] + tables["sample_annotation"]:
        row["translation"][2] += BELOW_M
    for row in tables["category"]:
        row["name"] = NAMES[row["name"]]
    tables["log"][0]["location"] = "Palo Alto"
    for name, rows in tables.items():
        write_table(root, name, [with_long_tokens(row) for row in rows], LYFT)
    return root


def read(root: Path, version: str) -> tuple[SampleIndex, Boxes]:
    index = load_index(root, version, CAMERAS[:1])
    return index, read_boxes(root / version, index, np.arange(len(index.scene_name)))


def test_a_drive_in_lyfts_manner_is_the_same_drive(tmp_path: Path) -> None:
    plain_root = write_drive(tmp_path / "plain", THINGS)
    lyft_root = write_as_lyft(plain_root, tmp_path / "lyft")
    (plain, plain_boxes), (index, boxes) = read(plain_root, VERSION), read(lyft_root, LYFT)
    assert index.sample_token.tolist() == [long_token(str(t)) for t in plain.sample_token]
    np.testing.assert_allclose(index.time_s, plain.time_s, rtol=0.0, atol=5e-7)
    assert index.lidar_path.tolist() == plain.lidar_path.tolist()
    np.testing.assert_array_equal(index.image_hw, plain.image_hw)
    np.testing.assert_array_equal(index.track_xy_m, plain.track_xy_m)
    expected = plain.global_from_ego.copy()
    expected[:, 2, 3] += BELOW_M
    np.testing.assert_allclose(index.global_from_ego, expected, atol=1e-9)
    assert not index.scene_problem.any()
    assert not index.camera_problem.any()
    assert boxes.category.tolist() == [NAMES[name] for name in plain_boxes.category.tolist()]
    assert boxes.num_unknown == {}
    np.testing.assert_array_equal(boxes.xy_m, plain_boxes.xy_m)
    np.testing.assert_array_equal(boxes.yaw_rad, plain_boxes.yaw_rad)
    np.testing.assert_array_equal(boxes.size_m, plain_boxes.size_m)


def test_scenes_that_no_official_list_names_want_one_of_their_own(tmp_path: Path) -> None:
    root = write_as_lyft(write_drive(tmp_path / "plain"), tmp_path / "lyft")
    scenes = read_table(root, "scene", LYFT)
    write_table(root, "scene", [row | {"name": f"host-{row['name']}"} for row in scenes], LYFT)
    index = load_index(root, LYFT, CAMERAS[:1])
    with pytest.raises(DataError, match=r"splits\.json"):
        rows_of_split(index, root, LYFT, "val")
    names = {"train": [], "val": index.scene_name.tolist()}
    (root / LYFT / "splits.json").write_text(json.dumps(names))
    assert len(rows_of_split(index, root, LYFT, "val")) == len(index.sample_token)


@pytest.fixture(scope="module")
def devkit(lyft_root: Path) -> Any:
    return NuScenes(LYFT, dataroot=str(lyft_root), verbose=False)


@pytest.mark.real
def test_all_of_a_real_sample_is_what_the_devkit_says(lyft_root: Path, devkit: Any) -> None:
    index = load_index(lyft_root, LYFT, SEVEN)
    assert index.has_camera.tolist() == [[True] * 7]
    sample = devkit.sample[0]
    assert index.sample_token.tolist() == [sample["token"]]
    assert len(sample["token"]) == 64
    for n, channel in enumerate(SEVEN):
        image = devkit.get("sample_data", sample["data"][channel])
        mount = devkit.get("calibrated_sensor", image["calibrated_sensor_token"])
        pose = devkit.get("ego_pose", image["ego_pose_token"])
        assert index.image_path[0, n] == image["filename"]
        assert index.image_hw[0, n].tolist() == [image["height"], image["width"]]
        assert index.camera_time_s[0, n] == image["timestamp"] / 1e6
        np.testing.assert_array_equal(
            index.rawpixel_from_camera[0, n], np.array(mount["camera_intrinsic"])
        )
        for ours, theirs in ((index.egocam_from_camera, mount), (index.global_from_egocam, pose)):
            np.testing.assert_allclose(ours[0, n, :3, 3], theirs["translation"])
            turn = Quaternion(theirs["rotation"]).rotation_matrix
            np.testing.assert_allclose(ours[0, n, :3, :3], turn, atol=1e-9)
    lidar = devkit.get("sample_data", sample["data"]["LIDAR_TOP"])
    assert index.lidar_path[0] == lidar["filename"]
    pose = devkit.get("ego_pose", lidar["ego_pose_token"])
    np.testing.assert_allclose(index.global_from_ego[0, :3, 3], pose["translation"])
    assert not index.scene_problem.any()
    assert not index.camera_problem.any()


@pytest.mark.real
def test_real_boxes_are_the_devkits(lyft_root: Path, devkit: Any) -> None:
    index = load_index(lyft_root, LYFT, SEVEN)
    boxes = read_boxes(lyft_root / LYFT, index, np.arange(1))
    theirs = devkit.get_boxes(devkit.sample[0]["data"]["LIDAR_TOP"])
    assert boxes.category.tolist() == [box.name for box in theirs] == ["car"] * 4
    np.testing.assert_allclose(boxes.xy_m, [box.center[:2] for box in theirs])
    np.testing.assert_allclose(boxes.size_m, [box.wlh[[1, 0]] for box in theirs])
    yaws = [box.orientation.yaw_pitch_roll[0] for box in theirs]
    np.testing.assert_allclose(np.exp(1j * boxes.yaw_rad), np.exp(1j * np.array(yaws)), atol=1e-6)
