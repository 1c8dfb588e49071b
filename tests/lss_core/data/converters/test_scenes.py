"""Drives to scenes: where they are cut, what becomes a keyframe, which split they go to."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from lss_core.data.converters.drive import CameraTrack, Drive, FoundDrive, nearest
from lss_core.data.converters.scenes import write_drives
from lss_core.data.samples import SampleIndex, load_index
from lss_core.data.splits import scenes_of_split
from lss_core.errors import DataError
from lss_core.geometry import FloatArray, rigid_from_yaw

VERSION = "v1.0-trainval"
AHEAD = np.array([[0.0, 0, 1, 1.7], [-1, 0, 0, 0.2], [0, -1, 0, 1.5], [0, 0, 0, 1]])
INTRINSICS = np.array([[25.0, 0.0, 15.0], [0.0, 25.0, 9.0], [0.0, 0.0, 1.0]])


@pytest.fixture(scope="module")
def image(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("image") / "a.png"
    rng = np.random.default_rng(0)
    Image.fromarray(rng.integers(0, 256, (18, 32, 3), dtype=np.uint8)).save(path)
    return path


def drive_of(image: Path, image_s: FloatArray, seconds: float = 8.0, start_m: float = 0.0) -> Drive:
    """A car on a circle at 5 m/s with poses ten times a second."""
    time_s = np.arange(0.0, seconds + 1e-9, 0.1)
    yaw = 0.1 * time_s
    xy_m = np.stack([start_m + 50.0 * np.sin(yaw), -50.0 * np.cos(yaw)], axis=-1)
    camera = CameraTrack(INTRINSICS, AHEAD, (18, 32), image_s, [image] * len(image_s))
    return Drive(time_s, rigid_from_yaw(xy_m, yaw), {"FRONT": camera}, image_s)


def written(drives: Sequence[FoundDrive], root: Path, val: Sequence[str] = ()) -> SampleIndex:
    assert write_drives(drives, root, val).cameras == ("FRONT",)
    return load_index(root, VERSION, ("FRONT",))


def test_the_nearest_is_the_nearest() -> None:
    times_s = np.array([0.0, 1.0, 4.0])
    assert nearest(times_s, np.array([-1.0, 0.4, 0.6, 2.4, 2.6, 9.0])).tolist() == [
        0, 0, 1, 1, 2, 2,
    ]  # fmt: skip
    assert nearest(np.array([7.0]), np.array([1.0, 8.0])).tolist() == [0, 0]


def test_long_drives_are_cut_into_scenes_that_share_no_pose(image: Path, tmp_path: Path) -> None:
    drive = drive_of(image, np.arange(0.0, 51.0, 0.5), 51.0)
    index = written([FoundDrive("a", lambda: drive)], tmp_path)
    assert index.scene_name.tolist() == ["a-00", "a-01", "a-02"]
    assert len(set(index.scene_log.tolist())) == 1
    begins, ends = zip(
        *(index.track_time_s[index.track(scene)][[0, -1]].tolist() for scene in range(3)),
        strict=True,
    )
    assert begins == pytest.approx([0.0, 17.0, 34.0])
    assert ends == pytest.approx([16.9, 33.9, 51.0])


def test_keyframes_are_every_half_second_where_there_are_images(
    image: Path, tmp_path: Path
) -> None:
    # At 8 Hz, from before the poses to after them, without those from 3 s to 4.2 s.
    image_s = np.arange(-0.3, 9.0, 0.125)
    image_s = image_s[(image_s < 3.0) | (image_s > 4.2)]
    index = written([FoundDrive("a", lambda: drive_of(image, image_s))], tmp_path)
    assert np.isin(np.round(index.time_s * 1e6), np.round(image_s * 1e6)).all()
    assert index.time_s.min() >= 0.0
    assert index.time_s.max() <= 8.0
    steps_s = np.diff(index.time_s)
    assert np.delete(steps_s, steps_s.argmax()) == pytest.approx(0.5, abs=0.1)
    assert steps_s.max() > 1.2


def test_an_image_of_another_moment_is_none_of_a_keyframe(image: Path, tmp_path: Path) -> None:
    drive = drive_of(image, np.arange(0.0, 8.0, 0.5))
    late = replace(drive.cameras["FRONT"], time_s=drive.cameras["FRONT"].time_s + 0.15)
    near = replace(drive.cameras["FRONT"], time_s=drive.cameras["FRONT"].time_s + 0.05)
    both = replace(drive, cameras={**drive.cameras, "LATE": late, "NEAR": near})
    write_drives([FoundDrive("a", lambda: both)], tmp_path)
    index = load_index(tmp_path, VERSION, ("FRONT", "LATE", "NEAR"))
    assert index.has_camera.all(axis=0).tolist() == [True, False, True]
    assert not index.has_camera[:, 1].any()
    assert index.camera_time_s[:, 2] - index.time_s == pytest.approx(0.05, abs=1e-6)


def test_clocks_that_do_not_meet_are_named(image: Path, tmp_path: Path) -> None:
    drive = drive_of(image, np.arange(1000.0, 1008.0, 0.5))
    with pytest.raises(DataError, match="'a' has no image within the time of its poses"):
        write_drives([FoundDrive("a", lambda: drive)], tmp_path)
    assert not (tmp_path / VERSION).exists()


@pytest.mark.parametrize(
    ("logs", "val", "chosen"),
    [
        ("abcdefghijkl", (), "ej"),
        ("cab", (), "c"),
        ("abc", ("a", "b"), "ab"),
        ("a", (), "a"),
    ],
)
def test_who_is_for_validation(
    logs: str, val: Sequence[str], chosen: str, image: Path, tmp_path: Path
) -> None:
    # Two parts of each log, which stay together.
    found = [
        FoundDrive(
            f"{log}{part}",
            lambda far_m=1000.0 * number: drive_of(image, np.arange(0.0, 1.0, 0.5), 1.0, far_m),
            log=log,
        )
        for number, (log, part) in enumerate((log, part) for log in logs for part in "12")
    ]
    write_drives(found, tmp_path, val)
    names = scenes_of_split(tmp_path / VERSION, "val")
    assert sorted(names) == [f"{log}{part}-00" for log in chosen for part in "12"]


def test_splits_of_publishers_hold_unless_others_are_named(image: Path, tmp_path: Path) -> None:
    found = [
        FoundDrive(
            name,
            lambda far_m=1000.0 * number: drive_of(image, np.arange(0.0, 1.0, 0.5), 1.0, far_m),
            split=split,
        )
        for number, (name, split) in enumerate((("a", "val"), ("b", "train"), ("c", "test")))
    ]
    write_drives(found, tmp_path / "theirs")
    write_drives(found, tmp_path / "ours", ["b"])
    theirs, ours = (
        {name: scenes_of_split(tmp_path / folder / VERSION, name) for name in names}
        for folder, names in (("theirs", ("train", "val", "test")), ("ours", ("train", "val")))
    )
    assert {name: list(scenes) for name, scenes in theirs.items()} == {
        "train": ["b-00"],
        "val": ["a-00"],
        "test": ["c-00"],
    }
    assert sorted(ours["train"]) == ["a-00", "c-00"]
    assert list(ours["val"]) == ["b-00"]
