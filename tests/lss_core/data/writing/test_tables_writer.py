"""Recordings to tables: what is put in comes out of the index, and what cannot be stays out."""

import json
import math
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from nuscenes.nuscenes import NuScenes
from PIL import Image

from lss_core.data import SceneWriter, TablesWriter
from lss_core.data.annotations.boxes import read_boxes
from lss_core.data.samples import load_index, rows_of_split
from lss_core.data.sensors.lidar import load_scans, load_sweep
from lss_core.errors import DataError
from lss_core.geometry import FloatArray, quaternion_of, rigid_from_quaternion, rigid_from_yaw

VERSION = "v1.0-trainval"
HEIGHT, WIDTH = 18, 32
INTRINSICS = [[25.0, 0.0, 15.0], [0.0, 25.0, 9.0], [0.0, 0.0, 1.0]]
AHEAD = np.array([[0.0, 0, 1, 1.7], [-1, 0, 0, 0.2], [0, -1, 0, 1.5], [0, 0, 0, 1]])
TIMES_S = np.arange(0.0, 8.05, 0.1) + 1_600_000_000.0
KEYFRAMES = range(0, 81, 5)


def arc(times_s: FloatArray = TIMES_S, x_m: float = 600_000.0) -> FloatArray:
    """A car at 5 m/s on a circle of 50 m radius, in coordinates as large as UTM's."""
    yaw = 0.3 + 0.1 * (times_s - times_s[0])
    xy_m = np.stack([x_m + 50.0 * np.sin(yaw), 5_400_000.0 - 50.0 * np.cos(yaw)], axis=-1)
    return rigid_from_yaw(xy_m, yaw)


@pytest.fixture
def images(tmp_path: Path) -> list[Path]:
    """One for each of `KEYFRAMES`."""
    rng = np.random.default_rng(0)
    folder = tmp_path / "recorded"
    folder.mkdir()
    paths = [folder / f"{number}.png" for number in KEYFRAMES]
    for path in paths:
        Image.fromarray(rng.integers(0, 256, (HEIGHT, WIDTH, 3), dtype=np.uint8)).save(path)
    return paths


def add_ride(writer: TablesWriter, name: str, images: list[Path], **settings: Any) -> SceneWriter:
    scene = writer.add_scene(name, TIMES_S, arc(), **settings)
    scene.add_camera("FRONT", INTRINSICS, AHEAD, (HEIGHT, WIDTH))
    for row, image in zip(KEYFRAMES, images, strict=True):
        scene.add_keyframe(TIMES_S[row], {"FRONT": image})
    return scene


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


def spoilt(pose: FloatArray, row: int, column: int, value: float) -> FloatArray:
    copy = pose.copy()
    copy[..., row, column] = value
    return copy


def with_row(values: FloatArray, row: int, value: Any) -> FloatArray:
    copy = values.copy()
    copy[row] = value
    return copy


POSES_THAT_CANNOT_BE: dict[str, tuple[Any, Any, str]] = {
    "not rigid": (TIMES_S, spoilt(arc(), 0, 0, 2.0), "no rigid"),
    "mirrored": (TIMES_S, arc() @ np.diag([1.0, -1.0, 1.0, 1.0]), "mirrors"),
    "last row": (TIMES_S, spoilt(arc(), 3, 0, 0.5), "no rigid"),
    "row vectors": (TIMES_S, arc().swapaxes(-1, -2), "no rigid"),
    "no number": (TIMES_S, spoilt(arc(), 0, 3, math.nan), "finite"),
    "three rows": (TIMES_S, arc()[:, :3], "shape"),
    "fewer poses": (TIMES_S, arc()[:-1], "shape"),
    "texts": (TIMES_S, [["a"]] * len(TIMES_S), "numbers"),
    "back in time": (with_row(TIMES_S, 7, TIMES_S[3]), arc(), "increase"),
    "twice at once": (with_row(TIMES_S, 7, TIMES_S[6]), arc(), "increase"),
    "nanoseconds": (TIMES_S * 1e9, arc(), "seconds"),
    "microseconds": (TIMES_S * 1e6, arc(), "seconds"),
    "a gap": (np.where(TIMES_S[40] < TIMES_S, TIMES_S + 9.0, TIMES_S), arc(), "apart"),
    "a leap": (TIMES_S, with_row(arc(), 9, arc(x_m=0.0)[9]), "apart"),
    "too far": (TIMES_S, spoilt(arc(), 0, 3, 1e12), "translation"),
    "one pose": (TIMES_S[:1], arc()[:1], "two or more"),
}


