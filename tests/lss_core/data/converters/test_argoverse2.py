"""Argoverse 2: what is known of a log comes out of the converted tables."""

from pathlib import Path

import numpy as np
import pytest
from argoverse2_layout import (
    AHEAD_M,
    AXLE_HEIGHT_M,
    IMAGE_HW,
    LATE_S,
    LOOKS,
    OTHER_HW,
    UP_LIDAR,
    ego_from_camera,
    intrinsics,
    seconds,
    stream_ns,
    write_log,
)
from filmed_drive import FilmedDrive
from world_fixture import Said, command, complaint

from lss_core.data.annotations.boxes import read_boxes
from lss_core.data.samples import SampleIndex, load_index, rows_of_split
from lss_core.data.sensors.lidar import load_sweep

VERSION = "v1.0-trainval"
CAMERAS = tuple(LOOKS)
LOGS = {
    "train/0c61aea3-3cba-35f3-8971-df42cd5b9b1a": FilmedDrive(6.5),
    "val/02678d04-cc9f-3148-9f95-1ba66347dff9": FilmedDrive(7.0, bend_radpm=-0.025),
}


def convert(src: Path, out: Path, *more: object) -> Said:
    return command("shoot-convert", "argoverse2", src, "--out", out, *more)


@pytest.fixture(scope="module")
def src(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("argoverse")
    for name, drive in LOGS.items():
        write_log(folder / name, drive, lidar=True)
    return folder


@pytest.fixture(scope="module")
def root(src: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("of-argoverse") / "data"
    said = convert(src, out)
    assert said.status == 0, said.err
    return out


@pytest.fixture(scope="module")
def index(root: Path) -> SampleIndex:
    return load_index(root, VERSION, CAMERAS)


def time_s_of(index: SampleIndex, time_s: np.ndarray) -> np.ndarray:
    """From a log's begin, to a microsecond."""
    return seconds(np.round(time_s * 1e6).astype(np.int64) * 1000)


def test_publishers_splits_hold(index: SampleIndex, root: Path) -> None:
    assert index.scene_name.tolist() == [f"{Path(name).name}-00" for name in LOGS]
    train, val = (rows_of_split(index, root, VERSION, split) for split in ("train", "val"))
    assert set(index.sample_scene[train]) == {0}
    assert set(index.sample_scene[val]) == {1}
    assert not index.scene_problem.any()
    assert not index.camera_problem.any()
    assert index.has_camera.all()


def test_the_car_is_where_it_was_on_the_road(index: SampleIndex) -> None:
    for scene, drive in enumerate(LOGS.values()):
        track = index.track(scene)
        time_s = time_s_of(index, index.track_time_s[track])
        wanted = drive.world_from_ego(time_s)
        assert index.global_from_track[track] == pytest.approx(wanted, abs=2e-3)
        rows = np.flatnonzero(index.sample_scene == scene)
        # Keyframes are at annotated moments, which are those of sweeps.
        moments_s = time_s_of(index, index.time_s[rows])
        assert moments_s == pytest.approx(LATE_S["lidar"] + 0.5 * np.arange(len(rows)), abs=2e-6)
        for camera, name in enumerate(CAMERAS):
            taken_s = time_s_of(index, index.camera_time_s[rows, camera])
            assert np.abs(taken_s - moments_s).max() <= 0.025 + 1e-6
            frames_s = seconds(stream_ns(drive, name))
            assert np.abs(taken_s[:, None] - frames_s).min(axis=1).max() < 2e-6
            wanted = drive.world_from_ego(taken_s)
            assert index.global_from_egocam[rows, camera] == pytest.approx(wanted, abs=2e-3)


def test_cameras_are_where_calibration_puts_them_above_the_road(index: SampleIndex) -> None:
    for camera, name in enumerate(CAMERAS):
        assert index.egocam_from_camera[0, camera] == pytest.approx(ego_from_camera(name))
        assert index.rawpixel_from_camera[0, camera] == pytest.approx(intrinsics(name))
        wanted = IMAGE_HW.get(name, OTHER_HW)
        assert tuple(index.image_hw[0, camera].tolist()) == wanted
    assert index.egocam_from_camera[0, 0, 2, 3] == pytest.approx(1.05 + 0.33)


def test_boxes_stand_where_they_were_seen(index: SampleIndex, root: Path) -> None:
    boxes = read_boxes(root / VERSION, index, np.array([0]))
    assert set(boxes.category.tolist()) == {"REGULAR_VEHICLE"}
    rows = np.flatnonzero(index.sample_scene == 0)
    drive = next(iter(LOGS.values()))
    poses = drive.world_from_ego(time_s_of(index, index.time_s[rows]))
    wanted = poses @ np.array([*AHEAD_M[:2], AHEAD_M[2] + AXLE_HEIGHT_M, 1.0])
    assert boxes.xy_m[np.argsort(boxes.time_s)] == pytest.approx(wanted[:, :2], abs=2e-3)
    assert boxes.size_m[0].tolist() == [4.5, 1.9]


def test_sweeps_are_seen_from_the_upper_lidar(src: Path, tmp_path: Path) -> None:
    (name, drive) = list(LOGS.items())[1]
    said = convert(src / "val", tmp_path / "data", "--lidar")
    assert said.status == 0, said.err
    index = load_index(tmp_path / "data", VERSION, CAMERAS)
    assert index.scene_name.tolist() == [f"{Path(name).name}-00"]
    time_s = time_s_of(index, index.track_time_s[index.track(0)])
    assert time_s == pytest.approx(seconds(stream_ns(drive, "lidar")), abs=2e-6)
    assert index.ego_from_lidar[0, :3, 3] == pytest.approx(
        [UP_LIDAR[0], UP_LIDAR[1], UP_LIDAR[2] + AXLE_HEIGHT_M]
    )
    points = load_sweep(index, tmp_path / "data", 1)
    assert points == pytest.approx(
        np.array([[9.0, 1.25, -0.25 + AXLE_HEIGHT_M], [0.5, 7.0, 1.5 + AXLE_HEIGHT_M]]), abs=1e-5
    )
    raw = np.fromfile(tmp_path / "data" / str(index.lidar_path[1]), dtype=np.float32)
    assert raw.reshape(-1, 5)[:, 3:].tolist() == [[17.0, 3.0], [255.0, 40.0]]


def test_without_boxes_and_splits_a_camera_sets_the_moments(tmp_path: Path) -> None:
    drive = FilmedDrive(2.0)
    for name in ("a", "b"):
        write_log(tmp_path / "src" / name, drive, boxes=False)
    said = convert(tmp_path / "src", tmp_path / "data", "--val", "a")
    assert said.status == 0, said.err
    index = load_index(tmp_path / "data", VERSION, CAMERAS)
    assert time_s_of(index, index.time_s[:2]) == pytest.approx([0.031, 0.531], abs=2e-6)
    val = rows_of_split(index, tmp_path / "data", VERSION, "val")
    assert index.scene_name[index.sample_scene[val[0]]] == "a-00"


@pytest.mark.parametrize(
    ("file", "content", "named"),
    [
        ("city_SE3_egovehicle.feather", b"PAR1", "'a' cannot be read"),
        ("calibration/intrinsics.feather", None, "intrinsics.feather"),
        ("annotations.feather", b"", "'a' cannot be read"),
        ("sensors/cameras/ring_front_left/315967376903506000.jpg", b"GIF", "315967376903506000"),
        ("sensors/cameras/ring_front_left/first.jpg", b"GIF", "'a' cannot be read"),
    ],
)
def test_what_is_not_as_argoverses_ends_in_a_sentence(
    file: str, content: bytes | None, named: str, tmp_path: Path
) -> None:
    folder = write_log(tmp_path / "src" / "a", FilmedDrive(1.0))
    (folder / file).unlink(missing_ok=True)
    if content is not None:
        (folder / file).write_bytes(content)
    assert named in complaint(convert(tmp_path / "src", tmp_path / "data"))
    assert not (tmp_path / "data" / VERSION).exists()


def test_another_folder_is_said_to_be_another(tmp_path: Path) -> None:
    assert "city_SE3_egovehicle.feather" in complaint(convert(tmp_path, tmp_path / "data"))


def test_lidar_is_asked_for_only_where_it_is(tmp_path: Path) -> None:
    write_log(tmp_path / "src" / "a", FilmedDrive(1.0))
    said = convert(tmp_path / "src", tmp_path / "data", "--lidar")
    assert "leave out --lidar" in complaint(said)
