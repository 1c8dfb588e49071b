"""comma2k19: what is known of a segment comes out of the converted tables."""

import shutil
from pathlib import Path

import numpy as np
import pytest
from comma2k19_layout import (
    BEGIN_S,
    FRAME_S,
    IMAGE_HW,
    INTRINSICS,
    ecef_from_world,
    ego_from_camera,
    sky,
    write_segment,
)
from filmed_drive import FilmedDrive
from PIL import Image
from world_fixture import Said, command, complaint

from lss_core.data.samples import SampleIndex, load_index, rows_of_split
from lss_core.geometry import invert, wrap_angle, yaw_of

VERSION = "v1.0-trainval"
ROUTE = "b0c9d2329ad1606b|2018-08-02--08-34-47"
OTHER = "99c94dc769b5d96e|2018-11-15--13-01-02"
# On the highway: fast, and hardly any bend.
DRIVE = FilmedDrive(6.5, speed_mps=20.0, bend_radpm=0.004)
SHORT = FilmedDrive(3.0, speed_mps=20.0, bend_radpm=0.0015)


def convert(src: Path, out: Path, *more: object) -> Said:
    return command("shoot-convert", "comma2k19", src, "--out", out, *more)


@pytest.fixture(scope="module")
def src(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("comma")
    write_segment(folder / "Chunk_1" / ROUTE / "9", DRIVE)
    short = write_segment(folder / "Chunk_3" / OTHER / "2", SHORT)
    shutil.copytree(short, folder / "Chunk_1" / ROUTE / "10")
    return folder


@pytest.fixture(scope="module")
def root(src: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("of-comma") / "data"
    said = convert(src, out, "--val", OTHER)
    assert said.status == 0, said.err
    return out


@pytest.fixture(scope="module")
def index(root: Path) -> SampleIndex:
    return load_index(root, VERSION, ("CAM_FRONT",))


def test_routes_go_whole_into_a_split(index: SampleIndex, root: Path) -> None:
    name, other = ROUTE.replace("|", "_"), OTHER.replace("|", "_")
    assert index.scene_name.tolist() == [f"{name}--9-00", f"{name}--10-00", f"{other}--2-00"]
    assert index.scene_log[0] == index.scene_log[1] != index.scene_log[2]
    val = rows_of_split(index, root, VERSION, "val")
    assert set(index.sample_scene[val]) == {2}
    assert not index.scene_problem.any()
    assert not index.camera_problem.any()


def test_the_car_is_under_the_device_and_goes_where_it_looks(index: SampleIndex) -> None:
    track = index.track(0)
    time_s = index.track_time_s[track] - BEGIN_S
    assert time_s == pytest.approx(np.arange(0.0, 6.5, FRAME_S), abs=2e-6)
    poses, wanted = index.global_from_track[track], DRIVE.world_from_ego(time_s)
    # Up is up, north is north; the origin is where the device was first.
    assert np.abs(poses[:, :3, :3] - wanted[:, :3, :3]).max() < 0.01
    off_m = poses[:, :3, 3] - wanted[:, :3, 3]
    assert off_m - off_m[0] == pytest.approx(0.0, abs=0.02)
    assert wrap_angle(yaw_of(poses) - yaw_of(wanted)) == pytest.approx(0.0, abs=0.006)


def test_how_the_device_hangs_is_seen_from_how_it_moves(index: SampleIndex) -> None:
    mounting = index.egocam_from_camera[0, 0]
    assert mounting[:3, 3] == pytest.approx([1.5, 0.0, 1.22])
    turn = mounting[:3, :3].T @ ego_from_camera()[:3, :3]
    assert np.degrees(np.arccos((np.trace(turn) - 1.0) / 2.0)) < 0.4
    assert index.rawpixel_from_camera[0, 0] == pytest.approx(INTRINSICS)
    assert tuple(index.image_hw[0, 0].tolist()) == IMAGE_HW


def test_frames_are_those_of_their_times(index: SampleIndex, root: Path) -> None:
    rows = np.flatnonzero(index.sample_scene == 0)
    assert index.time_s[rows] - BEGIN_S == pytest.approx(0.5 * np.arange(13), abs=2e-6)
    for row in rows:
        with Image.open(root / str(index.image_path[row, 0])) as image:
            top = np.asarray(image)[:40]
        assert top.mean() == pytest.approx(sky(10 * int(row - rows[0]))[0], abs=3.0)


def test_what_was_decoded_is_not_decoded_again(src: Path, root: Path, tmp_path: Path) -> None:
    out = tmp_path / "data"
    (out / "samples").mkdir(parents=True)
    for folder in (root / "samples").iterdir():
        (out / "samples" / folder.name).mkdir()
        for file in folder.iterdir():
            (out / "samples" / folder.name / file.name).hardlink_to(file)
    bare = tmp_path / "src" / "Chunk_1" / ROUTE
    for number in ("9", "10"):
        (bare / number).mkdir(parents=True)
        (bare / number / "video.hevc").write_bytes(b"")
        (bare / number / "global_pose").symlink_to(src / "Chunk_1" / ROUTE / number / "global_pose")
    assert convert(tmp_path / "src", out).status == 0


@pytest.mark.parametrize(
    ("file", "content", "named"),
    [
        ("video.hevc", b"no video", "video.hevc"),
        ("global_pose/frame_times", b"no array", "frame_times"),
        ("global_pose/frame_positions", None, "frame_positions"),
    ],
)
def test_what_is_not_as_commas_ends_in_a_sentence(
    file: str, content: bytes | None, named: str, src: Path, tmp_path: Path
) -> None:
    given, folder = src / "Chunk_3" / OTHER / "2", tmp_path / "src" / OTHER / "2"
    (folder / "global_pose").mkdir(parents=True)
    for path in (given / "video.hevc", *(given / "global_pose").iterdir()):
        (folder / path.relative_to(given)).hardlink_to(path)
    (folder / file).unlink()
    if content is not None:
        (folder / file).write_bytes(content)
    assert named in complaint(convert(tmp_path / "src", tmp_path / "data"))
    assert not (tmp_path / "data" / VERSION).exists()


def test_a_route_that_never_drives_straight_is_left_out(src: Path, tmp_path: Path) -> None:
    folder = tmp_path / "src" / OTHER / "2" / "global_pose"
    folder.mkdir(parents=True)
    (folder.parent / "video.hevc").write_bytes(b"")
    given = src / "Chunk_3" / OTHER / "2" / "global_pose"
    for path in given.iterdir():
        (folder / path.name).hardlink_to(path)
    standing = np.load(given / "frame_positions")
    standing[:] = standing[0]
    (folder / "frame_positions").unlink()
    with (folder / "frame_positions").open("wb") as stream:
        np.save(stream, standing)
    assert "straight" in complaint(convert(tmp_path / "src", tmp_path / "data"))


def test_another_folder_is_said_to_be_another(tmp_path: Path) -> None:
    assert "Chunk_1" in complaint(convert(tmp_path, tmp_path / "data"))


def test_the_layout_is_on_the_earth() -> None:
    """About 6,370 km from its middle, north and west, and the way back is the way there."""
    matrix = ecef_from_world()
    assert np.linalg.norm(matrix[:3, 3]) == pytest.approx(6_370_000.0, abs=5_000.0)
    assert (np.sign(matrix[:3, 3]) == [-1, -1, 1]).all()
    assert invert(matrix) @ matrix == pytest.approx(np.eye(4), abs=1e-9)
