"""What the index says of a data set, and what it says is wrong."""

import math
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from tiny_tables import (
    KEYFRAMES_A_SCENE,
    SWEEPS_A_SCENE,
    T0_US,
    TRAIN_A,
    TRAIN_B,
    VAL,
    VERSION,
    TinyScene,
    camera_delay_s,
    read_table,
    write_table,
    write_tiny,
)

from lss_core.config import CAMERAS
from lss_core.data.samples import SampleIndex, load_index
from lss_core.data.sensors.lidar import load_sweep
from lss_core.errors import DataError

SCENES = (TRAIN_A, TRAIN_B, VAL)


@pytest.fixture(scope="module")
def index(tiny_root: Path) -> SampleIndex:
    return load_index(tiny_root, VERSION, CAMERAS)


def test_shapes_and_names(index: SampleIndex) -> None:
    num = 3 * KEYFRAMES_A_SCENE
    assert index.cameras.tolist() == list(CAMERAS)
    assert len(index.sample_token) == num == len(set(index.sample_token))
    assert index.scene_name.tolist() == [scene.name for scene in SCENES]
    assert index.scene_location.tolist() == ["boston-seaport"] * 3
    assert index.scene_log.tolist() == [scene.name for scene in SCENES]
    assert index.track_start.tolist() == [SWEEPS_A_SCENE * i for i in range(4)]
    assert index.has_camera.all()
    assert (index.image_hw == [90, 160]).all()


def test_poses_are_those_of_the_drive(index: SampleIndex) -> None:
    for number, scene in enumerate(SCENES):
        start_s = (T0_US + number * 100_000_000) / 1e6
        track = index.track(number)
        expected = np.array([scene.pose(0.1 * i) for i in range(SWEEPS_A_SCENE)])
        np.testing.assert_allclose(index.track_xy_m[track], expected[:, :2], atol=1e-9)
        turned = index.track_yaw_rad[track] - expected[:, 2]
        np.testing.assert_allclose(np.exp(1j * turned), 1.0, atol=1e-9)
        np.testing.assert_allclose(
            index.track_time_s[track] - start_s, 0.1 * np.arange(SWEEPS_A_SCENE), atol=1e-6
        )
        own = index.sample_scene == number
        np.testing.assert_allclose(index.global_from_ego[own][:, :2, 3], expected[::5, :2])


def test_calibration_is_per_camera_and_scene_frames_compose(index: SampleIndex) -> None:
    row = index.row_of("scene-0002-03")
    for column in range(len(CAMERAS)):
        assert index.rawpixel_from_camera[row, column, 0, 0] == 0.8 * 160 + column
        mounting = index.egocam_from_camera[row, column]
        np.testing.assert_allclose(mounting[:3, 3], [1.7, 0.1 * column, 1.5])
        # The camera's z axis is where it looks, its y axis points down.
        angle = 2.0 * math.pi * column / len(CAMERAS)
        np.testing.assert_allclose(
            mounting[:3, 2], [math.cos(angle), math.sin(angle), 0.0], atol=1e-12
        )
        np.testing.assert_allclose(mounting[:3, 1], [0.0, 0.0, -1.0], atol=1e-12)
        x_m, y_m, yaw = TRAIN_B.pose(1.5 + camera_delay_s(column))
        pose = index.global_from_egocam[row, column]
        np.testing.assert_allclose(pose[:2, 3], [x_m, y_m])
        np.testing.assert_allclose(
            pose[:3, :3], Rotation.from_euler("z", yaw).as_matrix(), atol=1e-12
        )
        assert index.camera_time_s[row, column] - index.time_s[row] == pytest.approx(
            camera_delay_s(column), abs=1e-6
        )
        assert index.image_path[row, column] == f"samples/{CAMERAS[column]}/scene-0002-03.jpg"


def test_cameras_come_in_the_order_asked_for(tiny_root: Path, index: SampleIndex) -> None:
    turned = load_index(tiny_root, VERSION, CAMERAS[::-1])
    np.testing.assert_array_equal(turned.image_path[:, ::-1], index.image_path)
    np.testing.assert_array_equal(turned.rawpixel_from_camera[:, ::-1], index.rawpixel_from_camera)


def test_row_of_unknown_token(index: SampleIndex) -> None:
    assert index.sample_token[index.row_of("scene-0003-16")] == "scene-0003-16"
    with pytest.raises(DataError, match="'nobody'"):
        index.row_of("nobody")


def test_lidar_sweep_in_ego(index: SampleIndex, tiny_root: Path) -> None:
    row = index.row_of("scene-0001-02")
    raw = np.fromfile(tiny_root / str(index.lidar_path[row]), dtype=np.float32).reshape(-1, 5)
    points = load_sweep(index, tiny_root, row)
    # Mounted 1 m ahead and 1.8 m up, turned by -90 degrees: lidar x is to the right.
    expected = np.stack([raw[:, 1] + 1.0, -raw[:, 0], raw[:, 2] + 1.8], axis=-1)
    np.testing.assert_allclose(points, expected, atol=1e-5)


def test_lidar_errors(tiny_copy: Path, own_cache: Path) -> None:
    index = load_index(tiny_copy, VERSION, CAMERAS[:2])
    path = tiny_copy / str(index.lidar_path[0])
    path.write_bytes(path.read_bytes()[:-4])
    with pytest.raises(DataError, match="ends within a point"):
        load_sweep(index, tiny_copy, 0)
    path.unlink()
    with pytest.raises(DataError, match="cannot be read"):
        load_sweep(index, tiny_copy, 0)


