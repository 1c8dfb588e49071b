"""Recordings that cannot be: each is refused in a sentence, and nothing is written."""

import json
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image
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

from lss_core.data import SceneWriter, TablesWriter
from lss_core.errors import DataError
from lss_core.geometry import FloatArray


@pytest.fixture
def images(tmp_path: Path) -> list[Path]:
    """One for each of `KEYFRAMES`."""
    return write_images(tmp_path / "recorded")


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
