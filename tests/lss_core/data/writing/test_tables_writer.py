"""Recordings to tables: what is put in comes out of the index."""

import math
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from nuscenes.nuscenes import NuScenes
from recorded_ride import (
    AHEAD,
    HEIGHT,
    INTRINSICS,
    TIMES_S,
    VERSION,
    WIDTH,
    add_ride,
    arc,
    write_images,
)

from lss_core.data import TablesWriter
from lss_core.data.annotations.boxes import read_boxes
from lss_core.data.samples import load_index, rows_of_split
from lss_core.data.sensors.lidar import load_scans, load_sweep
from lss_core.errors import DataError
from lss_core.geometry import quaternion_of, rigid_from_quaternion, rigid_from_yaw


@pytest.fixture
def images(tmp_path: Path) -> list[Path]:
    """One for each of `KEYFRAMES`."""
    return write_images(tmp_path / "recorded")


def test_what_is_put_in_comes_out(images: list[Path], tmp_path: Path) -> None:
    writer = TablesWriter(tmp_path / "data")
    add_ride(writer, "a", images, log="drive", location="town", description="Rain")
    add_ride(writer, "b", images, log="drive", location="town")
    folder = writer.write({"train": ["a"], "val": ["b"]})
    assert folder == tmp_path / "data" / VERSION
    index = load_index(tmp_path / "data", VERSION, ("FRONT",))
    assert index.scene_name.tolist() == ["a", "b"]
    assert index.scene_description.tolist() == ["Rain", ""]
    assert index.scene_location.tolist() == ["town", "town"]
    assert index.scene_log[0] == index.scene_log[1]
    assert index.time_s[: len(images)] == pytest.approx(TIMES_S[::5], abs=1e-6)
    assert index.global_from_ego[: len(images)] == pytest.approx(arc()[::5], abs=1e-8)
    track = index.track(1)
    assert index.global_from_track[track] == pytest.approx(arc(), abs=1e-8)
    assert index.egocam_from_camera[3, 0] == pytest.approx(AHEAD)
    assert index.rawpixel_from_camera[3, 0].tolist() == INTRINSICS
    assert index.image_hw[3, 0].tolist() == [HEIGHT, WIDTH]
    assert (tmp_path / "data" / str(index.image_path[3, 0])).samefile(images[3])
    assert not index.scene_problem.any()
    assert not index.camera_problem.any()
    assert index.sample_scene[rows_of_split(index, tmp_path / "data", VERSION, "val")].min() == 1


def test_images_between_poses_get_a_pose_between(images: list[Path], tmp_path: Path) -> None:
    writer = TablesWriter(tmp_path / "data")
    rough = TIMES_S[::5]
    scene = writer.add_scene("a", rough, arc()[::5])
    for channel in ("FRONT", "LEFT"):
        scene.add_camera(channel, INTRINSICS, AHEAD, (HEIGHT, WIDTH))
    scene.add_keyframe(
        rough[0] + 1.25, {"FRONT": images[0], "LEFT": images[1]}, {"LEFT": rough[0] + 1.3}
    )
    writer.write({"train": ["a"]})
    index = load_index(tmp_path / "data", VERSION, ("FRONT", "LEFT"))
    assert index.time_s[0] - rough[0] == pytest.approx(1.25, abs=1e-6)
    assert index.camera_time_s[0] - rough[0] == pytest.approx([1.25, 1.3], abs=1e-6)
    # Chords of 2.5 m on a circle of 50 m stay within 2 cm of it.
    wanted = arc(np.array([rough[0], rough[0] + 1.25, rough[0] + 1.3]))[1:]
    assert index.global_from_ego[0] == pytest.approx(wanted[0], abs=0.02)
    assert index.global_from_egocam[0] == pytest.approx(wanted, abs=0.02)


