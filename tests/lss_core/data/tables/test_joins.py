"""The index against nuscenes-devkit, the reader that says what the tables mean."""

import random
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from nuscenes.nuscenes import NuScenes
from nuscenes.utils.geometry_utils import transform_matrix
from pyquaternion import Quaternion
from tiny_tables import (
    KEYFRAMES_A_SCENE,
    TRAIN_A,
    VAL,
    VERSION,
    TinyScene,
    read_table,
    write_table,
    write_tiny,
)

from lss_core.config import CAMERAS
from lss_core.data.samples import SampleIndex, load_index
from lss_core.data.tables import reading as tables

WITHOUT_LIDAR = TinyScene("scene-0005", has_lidar=False)
Row = dict[str, Any]


def as_written(rows: list[Row]) -> list[Row]:
    return rows


def shuffled(rows: list[Row]) -> list[Row]:
    return random.Random(0).sample(rows, len(rows))


def with_gaps(rows: list[Row]) -> list[Row]:
    return [row for row in rows if random.Random(row["token"]).random() < 0.8]


def with_doubles(rows: list[Row]) -> list[Row]:
    again = [row | {"token": row["token"] + "b"} for row in rows[::3]]
    return rows + [row | {"filename": "other-" + row["filename"]} for row in again]


def as_lyft_writes(rows: list[Row]) -> list[Row]:
    """Times are fractions, sizes are missing or null, columns are many."""
    rows = [row | {"timestamp": row["timestamp"] + 0.25, "more": [{"a": "},{"}]} for row in rows]
    for row in rows[::2]:
        row |= {"height": None, "width": None}
    for row in rows[1::4]:
        del row["height"], row["width"]
    return rows


@pytest.mark.parametrize("change", [as_written, shuffled, with_gaps, with_doubles, as_lyft_writes])
@pytest.mark.parametrize("piece_bytes", [500, 20_000, 1 << 18])
def test_index_is_what_the_devkit_says(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    change: Callable[[list[Row]], list[Row]],
    piece_bytes: int,
) -> None:
    root = write_tiny(
        tmp_path / "data", (TRAIN_A, WITHOUT_LIDAR, VAL), cameras=CAMERAS[:3], image_hw=(36, 64)
    )
    write_table(root, "sample_data", change(read_table(root, "sample_data")))
    monkeypatch.setenv("SHOOT_CACHE", str(tmp_path / "cache"))
    monkeypatch.setattr(tables, "_PIECE_BYTES", piece_bytes)
    index = load_index(root, VERSION, CAMERAS[1:3])
    nusc = NuScenes(VERSION, dataroot=str(root), verbose=False)
    assert index.sample_token.tolist() == [sample["token"] for sample in nusc.sample]
    assert len(index.sample_token) == 3 * KEYFRAMES_A_SCENE
    assert index.scene_name.tolist() == [scene["name"] for scene in nusc.scene]
    for row in range(len(index.sample_token)):
        check_sample(index, row, nusc)
    for scene in range(3):
        check_track(index, scene, nusc)


def check_sample(index: SampleIndex, row: int, nusc: NuScenes) -> None:
    sample = nusc.get("sample", str(index.sample_token[row]))
    assert index.scene_token[index.sample_scene[row]] == sample["scene_token"]
    if "LIDAR_TOP" in sample["data"]:
        lidar = nusc.get("sample_data", sample["data"]["LIDAR_TOP"])
        assert index.lidar_path[row] == lidar["filename"]
        assert index.time_s[row] == lidar["timestamp"] / 1e6
        check_pose(index.global_from_ego[row], nusc.get("ego_pose", lidar["ego_pose_token"]))
        check_pose(index.ego_from_lidar[row], calibration(nusc, lidar))
    else:
        assert index.lidar_path[row] == ""
    for n, camera in enumerate(index.cameras):
        assert index.has_camera[row, n] == (camera in sample["data"])
        if not index.has_camera[row, n]:
            assert index.image_path[row, n] == ""
            assert index.camera_time_s[row, n] == index.time_s[row]
            continue
        image = nusc.get("sample_data", sample["data"][camera])
        assert index.image_path[row, n] == image["filename"]
        assert index.image_hw[row, n].tolist() == [image.get(s) or 0 for s in ("height", "width")]
        assert index.camera_time_s[row, n] == image["timestamp"] / 1e6
        check_pose(index.global_from_egocam[row, n], nusc.get("ego_pose", image["ego_pose_token"]))
        check_pose(index.egocam_from_camera[row, n], calibration(nusc, image))
        intrinsics = calibration(nusc, image)["camera_intrinsic"]
        np.testing.assert_array_equal(index.rawpixel_from_camera[row, n], intrinsics)


