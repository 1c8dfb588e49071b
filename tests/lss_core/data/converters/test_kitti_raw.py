"""KITTI raw: what is known of a drive comes out of the converted tables."""

from pathlib import Path

import numpy as np
import pytest
from filmed_drive import FilmedDrive
from kitti_raw_layout import (
    DATE,
    HEIGHT,
    IMU_IN_EGO_M,
    LATE_S,
    WIDTH,
    ego_from_camera,
    ego_from_velo,
    intrinsics,
    rigid,
    stream_s,
    write_kitti_raw,
)
from world_fixture import Said, command, complaint

from lss_core.data.samples import SampleIndex, load_index, rows_of_split
from lss_core.data.sensors.lidar import load_sweep
from lss_core.geometry import FloatArray, apply

VERSION = "v1.0-trainval"
CAMERAS = ("CAM_FRONT", "CAM_FRONT_STEREO")
DRIVES = {"0001": FilmedDrive(7.0), "0005": FilmedDrive(6.5, bend_radpm=-0.02)}


def convert(src: Path, out: Path, *more: object) -> Said:
    return command("shoot-convert", "kitti-raw", src, "--out", out, *more)


@pytest.fixture(scope="module")
def src(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_kitti_raw(tmp_path_factory.mktemp("kitti-raw"), DRIVES, lidar=True)


@pytest.fixture(scope="module")
def root(src: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("of-kitti-raw") / "data"
    said = convert(src, out)
    assert said.status == 0, said.err
    return out


@pytest.fixture(scope="module")
def index(root: Path) -> SampleIndex:
    return load_index(root, VERSION, CAMERAS)


def as_converted(drive: FilmedDrive, time_s: FloatArray | float) -> FloatArray:
    """The car, seen from where its GPS was at first."""
    poses = drive.world_from_ego(time_s).copy()
    first = drive.world_from_ego(0.0) @ rigid(np.eye(3), IMU_IN_EGO_M)
    poses[..., :3, 3] -= first[:3, 3]
    return poses


def test_drives_become_scenes_and_splits(index: SampleIndex, root: Path) -> None:
    assert index.scene_name.tolist() == [f"{DATE}_drive_{n}-00" for n in DRIVES]
    train, val = (rows_of_split(index, root, VERSION, split) for split in ("train", "val"))
    assert set(index.sample_scene[train]) == {0}
    assert set(index.sample_scene[val]) == {1}
    assert np.diff(index.time_s[train]) == pytest.approx(0.5, abs=1e-5)
    assert index.has_camera.all()
    assert not index.scene_problem.any()
    assert not index.camera_problem.any()


def test_the_car_is_where_it_was_at_its_poses_and_at_its_images(index: SampleIndex) -> None:
    for scene, drive in enumerate(DRIVES.values()):
        track = index.track(scene)
        # Poses of images are a part of the path, too.
        time_s = index.track_time_s[track] - index.track_time_s[track][0]
        oxts_s = stream_s(drive, "oxts")
        assert np.abs(time_s[:, None] - oxts_s).min(axis=0) == pytest.approx(0.0, abs=2e-6)
        # A chord of 0.1 s lies a few millimetres within a bend.
        wanted = as_converted(drive, time_s)
        assert index.global_from_track[track] == pytest.approx(wanted, abs=5e-3)
        rows = np.flatnonzero(index.sample_scene == scene)
        for camera, number in enumerate(("02", "03")):
            taken_s = LATE_S[f"image_{number}"] + 0.5 * np.arange(len(rows))
            begin_s = index.track_time_s[track][0]
            assert index.camera_time_s[rows, camera] - begin_s == pytest.approx(taken_s, abs=2e-6)
            wanted = as_converted(drive, taken_s)
            assert index.global_from_egocam[rows, camera] == pytest.approx(wanted, abs=5e-3)


def test_cameras_are_where_calibration_puts_them(index: SampleIndex, src: Path) -> None:
    for camera, number in enumerate(("02", "03")):
        mounting = index.egocam_from_camera[0, camera]
        assert mounting == pytest.approx(ego_from_camera(number), abs=1e-6)
        assert index.rawpixel_from_camera[0, camera] == pytest.approx(intrinsics(), abs=1e-6)
        assert index.image_hw[0, camera].tolist() == [HEIGHT, WIDTH]
    # 1.08 m ahead of the GPS, which is 0.05 m behind the axle; the right camera to the right.
    left, right = index.egocam_from_camera[0, :, :3, 3]
    assert left == pytest.approx([1.03, 0.06, 1.65], abs=0.03)
    assert left[1] - right[1] == pytest.approx(0.53, abs=0.01)


def test_images_are_those_of_the_moment(index: SampleIndex, root: Path, src: Path) -> None:
    image = root / str(index.image_path[3, 1])
    folder = src / DATE / f"{DATE}_drive_0001_sync" / "image_03" / "data"
    assert image.samefile(folder / "0000000015.png")


def test_sweeps_come_with_their_times_and_brightness(src: Path, tmp_path: Path) -> None:
    said = convert(src, tmp_path / "data", "--lidar", "--val", f"{DATE}_drive_0001")
    assert said.status == 0, said.err
    index = load_index(tmp_path / "data", VERSION, CAMERAS)
    drive = DRIVES["0001"]
    track = index.track(0)
    late_s = LATE_S["velodyne_points"]
    swept_s = stream_s(drive, "velodyne_points")
    assert np.diff(index.track_time_s[track]) == pytest.approx(0.1, abs=2e-6)
    wanted = as_converted(drive, swept_s[: track.stop - track.start])
    assert index.global_from_track[track] == pytest.approx(wanted, abs=5e-3)
    # The sweep of the second keyframe is the sixth of all.
    points = load_sweep(index, tmp_path / "data", 1)
    assert points[0] == pytest.approx(apply(ego_from_velo(), np.array([8.0, 6.0, -1.7])), abs=1e-5)
    raw = np.fromfile(tmp_path / "data" / str(index.lidar_path[1]), dtype=np.float32)
    assert raw.reshape(-1, 5)[:, 3].tolist() == [63.75, 255.0]
    # Images are a little before the sweep.
    assert index.camera_time_s[0, 0] - index.time_s[0] == pytest.approx(0.013 - late_s, abs=2e-6)


def test_a_killed_call_is_gone_on_with(src: Path, root: Path, tmp_path: Path) -> None:
    said = convert(src, tmp_path / "data")
    assert said.status == 0
    # What a call that was killed before the tables leaves.
    (tmp_path / "data" / VERSION).rename(tmp_path / "gone")
    (image, *_) = sorted((tmp_path / "data" / "samples" / "CAM_FRONT").iterdir())
    image.unlink()
    assert convert(src, tmp_path / "data").status == 0
    for table in (root / VERSION).iterdir():
        assert (tmp_path / "data" / VERSION / table.name).read_bytes() == table.read_bytes()
    assert image.exists()
    assert "is there already" in complaint(convert(src, tmp_path / "data"))


@pytest.mark.parametrize(
    ("file", "content", "named"),
    [
        ("image_02/timestamps.txt", "2011-09-26 13:02:25.594360375\n", "0000000064.png"),
        ("image_02/timestamps.txt", "monday\n", "2011_09_26_drive_0005"),
        ("oxts/data/0000000003.txt", "49.0 8.4\n", "2011_09_26_drive_0005"),
        ("../calib_imu_to_velo.txt", "R: 1 0 0\n", "2011_09_26_drive_0005"),
        ("../calib_cam_to_cam.txt", "", "2011_09_26_drive_0005"),
        ("image_02/data/0000000005.png", "no picture", "0000000005.png"),
        ("oxts/timestamps.txt", None, "oxts/timestamps.txt"),
    ],
)
def test_what_is_not_as_kittis_ends_in_a_sentence(
    file: str, content: str | None, named: str, tmp_path: Path
) -> None:
    src = write_kitti_raw(tmp_path / "src", {"0005": DRIVES["0005"]})
    path = src / DATE / f"{DATE}_drive_0005_sync" / file
    path.unlink()
    if content is not None:
        path.write_text(content)
    assert named in complaint(convert(src, tmp_path / "data"))
    assert not (tmp_path / "data" / VERSION).exists()


def test_another_folder_is_said_to_be_another(tmp_path: Path) -> None:
    assert "2011_09_26_drive_0001_sync" in complaint(convert(tmp_path, tmp_path / "data"))


def test_validation_is_of_drives_that_are_there(src: Path, tmp_path: Path) -> None:
    said = convert(src, tmp_path / "data", "--val", "0005")
    assert "'0005'" in complaint(said)
    assert f"{DATE}_drive_0005" in complaint(said)