def test_lidar_and_boxes(images: list[Path], tmp_path: Path) -> None:
    root = tmp_path / "data"
    writer = TablesWriter(root)
    scene = writer.add_scene("a", TIMES_S, arc())
    ego_from_lidar = rigid_from_yaw(np.array([1.0, 0.0]), -math.pi / 2)
    ego_from_lidar[2, 3] = 1.8
    scene.add_camera("FRONT", INTRINSICS, AHEAD, (HEIGHT, WIDTH))
    scene.add_lidar(ego_from_lidar)
    points = np.array([[3.0, 4.0, -1.8, 20.0], [0.0, 10.0, 0.0, 250.0]])
    for row, time_s in enumerate(TIMES_S):
        if row % 5:
            scene.add_sweep(time_s, points + np.array([0, 0, 0, 0.01 * row]))
        else:
            scene.add_keyframe(time_s, {"FRONT": images[row // 5]}, sweep=points)
    for row in (10, 5):
        global_from_box = arc()[row] @ rigid_from_yaw(np.array([8.0, 3.0]), 0.5)
        scene.add_box(TIMES_S[row], "car-1", "vehicle.car", (4.0, 1.8, 1.5), global_from_box)
    writer.write({"train": ["a"]})
    index = load_index(root, VERSION, ("FRONT",))
    # The lidar's y axis looks along the car's x.
    assert load_sweep(index, root, 2)[0] == pytest.approx([1.0 + 4.0, -3.0, 0.0], abs=1e-6)
    scans = load_scans(index, root, 2, 2)
    assert scans[:, 3].tolist() == pytest.approx([20.0, 250.0, 20.09, 250.09], abs=1e-3)
    assert scans[:, 4] == pytest.approx([0.0, 0.0, 0.1, 0.1], abs=1e-5)
    assert index.track_time_s == pytest.approx(TIMES_S, abs=1e-6)
    boxes = read_boxes(root / VERSION, index, np.array([0]))
    assert boxes.category.tolist() == ["vehicle.car"]
    assert boxes.size_m.tolist() == [[4.0, 1.8]]
    assert boxes.time_s == pytest.approx(TIMES_S[[5, 10]], abs=1e-6)
    wanted = arc()[5] @ rigid_from_yaw(np.array([8.0, 3.0]), 0.5)
    assert boxes.xy_m[0] == pytest.approx(wanted[:2, 3])
    assert boxes.yaw_rad[0] == pytest.approx(0.3 + 0.1 * 0.5 + 0.5)
    devkit = NuScenes(VERSION, str(root), verbose=False)
    sample = devkit.sample[1]
    path, seen, _ = devkit.get_sample_data(sample["data"]["LIDAR_TOP"])
    assert np.fromfile(path, dtype=np.float32).reshape(-1, 5)[0].tolist() == pytest.approx(
        [3.0, 4.0, -1.8, 20.0, 0.0]
    )
    (box,) = seen
    assert box.wlh.tolist() == [1.8, 4.0, 1.5]
    # 8 m ahead of the ego and 3 m to its left; the lidar lies 1 m ahead, and its y points ahead.
    assert box.center == pytest.approx([-3.0, 7.0, -1.8], abs=1e-6)
    assert devkit.get("sensor", devkit.sensor[-1]["token"])["modality"] == "lidar"


def test_the_same_recording_gives_the_same_bytes(images: list[Path], tmp_path: Path) -> None:
    for name in ("one", "other"):
        writer = TablesWriter(tmp_path / name)
        add_ride(writer, "a", images)
        writer.write({"train": ["a"]})
    tables = sorted(path.name for path in (tmp_path / "one" / VERSION).iterdir())
    assert len(tables) == 14
    for table in tables:
        one, other = (tmp_path / name / VERSION / table for name in ("one", "other"))
        assert one.read_bytes() == other.read_bytes()


def test_files_inside_the_data_set_stay_where_they_are(tmp_path: Path, images: list[Path]) -> None:
    images[0].parent.rename(tmp_path / "data")
    moved = [tmp_path / "data" / image.name for image in images]
    writer = TablesWriter(tmp_path / "data")
    add_ride(writer, "a", moved)
    writer.write({"train": ["a"]})
    index = load_index(tmp_path / "data", VERSION, ("FRONT",))
    assert index.image_path[:, 0].tolist() == [image.name for image in images]
    assert not (tmp_path / "data" / "samples").exists()


def test_files_that_cannot_be_linked_are_copied(
    images: list[Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def no_links(path: Path, target: Path) -> None:
        raise OSError(18, "Invalid cross-device link", str(path))

    monkeypatch.setattr(Path, "hardlink_to", no_links)
    for attempt in range(2):  # the second finds the copies
        writer = TablesWriter(tmp_path / "data", f"v{attempt}")
        add_ride(writer, "a", images)
        writer.write({"train": ["a"]})
    copy = next((tmp_path / "data" / "samples" / "FRONT").glob("*.png"))
    assert copy.stat().st_nlink == 1
    assert copy.read_bytes() in [image.read_bytes() for image in images]


def test_nothing_is_overwritten(images: list[Path], tmp_path: Path) -> None:
    writer = TablesWriter(tmp_path / "data")
    add_ride(writer, "a", images)
    writer.write({"train": ["a"]})
    with pytest.raises(DataError, match="is there already"):
        TablesWriter(tmp_path / "data")
    with pytest.raises(DataError, match="differs from"):
        add_ride(TablesWriter(tmp_path / "data", "v2"), "a", images[::-1])


def test_tables_appear_whole_or_not_at_all(
    images: list[Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    writer = TablesWriter(tmp_path / "data")
    add_ride(writer, "a", images)
    replace, calls = Path.replace, []

    def fail_late(path: Path, target: Path) -> Path:
        calls.append(target)
        if len(calls) > 9:
            raise OSError(28, "No space left on device", str(target))
        return replace(path, target)

    with monkeypatch.context() as patch:
        patch.setattr(Path, "replace", fail_late)
        with pytest.raises(OSError, match="No space"):
            writer.write({"train": ["a"]})
    assert len(calls) == 10
    assert sorted(path.name for path in (tmp_path / "data").iterdir()) == ["maps", "samples"]
    writer.write({"train": ["a"]})
    load_index(tmp_path / "data", VERSION, ("FRONT",))


def test_quaternions_there_and_back() -> None:
    rng = np.random.default_rng(2)
    quaternions = rng.normal(size=(20, 4))
    quaternions /= np.linalg.norm(quaternions, axis=-1, keepdims=True)
    matrices = rigid_from_quaternion(np.zeros((20, 3)), quaternions)
    back = quaternion_of(matrices)
    assert (back[:, 0] >= 0.0).all()
    assert back == pytest.approx(quaternions * np.sign(quaternions[:, :1]))
    assert quaternion_of(matrices[3]) == pytest.approx(back[3])


def test_reading_does_not_load_the_writer() -> None:
    code = "import sys, lss_core.data.splits; print(sorted(m for m in sys.modules if 'lss' in m))"
    loaded = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, check=True, text=True
    )
    assert "lss_core.data.splits" in loaded.stdout
    assert "writer" not in loaded.stdout