def check_track(index: SampleIndex, scene: int, nusc: NuScenes) -> None:
    token = str(index.scene_token[scene])
    own = {sample["token"] for sample in nusc.sample if sample["scene_token"] == token}
    frames = [frame for frame in nusc.sample_data if frame["sample_token"] in own]
    sweeps = [frame for frame in frames if frame["channel"] == "LIDAR_TOP"] or frames
    at = {frame["timestamp"]: frame["ego_pose_token"] for frame in sweeps}
    poses = [nusc.get("ego_pose", at[time]) for time in sorted(at)]
    track = index.track(scene)
    np.testing.assert_array_equal(index.track_time_s[track], np.array(sorted(at)) / 1e6)
    np.testing.assert_array_equal(
        index.track_xy_m[track], [pose["translation"][:2] for pose in poses]
    )
    yaws = [Quaternion(pose["rotation"]).yaw_pitch_roll[0] for pose in poses]
    np.testing.assert_allclose(index.track_yaw_rad[track], yaws, atol=1e-12)


def calibration(nusc: NuScenes, frame: Row) -> Row:
    record: Row = nusc.get("calibrated_sensor", frame["calibrated_sensor_token"])
    return record


def check_pose(ours: np.ndarray, record: Row) -> None:
    theirs = transform_matrix(record["translation"], Quaternion(record["rotation"]))
    np.testing.assert_allclose(ours, theirs, atol=1e-12)


@pytest.mark.parametrize("order", [as_written, shuffled])
def test_the_keyframe_is_the_nearest_in_time(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    caplog: pytest.LogCaptureFixture,
    order: Callable[[list[Row]], list[Row]],
) -> None:
    monkeypatch.setenv("SHOOT_CACHE", str(tmp_path / "cache"))
    root = write_tiny(tmp_path / "data", (TRAIN_A, VAL), cameras=CAMERAS[:2], image_hw=(36, 64))
    before = load_index(root, VERSION, CAMERAS[:2])
    assert not len(before.warning_text)
    assert not caplog.records
    rows = [row | {"is_key_frame": True} for row in read_table(root, "sample_data")]
    # Images between keyframes, too, of which each says that it is one.
    images = [row for row in rows if "CAM" in row["filename"]]
    late = [
        row | {"token": row["token"] + "-late", "timestamp": row["timestamp"] + 200_000}
        for row in images
    ]
    write_table(root, "sample_data", order([*rows, *late]))
    for _ in range(2):  # made, and from the cache
        caplog.clear()
        after = load_index(root, VERSION, CAMERAS[:2])
        np.testing.assert_array_equal(after.time_s, before.time_s)
        np.testing.assert_array_equal(after.global_from_ego, before.global_from_ego)
        np.testing.assert_array_equal(after.lidar_path, before.lidar_path)
        np.testing.assert_array_equal(after.camera_time_s, before.camera_time_s)
        assert after.warning_reason.tolist() == ["several keyframes"]
        assert after.warning_text[0].startswith("34 of 34 samples, the first 'scene-0001-00'")
        assert [
            record.getMessage() for record in caplog.records if record.levelname == "WARNING"
        ] == [f"{after.warning_text[0]}."]


def test_unused_records_may_dangle(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    # A part of a data set, as people make it: a radar with neither poses nor a sensor.
    monkeypatch.setenv("SHOOT_CACHE", str(tmp_path / "cache"))
    root = write_tiny(tmp_path / "data", (TRAIN_A,), cameras=CAMERAS[:2], image_hw=(36, 64))
    before = load_index(root, VERSION, CAMERAS[:1])
    lost = {"ego_pose_token": "lost", "is_key_frame": 0}
    frames = read_table(root, "sample_data")
    other = next(f for f in frames if f["filename"].startswith(f"samples/{CAMERAS[1]}"))
    write_table(root, "sample_data", [*frames, other | lost])
    calibrations = read_table(root, "calibrated_sensor")
    unused = {"token": "unused", "sensor_token": "lost", "rotation": [0, 0, 0, 0]}
    write_table(root, "calibrated_sensor", [*calibrations, calibrations[0] | unused])
    after = load_index(root, VERSION, CAMERAS[:1])
    np.testing.assert_array_equal(after.track_xy_m, before.track_xy_m)
    np.testing.assert_array_equal(after.image_path, before.image_path)