def test_scene_without_lidar_takes_poses_from_cameras(tmp_path: Path) -> None:
    scene = TinyScene("scene-0001", has_lidar=False)
    root = write_tiny(tmp_path / "data", (scene,), cameras=CAMERAS[:2], image_hw=(36, 64))
    index = load_index(root, VERSION, CAMERAS[:2])
    assert (index.lidar_path == "").all()
    assert index.track_start.tolist() == [0, 2 * KEYFRAMES_A_SCENE]
    row = index.row_of("scene-0001-04")
    np.testing.assert_allclose(index.global_from_ego[row, :2, 3], scene.pose(2.0)[:2], atol=1e-2)
    with pytest.raises(DataError, match="has no lidar sweep"):
        load_sweep(index, root, row)


def test_camera_absent_from_a_sample_is_masked(tiny_copy: Path, own_cache: Path) -> None:
    records = read_table(tiny_copy, "sample_data")
    gone = {"scene-0001-03", "scene-0003-05"}
    kept = [
        r for r in records if not (r["sample_token"] in gone and f"/{CAMERAS[1]}/" in r["filename"])
    ]
    assert len(kept) == len(records) - 2
    write_table(tiny_copy, "sample_data", kept)
    index = load_index(tiny_copy, VERSION, CAMERAS[:2])
    assert set(index.sample_token[~index.has_camera[:, 1]]) == gone
    assert index.has_camera[:, 0].all()
    assert (index.image_path[:, 1][~index.has_camera[:, 1]] == "").all()


def test_doubled_time_stamps_count_once(tiny_copy: Path, own_cache: Path) -> None:
    before = load_index(tiny_copy, VERSION, CAMERAS[:2])
    records = read_table(tiny_copy, "sample_data")
    sweep = next(r for r in records if r["filename"].startswith("sweeps"))
    write_table(tiny_copy, "sample_data", [*records, sweep | {"token": "again"}])
    after = load_index(tiny_copy, VERSION, CAMERAS[:2])
    np.testing.assert_array_equal(after.track_time_s, before.track_time_s)


def test_unknown_camera_names_those_there(tiny_copy: Path, own_cache: Path) -> None:
    with pytest.raises(DataError, match="no sensor CAM_FORNT; it has CAM_FRONT"):
        load_index(tiny_copy, VERSION, ("CAM_FRONT", "CAM_FORNT"))


@pytest.mark.parametrize(
    ("table", "field"),
    [
        ("sample_data", "ego_pose_token"),
        ("sample_data", "calibrated_sensor_token"),
        ("sample_data", "sample_token"),
        ("calibrated_sensor", "sensor_token"),
        ("sample", "scene_token"),
        ("scene", "log_token"),
    ],
)
def test_dangling_token_is_named(tiny_copy: Path, own_cache: Path, table: str, field: str) -> None:
    records = read_table(tiny_copy, table)
    records[-1][field] = "dangling"
    write_table(tiny_copy, table, records)
    with pytest.raises(DataError, match="'dangling'"):
        load_index(tiny_copy, VERSION, CAMERAS[:2])


@pytest.mark.parametrize(
    ("table", "field", "value", "message"),
    [
        ("ego_pose", "rotation", [0.0, 0.0, 0.0, 0.0], "rotation"),
        ("ego_pose", "rotation", [1.0, 0.0, 0.0, math.nan], "rotation"),
        ("calibrated_sensor", "rotation", [0.0, 0.0, 0.0, 0.0], "rotation"),
        ("calibrated_sensor", "camera_intrinsic", [], "three rows"),
        ("calibrated_sensor", "camera_intrinsic", [[1.0, 2.0, 3.0]] * 2, "three rows"),
    ],
)
def test_bad_numbers_are_a_problem_of_what_they_belong_to(
    tiny_copy: Path, own_cache: Path, table: str, field: str, value: Any, message: str
) -> None:
    records = read_table(tiny_copy, table)
    records[-1][field] = value  # of the last scene
    write_table(tiny_copy, table, records)
    index = load_index(tiny_copy, VERSION, CAMERAS[:2])
    if table == "ego_pose":
        assert (index.scene_problem > 0).tolist() == [False, True]
        number = index.scene_problem[1]
    else:
        last_camera = np.flatnonzero(index.camera_problem[:, 1])
        np.testing.assert_array_equal(last_camera, np.flatnonzero(index.sample_scene == 1))
        assert (index.camera_problem[:, 0] == 0).all()
        number = index.camera_problem[-1, 1]
    what = index.problem(int(number)).what
    assert what.startswith(f"record '{records[-1]['token']}' of {VERSION}/{table}.json has ")
    assert message in what
    # Nothing else of the index is harmed.
    for f in fields(SampleIndex):
        if getattr(index, f.name).dtype.kind == "f":
            assert np.isfinite(getattr(index, f.name)).all()


def test_no_scene_at_all_is_refused(tiny_copy: Path, own_cache: Path) -> None:
    for table in ("scene", "sample", "sample_data"):
        write_table(tiny_copy, table, [])
    with pytest.raises(DataError, match="no scene"):
        load_index(tiny_copy, VERSION, CAMERAS[:2])


def test_scene_without_any_record_has_a_problem(tiny_copy: Path, own_cache: Path) -> None:
    kept = [r for r in read_table(tiny_copy, "sample_data") if "scene-0003" not in r["token"]]
    write_table(tiny_copy, "sample_data", kept)
    index = load_index(tiny_copy, VERSION, CAMERAS[:2])
    assert (np.bincount(index.sample_scene) == KEYFRAMES_A_SCENE).all()
    assert index.track(1) == slice(SWEEPS_A_SCENE, SWEEPS_A_SCENE)
    assert index.scene_problem[0] == 0
    problem = index.problem(int(index.scene_problem[1]))
    assert problem.reason == "scene without poses"
    assert "'token-scene-0003'" in problem.what