@pytest.mark.parametrize("case", POSES_THAT_CANNOT_BE)
def test_poses_that_cannot_be(case: str, tmp_path: Path) -> None:
    times_s, poses, named = POSES_THAT_CANNOT_BE[case]
    with pytest.raises(DataError, match=named) as refused:
        TablesWriter(tmp_path).add_scene("the-scene", times_s, poses)
    assert "the-scene" in refused.value.sentence


CAMERAS_THAT_CANNOT_BE: dict[str, tuple[Any, Any, Any, str]] = {
    "of double size": (np.array(INTRINSICS) * [[2.0], [2.0], [1.0]], AHEAD, None, "as large"),
    "of half size": (np.array(INTRINSICS) * [[0.5], [0.5], [1.0]], AHEAD, None, "as large"),
    "inverted": (INTRINSICS, np.linalg.inv(AHEAD), None, "mounting looks inverted"),
    "sides swapped": (INTRINSICS, AHEAD, (WIDTH, HEIGHT // 2), "principal point"),
    "transposed": (np.transpose(INTRINSICS), AHEAD, None, "camera_intrinsic"),
    "projection": (np.eye(4), AHEAD, None, "shape"),
    "focal length in mm": (
        [[0.05, 0.0, 15.0], [0.0, 0.05, 9.0], [0.0, 0.0, 1.0]], AHEAD, None, "degrees",
    ),
    "mirrored": (INTRINSICS, AHEAD @ np.diag([-1.0, 1.0, 1.0, 1.0]), None, "mirrors"),
    "scaled": (INTRINSICS, AHEAD * 2.0, None, "no rigid"),
    "in millimetres": (INTRINSICS, spoilt(AHEAD, 0, 3, 1700.0), None, "translation"),
    "no size": (INTRINSICS, AHEAD, (0, 32), "cannot be"),
}  # fmt: skip


@pytest.mark.parametrize("case", CAMERAS_THAT_CANNOT_BE)
def test_cameras_that_cannot_be(case: str, tmp_path: Path) -> None:
    intrinsics, mounting, size, named = CAMERAS_THAT_CANNOT_BE[case]
    scene = TablesWriter(tmp_path).add_scene("the-scene", TIMES_S, arc())
    with pytest.raises(DataError, match=named) as refused:
        scene.add_camera("FRONT", intrinsics, mounting, size or (HEIGHT, WIDTH))
    assert "FRONT" in refused.value.sentence


def test_an_off_centre_crop_is_a_camera(tmp_path: Path) -> None:
    scene = TablesWriter(tmp_path).add_scene("a", TIMES_S, arc())
    scene.add_camera("FRONT", [[25.0, 0, 15.0], [0, 25.0, 3.0], [0, 0, 1]], AHEAD, (HEIGHT, WIDTH))


START_S = float(TIMES_S[0])
ADDITIONS_THAT_CANNOT_BE: dict[str, tuple[Callable[[SceneWriter, Path], object], str]] = {
    "unknown camera": (lambda s, i: s.add_keyframe(START_S, {"BACK": i}), "BACK"),
    "image before the poses": (lambda s, i: s.add_keyframe(START_S - 0.1, {"FRONT": i}), "outside"),
    "image after the poses": (
        lambda s, i: s.add_keyframe(START_S, {"FRONT": i}, {"FRONT": START_S + 8.1}), "outside",
    ),
    "no image": (lambda s, i: s.add_keyframe(START_S, {}), "neither"),
    "missing image": (lambda s, i: s.add_keyframe(START_S, {"FRONT": i.with_name("none.png")}),
                      "none.png"),
    "sweep without lidar": (lambda s, i: s.add_sweep(START_S, np.ones((3, 4))), "lidar"),
    "box without keyframe": (
        lambda s, i: s.add_box(START_S + 0.01, "x", "vehicle.car", (4.0, 2.0, 1.5), np.eye(4)),
        "keyframe",
    ),
    "the same camera": (
        lambda s, i: s.add_camera("FRONT", INTRINSICS, AHEAD, (HEIGHT, WIDTH)), "already",
    ),
    "name of a lidar": (
        lambda s, i: s.add_camera("LIDAR_TOP", INTRINSICS, AHEAD, (HEIGHT, WIDTH)), "name",
    ),
    "name that leads out": (
        lambda s, i: s.add_camera("../x", INTRINSICS, AHEAD, (HEIGHT, WIDTH)), "name",
    ),
}  # fmt: skip


@pytest.mark.parametrize("case", ADDITIONS_THAT_CANNOT_BE)
def test_additions_that_cannot_be(case: str, images: list[Path], tmp_path: Path) -> None:
    add, named = ADDITIONS_THAT_CANNOT_BE[case]
    scene = TablesWriter(tmp_path / "data").add_scene("the-scene", TIMES_S, arc())
    scene.add_camera("FRONT", INTRINSICS, AHEAD, (HEIGHT, WIDTH))
    with pytest.raises(DataError, match=named):
        add(scene, images[0])
    assert not (tmp_path / "data").exists()


def test_images_of_another_size_or_damaged(images: list[Path], tmp_path: Path) -> None:
    scene = TablesWriter(tmp_path / "data").add_scene("a", TIMES_S, arc())
    scene.add_camera("FRONT", INTRINSICS, AHEAD, (HEIGHT, WIDTH))
    Image.new("RGB", (WIDTH, HEIGHT + 1)).save(images[0])
    with pytest.raises(DataError, match="32x19 px, expected 32x18"):
        scene.add_keyframe(START_S, {"FRONT": images[0]})
    images[1].write_bytes(images[1].read_bytes()[:-30])
    with pytest.raises(DataError, match="cut off"):
        scene.add_keyframe(START_S, {"FRONT": images[1]})


def test_keyframes_and_sweeps_in_order(images: list[Path], tmp_path: Path) -> None:
    scene = TablesWriter(tmp_path / "data").add_scene("a", TIMES_S, arc())
    scene.add_camera("FRONT", INTRINSICS, AHEAD, (HEIGHT, WIDTH))
    scene.add_lidar(np.eye(4))
    points = np.ones((3, 4))
    with pytest.raises(DataError, match="must have a sweep"):
        scene.add_keyframe(START_S, {"FRONT": images[0]})
    with pytest.raises(DataError, match=r"\[P, 4\] or \[P, 5\]"):
        scene.add_keyframe(START_S, {}, sweep=np.ones((3, 3)))
    scene.add_keyframe(START_S + 1.0, {"FRONT": images[0]}, sweep=points)
    for earlier in (0.5, 1.0):
        with pytest.raises(DataError, match="follow"):
            scene.add_keyframe(START_S + earlier, {"FRONT": images[1]}, sweep=points)
    with pytest.raises(DataError, match="two sweeps"):
        scene.add_sweep(START_S + 1.0, points)
    with pytest.raises(DataError, match="first keyframe"):
        scene.add_lidar(np.eye(4))
    ego = np.eye(4)
    scene.add_box(START_S + 1.0, "x", "vehicle.car", (4.0, 2.0, 1.5), ego)
    with pytest.raises(DataError, match="twice"):
        scene.add_box(START_S + 1.0, "x", "vehicle.car", (4.0, 2.0, 1.5), ego)
    with pytest.raises(DataError, match="sides"):
        scene.add_box(START_S + 1.0, "y", "vehicle.car", (4.0, -2.0, 1.5), ego)


@pytest.mark.parametrize(
    ("splits", "named"),
    [
        ({}, "no splits"),
        ({"train": ["a"], "val": []}, "val"),
        ({"train": ["a"], "val": ["c"]}, "'c', which was not added"),
        ({"train": ["a", "b"], "val": ["b"]}, "'b' is 2 times in splits: train, val"),
        ({"train": ["a", "a"]}, "'a' is 2 times in splits: train"),
        ({"train": "a"}, "list"),
    ],
)
def test_splits_that_cannot_be(
    splits: dict[str, Any], named: str, images: list[Path], tmp_path: Path
) -> None:
    writer = TablesWriter(tmp_path / "data")
    add_ride(writer, "a", images)
    add_ride(writer, "b", images)
    with pytest.raises(DataError, match=named):
        writer.write(splits)
    assert not (tmp_path / "data" / VERSION).exists()
    writer.write({"train": ["a"], "val": ["b"]})
    written = json.loads((tmp_path / "data" / VERSION / "splits.json").read_text())
    assert written == {"train": ["a"], "val": ["b"]}


def test_scenes_that_cannot_be(images: list[Path], tmp_path: Path) -> None:
    writer = TablesWriter(tmp_path / "data")
    add_ride(writer, "a", images, log="drive", location="town")
    with pytest.raises(DataError, match="two scenes 'a'"):
        writer.add_scene("a", TIMES_S, arc())
    with pytest.raises(DataError, match="two locations"):
        writer.add_scene("b", TIMES_S, arc(), log="drive", location="elsewhere")
    with pytest.raises(DataError, match="scene name"):
        writer.add_scene("a/b", TIMES_S, arc())
    writer.add_scene("empty", TIMES_S, arc())
    with pytest.raises(DataError, match="'empty' has no keyframe"):
        writer.write({"train": ["a"]})
    with pytest.raises(DataError, match="version name"):
        TablesWriter(tmp_path / "data", "../v1")


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
