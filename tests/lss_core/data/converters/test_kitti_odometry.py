"""KITTI odometry: a folder laid out as the benchmark becomes a data set to plan with."""

import csv
import re
from pathlib import Path

import numpy as np
import pytest
from kitti_odometry_layout import (
    AHEAD_M,
    BASE_M,
    CENTRE_PX,
    FOCAL_PX,
    HEIGHT,
    WIDTH,
    write_sequence,
)
from numpy.typing import NDArray
from nuscenes.nuscenes import NuScenes
from world_fixture import Said, command, train_flags

from lss_core.camera import project
from lss_core.data.dataset import ego_from_camera
from lss_core.data.samples import SampleIndex, load_index, rows_of_split
from lss_core.geometry import FloatArray, rigid_from_yaw, wrap_angle
from shoot.templates import TemplateSet
from shoot.trajectories import mine_futures

ROOT = Path(__file__).parents[4]
VERSION = "v1.0-trainval"
SECONDS = {"03": 31.0, "04": 9.0}


def motion(seconds: float, bend: float) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Times, places [T, 2] and headings of a rear axle at 10 Hz that leaves the origin along x."""
    fine_s = np.arange(0.0, seconds + 1e-9, 0.01)
    speed_mps = 6.0 + 2.0 * np.sin(0.4 * fine_s)
    yaw = np.concatenate([[0.0], np.cumsum(bend * np.cos(0.3 * fine_s) * speed_mps * 0.01)[:-1]])
    steps = 0.01 * speed_mps[:, None] * np.stack([np.cos(yaw), np.sin(yaw)], axis=-1)
    xy_m = np.concatenate([np.zeros((1, 2)), np.cumsum(steps, axis=0)[:-1]])
    return fine_s[::10], xy_m[::10], yaw[::10]


def write_noise(kitti: Path, name: str, bend: float, seed: int) -> None:
    """A sequence of that motion; its pictures are noise below a sky."""
    times_s, xy_m, yaw = motion(SECONDS[name], bend)
    rng = np.random.default_rng(seed)

    def picture(_number: int) -> NDArray[np.uint8]:
        grey = rng.integers(40, 90, (HEIGHT, WIDTH), dtype=np.uint8)
        grey[: round(CENTRE_PX[1]) + 1] += 120  # the sky
        return np.stack([grey] * 3, -1)

    write_sequence(kitti, name, times_s, rigid_from_yaw(xy_m, yaw), picture)


@pytest.fixture(scope="module")
def kitti(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("kitti")
    write_noise(folder, "03", bend=0.03, seed=0)
    write_noise(folder, "04", bend=-0.02, seed=1)
    return folder


def convert(kitti: Path, out: Path, *more: object) -> Said:
    return command("shoot-convert", "kitti-odometry", kitti, "--out", out, *more)


@pytest.fixture(scope="module")
def root(kitti: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("converted") / "data"
    said = convert(kitti, out, "--sequences", "03", "04", "--val", "04")
    assert said.status == 0, said.err
    return out


@pytest.fixture(scope="module")
def index(root: Path) -> SampleIndex:
    return load_index(root, VERSION, ("CAM_FRONT",))


def test_it_contradicts_itself_nowhere(root: Path) -> None:
    said = command("shoot-check", "--data.root", root, "--data.cameras", "CAM_FRONT")
    assert said.status == 0, said.err
    assert "warning" not in said.out.lower()


def test_a_long_sequence_becomes_scenes_and_splits(index: SampleIndex, root: Path) -> None:
    assert index.scene_name.tolist() == ["kitti-03-00", "kitti-03-01", "kitti-04-00"]
    assert index.scene_log[0] == index.scene_log[1] != index.scene_log[2]
    train, val = (rows_of_split(index, root, VERSION, split) for split in ("train", "val"))
    assert set(index.sample_scene[train]) == {0, 1}
    assert set(index.sample_scene[val]) == {2}
    assert np.diff(index.time_s[val]) == pytest.approx(0.5)
    assert index.has_camera.all()
    assert not index.scene_problem.any()
    assert not index.camera_problem.any()


def test_poses_come_back_as_the_motion_that_was_made(index: SampleIndex) -> None:
    made = [motion(SECONDS["03"], 0.03), motion(SECONDS["04"], -0.02)]
    time_s, xy_m, yaw = (np.concatenate(parts) for parts in zip(*made, strict=True))
    assert index.track_time_s == pytest.approx(time_s, abs=1e-6)
    assert index.track_xy_m == pytest.approx(xy_m, abs=1e-4)
    assert wrap_angle(index.track_yaw_rad - yaw) == pytest.approx(0.0, abs=1e-5)
    for scene in range(3):
        track = index.track(scene)
        moved = np.diff(index.track_xy_m[track], axis=0)
        course = np.arctan2(moved[:, 1], moved[:, 0])
        middle = (
            index.track_yaw_rad[track][:-1] + np.diff(np.unwrap(index.track_yaw_rad[track])) / 2
        )
        assert wrap_angle(course - middle) == pytest.approx(0.0, abs=0.01)


def test_the_road_driven_lies_below_the_horizon_in_the_middle(index: SampleIndex) -> None:
    futures = mine_futures(index, np.arange(len(index.time_s)), "keyframes")
    row = int(futures.sample[0])
    driven = np.concatenate([futures.xy_m[0], np.zeros((len(futures.xy_m[0]), 1))], axis=-1)
    mounting = ego_from_camera(index, row)[0]
    assert mounting[:3, 3] == pytest.approx([AHEAD_M, 0.0, 1.65])
    far = np.array([[1e6, 0.0, 1.65]])
    pixels, depth_m = project(
        np.concatenate([driven, far]), index.rawpixel_from_camera[row, 0], mounting
    )
    # Close by the road lies below the image's edge, further on between it and the horizon.
    assert pixels[-1] == pytest.approx(CENTRE_PX, abs=1e-3)
    seen = pixels[:-1][depth_m[:-1] > 1.65 * FOCAL_PX / (HEIGHT - CENTRE_PX[1])]
    assert len(seen) >= 8
    assert (seen[:, 1] > CENTRE_PX[1]).all()
    assert ((seen >= 0) & (seen < [WIDTH, HEIGHT])).all()
    # It bends to the left.
    assert seen[-1, 0] < CENTRE_PX[0]


def test_the_colour_camera_is_the_one_beside(kitti: Path, tmp_path: Path) -> None:
    flags = ("--sequences", "03", "04", "--val", "04", "--camera", "2")
    assert convert(kitti, tmp_path / "data", *flags).status == 0
    index = load_index(tmp_path / "data", VERSION, ("CAM_FRONT",))
    assert index.egocam_from_camera[0, 0, :3, 3] == pytest.approx([AHEAD_M, BASE_M, 1.65])
    image = tmp_path / "data" / str(index.image_path[0, 0])
    assert image.samefile(kitti / "sequences" / "03" / "image_2" / "000000.png")


def test_the_devkit_opens_it(root: Path, index: SampleIndex) -> None:
    devkit = NuScenes(VERSION, str(root), verbose=False)
    assert [scene["name"] for scene in devkit.scene] == index.scene_name.tolist()
    sample = devkit.get("sample", devkit.scene[0]["first_sample_token"])
    path, boxes, intrinsic = devkit.get_sample_data(sample["data"]["CAM_FRONT"])
    assert Path(path).is_file()
    assert boxes == []
    assert intrinsic[0] == pytest.approx([FOCAL_PX, 0.0, CENTRE_PX[0]])


def test_templates_and_a_planner_come_of_it(root: Path, tmp_path: Path) -> None:
    templates = tmp_path / "templates.npz"
    camera = ("--data.cameras", "CAM_FRONT")
    said = command(
        "shoot-fit-templates", "--data.root", root, *camera, "--out", templates, "--k", 10
    )
    assert said.status == 0, said.err
    # At 4 m/s and more, with x ahead: all futures go forward.
    assert (TemplateSet.load(templates).points[:, -1, 0] > 10.0).all()
    said = command("shoot-train", *train_flags(root, templates, tmp_path / "run", 3, 3), *camera)
    assert said.status == 0, said.err
    with (tmp_path / "run" / "metrics.csv").open() as stream:
        last = list(csv.DictReader(stream))[-1]
    assert 0.0 < float(last["train_loss"]) < 10.0
    # Both numbers are there only if images and labels of the validation sequence were read.
    assert 0.0 < float(last["val_nll"]) < 10.0
    assert float(last["val_top20"]) == 100.0


@pytest.mark.parametrize(
    ("spoil", "named"),
    [
        (lambda k: (k / "poses" / "03.txt").unlink(), "03.txt"),
        (lambda k: (k / "sequences" / "03" / "calib.txt").write_text("P2: 1 2\n"), "03"),
        (lambda k: (k / "sequences" / "03" / "times.txt").write_text("0.0\n0.1\n"), "2 times"),
        (lambda k: (k / "sequences" / "03" / "image_0" / "000005.png").write_bytes(b""), "000005"),
        (lambda k: (k / "poses" / "03.txt").write_text("1 0 0\n"), "03"),
    ],
)
def test_what_is_not_as_kittis_ends_in_a_sentence(
    spoil: object, named: str, tmp_path: Path
) -> None:
    assert callable(spoil)
    kitti = tmp_path / "kitti"
    write_noise(kitti, "04", bend=0.0, seed=3)
    (kitti / "sequences" / "04").rename(kitti / "sequences" / "03")
    (kitti / "poses" / "04.txt").rename(kitti / "poses" / "03.txt")
    spoil(kitti)
    said = convert(kitti, tmp_path / "out", "--sequences", "03", "--val", "03")
    assert said.status == 2, said.err
    assert said.err.startswith("error: ")
    assert named in said.err
    assert len(said.err.splitlines()) == 1
    assert not (tmp_path / "out" / VERSION).exists()


def test_validation_is_of_the_sequences_named(kitti: Path, tmp_path: Path) -> None:
    said = convert(kitti, tmp_path / "out", "--sequences", "03", "--val", "05")
    assert said.status == 2
    assert "05" in said.err


def test_the_converter_of_the_page_does_the_same(
    kitti: Path, root: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    text = (ROOT / "docs" / "data.md").read_text(encoding="utf-8")
    (code,) = re.findall(r"^```python\n(.*?)^```", text, re.MULTILINE | re.DOTALL)
    lines = [line for line in code.splitlines() if line and "import" not in line]
    assert len(lines) <= 20
    (tmp_path / "kitti").symlink_to(kitti)
    monkeypatch.chdir(tmp_path)
    exec(compile(code, "data.md", "exec"), {})
    own, other = (load_index(r, VERSION, ("CAM_FRONT",)) for r in (tmp_path / "data/kitti", root))
    assert own.scene_name.tolist() == ["03", "04"]
    assert own.track_xy_m == pytest.approx(other.track_xy_m, abs=1e-9)
    assert own.rawpixel_from_camera[0] == pytest.approx(other.rawpixel_from_camera[0])
    assert own.egocam_from_camera[0] == pytest.approx(other.egocam_from_camera[0])
