"""What shoot-check says of data sets: known facts of made-up ones, and their mistakes."""

import json
import math
import re
import shutil
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image
from pyquaternion import Quaternion
from tiny_tables import (
    KEPT_A_SCENE,
    KEYFRAMES_A_SCENE,
    SWEEPS_A_SCENE,
    SWEEPS_KEPT_A_SCENE,
    VERSION,
    TinyScene,
    copy_tiny,
    read_table,
    write_table,
    write_tiny,
)
from world_fixture import Said, command

from lss_core.camera import field_of_view, horizon_line, project
from lss_core.config import CAMERAS, ImageConfig
from lss_core.data.samples import load_index
from lss_core.data.sensors.images import draw_pixel_map
from lss_core.geometry import apply
from shoot.data_report import format_report, survey, view_cameras
from shoot.rendering import render_calibration

SCENES = 3
HALF = math.sqrt(0.5)
Row = dict[str, Any]


def check(root: Path, *more: object) -> Said:
    return command("shoot-check", "--data.root", root, *more)


def refuse(constant: str) -> float:
    raise AssertionError(f"{constant} is no JSON")


def report_of(
    root: Path,
    out: Path,
    *more: object,
    status: int = 0,
    cameras: Sequence[str] = ("CAM_FRONT",),
) -> dict[str, Any]:
    """The saved report; the printed one is the same as report.txt."""
    said = check(root, "--out", out, "--data.cameras", *cameras, *more)
    assert said.status == status, said.out + said.err
    assert "Traceback" not in said.out + said.err
    assert (out / "report.txt").read_text().strip() in said.out
    loaded: dict[str, Any] = json.loads((out / "report.json").read_text(), parse_constant=refuse)
    return loaded


def findings(report: dict[str, Any]) -> list[tuple[str, str]]:
    return [(one["level"], one["reason"]) for one in report["findings"]]


def bad(report: dict[str, Any]) -> list[tuple[str, str]]:
    return [one for one in findings(report) if one[0] != "note"]


@pytest.fixture(scope="module")
def checked(tiny_root: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder of the report on the hand-made data set."""
    out = tmp_path_factory.mktemp("checked")
    report_of(tiny_root, out, cameras=CAMERAS)
    return out


@pytest.fixture(scope="module")
def report(checked: Path) -> dict[str, Any]:
    loaded: dict[str, Any] = json.loads((checked / "report.json").read_text())
    return loaded


@pytest.fixture
def spoilt(tiny_root: Path, tmp_path: Path) -> Path:
    """A copy that a test may damage."""
    return copy_tiny(tiny_root, tmp_path / "data")


# The hand-made data set


def test_nothing_is_found_where_nothing_is_wrong(report: dict[str, Any]) -> None:
    assert findings(report) == []


def test_scenes_and_steps(report: dict[str, Any]) -> None:
    drives = report["drives"]
    assert (drives["num_scenes"], drives["num_logs"]) == (SCENES, SCENES)
    assert drives["num_samples"] == SCENES * KEYFRAMES_A_SCENE
    assert drives["num_poses"] == SCENES * SWEEPS_A_SCENE
    assert drives["keyframe_step_s"]["most"] == pytest.approx(0.5, abs=1e-6)
    assert drives["pose_step_s"]["median"] == pytest.approx(0.1, abs=1e-6)
    assert (drives["num_gaps"], drives["first"]) == (0, "2018-07-24")
    here = {split["name"]: split["num_scenes"] for split in drives["splits"]}
    assert here == {"train": 2, "val": 1}
    assert drives["num_scenes_in_no_split"] == 0


def test_motion(report: dict[str, Any]) -> None:
    # Arcs at 3, 6 and 10 m/s, the first two of them bends, as long as each other.
    motion = report["motion"]
    speeds = [motion["speed_mps"][key] for key in ("least", "median", "most")]
    assert speeds == pytest.approx([3.0, 6.0, 10.0], abs=0.01)
    assert (motion["standing"], motion["reversing"]) == (0.0, 0.0)
    assert motion["turning"] == pytest.approx(2 / 3)
    assert motion["hours"] == pytest.approx(SCENES * 8.0 / 3600.0)
    assert motion["off_axis_deg"]["least"] == pytest.approx(0.0, abs=0.1)
    assert motion["off_axis_deg"]["most"] == pytest.approx(0.0, abs=0.1)
    assert motion["tilt_deg"]["most"] == pytest.approx(0.0, abs=1e-6)


def test_futures(report: dict[str, Any]) -> None:
    futures = report["futures"]
    assert futures["num_labels"] == SCENES * KEPT_A_SCENE
    assert futures["num_starts"] == SCENES * SWEEPS_KEPT_A_SCENE
    each = {name: KEPT_A_SCENE for name in ("straight", "left", "right")}
    assert futures["manoeuvres"] == {"standing": 0, **each}


def test_rig(report: dict[str, Any]) -> None:
    assert [camera["channel"] for camera in report["cameras"]] == list(CAMERAS)
    for column, camera in enumerate(report["cameras"]):
        assert camera["num_images"] == SCENES * KEYFRAMES_A_SCENE
        assert camera["share"] == 1.0
        assert camera["sizes"] == {"160x90": camera["num_images"]}
        assert camera["height_m"]["median"] == pytest.approx(1.5)
        turned = camera["yaw_deg"]["median"] - 60.0 * column
        assert math.remainder(turned, 360.0) == pytest.approx(0.0, abs=1e-6)
        assert camera["yaw_deg"]["most"] - camera["yaw_deg"]["least"] < 1e-6
        assert camera["pitch_deg"]["median"] == pytest.approx(0.0, abs=1e-6)
        assert camera["roll_deg"]["median"] == pytest.approx(0.0, abs=1e-6)
        half = math.degrees(math.atan(80.0 / (128.0 + column)))
        assert camera["field_deg"]["median"] == pytest.approx(2.0 * half, abs=0.01)
        centre = camera["principal_x_px"]["median"], camera["principal_y_px"]["median"]
        assert centre == (80.0, 45.0)
        assert camera["files"] == {"num_looked_at": 3, "num_there": 3, "flaws": []}
    lidar = report["lidar"]
    assert lidar["height_m"]["median"] == pytest.approx(1.8)
    assert lidar["num_keyframes"] == SCENES * KEYFRAMES_A_SCENE
    assert lidar["num_sweeps"] == SCENES * SWEEPS_A_SCENE


def test_places_and_boxes(report: dict[str, Any]) -> None:
    (place,) = report["locations"]
    assert place == {
        "name": "boston-seaport", "num_scenes": 3, "has_map": False, "on_road": None
    }  # fmt: skip
    assert report["boxes"] == []


def test_a_picture_per_camera(checked: Path) -> None:
    for camera in CAMERAS:
        with Image.open(checked / f"{camera}.png") as picture:
            picture.load()
    assert len(list(checked.glob("*.png"))) == len(CAMERAS)


def test_findings_are_printed_last(spoilt: Path) -> None:
    shutil.rmtree(spoilt / "samples" / "CAM_BACK")
    said = check(spoilt)
    assert said.status == 0, said.err
    assert said.out.strip().splitlines()[-1].startswith("warning: missing images (CAM_BACK)")


# Geometry


def turned_camera() -> np.ndarray:
    """A camera that looks left, 20 degrees down, rolled by 10 degrees to its right."""
    yaw, pitch, roll = math.radians(90.0), math.radians(-20.0), math.radians(10.0)
    forward = np.array(
        [math.cos(yaw) * math.cos(pitch), math.sin(yaw) * math.cos(pitch), math.sin(pitch)]
    )
    right = np.array([math.sin(yaw), -math.cos(yaw), 0.0])
    down = np.cross(forward, right)
    # To its right: the right side of the image goes down.
    x, y = (
        math.cos(roll) * right + math.sin(roll) * down,
        math.cos(roll) * down - math.sin(roll) * right,
    )
    ego_from_camera = np.eye(4)
    ego_from_camera[:3, :3] = np.stack([x, y, forward], axis=-1)
    ego_from_camera[:3, 3] = [1.0, 0.5, 1.6]
    return ego_from_camera


def test_level_rays_end_on_the_horizon() -> None:
    camera = np.array([[120.0, 0.0, 83.0], [0.0, 110.0, 41.0], [0.0, 0.0, 1.0]])
    ego_from_camera = turned_camera()
    across, down, constant = horizon_line(camera, ego_from_camera)
    # Far away at the camera's height, to its left and right; and on the road below that.
    far = np.array([[1.0, 30.5, 1.6], [6.0, 30.5, 1.6], [1.0, 30.5, 0.0]])
    pixels, _ = project(far, camera, ego_from_camera)
    sides = across * pixels[:, 0] + down * pixels[:, 1] + constant
    np.testing.assert_allclose(sides[:2], 0.0, atol=1e-9)
    assert sides[2] > 0.0


def test_field_of_view_reaches_the_outer_edges() -> None:
    # The axis meets the image a quarter of the way: 40 columns on the left, 120 on the right.
    camera = np.array([[40.0, 0.0, 39.5], [0.0, 40.0, 44.5], [0.0, 0.0, 1.0]])
    field = field_of_view(camera[None], np.array([160]))
    assert math.degrees(float(field[0])) == pytest.approx(45.0 + math.degrees(math.atan(3.0)))


def test_angles_of_a_turned_camera(spoilt: Path, tmp_path: Path) -> None:
    calibrations = read_table(spoilt, "calibrated_sensor")
    w, x, y, z = quaternion_of(turned_camera()[:3, :3])
    for record in calibrations:
        if record["sensor_token"] == "CAM_FRONT":
            record["rotation"] = [w, x, y, z]
    write_table(spoilt, "calibrated_sensor", calibrations)
    index = load_index(spoilt, VERSION, ("CAM_FRONT",))
    (camera,) = survey(index, spoilt, VERSION).cameras
    angles = camera.yaw_deg.median, camera.pitch_deg.median, camera.roll_deg.median
    assert angles == pytest.approx((90.0, -20.0, 10.0), abs=1e-6)


def quaternion_of(rotation: np.ndarray) -> tuple[float, float, float, float]:
    w, x, y, z = Quaternion(matrix=rotation, rtol=1e-6, atol=1e-6)
    return w, x, y, z


def test_pictures_show_path_horizon_and_crop(tiny_root: Path) -> None:
    index = load_index(tiny_root, VERSION, CAMERAS)
    config = ImageConfig()
    views = view_cameras(index, tiny_root, config)[CAMERAS[0]]
    assert len(views) == 4
    for view in views:
        assert view.driven is not None
        # What is kept of the image is where the network's own corners come from.
        pixel_map = draw_pixel_map(config, (90, 160), None, 45.0)
        height, width = pixel_map.image_hw
        kept = apply_map(pixel_map.pixel_from_rawpixel, view.kept)
        np.testing.assert_allclose(kept[0], [-0.5, -0.5], atol=1e-9)
        np.testing.assert_allclose(kept[2], [width - 0.5, height - 0.5], atol=1e-9)
    axes = render_calibration(views, CAMERAS[0]).axes[0]
    lines = {line.get_gid(): line for line in axes.lines}
    # This camera looks ahead and is level.
    np.testing.assert_allclose(lines["horizon"].get_ydata(), 45.0, atol=1e-6)
    assert (np.asarray(lines["driven"].get_ydata()) > 45.0).all()


def apply_map(matrix: np.ndarray, pixels: np.ndarray) -> np.ndarray:
    moved: np.ndarray = apply(
        np.block([[matrix, np.zeros((3, 1))], [np.zeros((1, 3)), np.ones((1, 1))]]),
        np.concatenate([pixels, np.ones((len(pixels), 1))], axis=-1),
    )[:, :2]
    return moved


# What is wrong, or not there


def test_a_calibration_that_cannot_be(spoilt: Path, tmp_path: Path) -> None:
    calibrations = read_table(spoilt, "calibrated_sensor")
    calibrations[2]["camera_intrinsic"][0][0] = -1.0
    write_table(spoilt, "calibrated_sensor", calibrations)
    report = report_of(spoilt, tmp_path / "out", status=2)
    (finding,) = report["findings"]
    assert (finding["level"], finding["reason"]) == ("error", "impossible calibration")
    assert finding["where"].startswith(f"{KEYFRAMES_A_SCENE} of ")
    assert calibrations[2]["token"] in finding["texts"][0]
    # The camera's facts are those of its other calibrations.
    heights = {camera["height_m"]["least"] for camera in report["cameras"]}
    assert heights == {1.5}


def test_the_report_comes_before_the_complaint(spoilt: Path) -> None:
    poses = read_table(spoilt, "ego_pose")
    poses[-1]["translation"][0] += 1e5
    write_table(spoilt, "ego_pose", poses)
    said = check(spoilt)
    assert said.status == 2
    assert "CAM_FRONT_LEFT" in said.out
    assert re.search(r"^error: [a-z ]+ \(1 of 3 scenes\): records? 'scene-0003-", said.out, re.M)
    (complaint,) = said.err.strip().splitlines()
    assert complaint.startswith("error: ")
    assert str(spoilt) in complaint


def test_turned_frames_show_in_the_direction_of_motion(spoilt: Path) -> None:
    poses = read_table(spoilt, "ego_pose")
    for pose in poses:
        # The heading turned by a quarter to the right: y points forward.
        w, z = pose["rotation"][0], pose["rotation"][3]
        half = math.sqrt(0.5)
        pose["rotation"] = [half * (w + z), 0.0, 0.0, half * (z - w)]
    write_table(spoilt, "ego_pose", poses)
    index = load_index(spoilt, VERSION, CAMERAS)
    angle = survey(index, spoilt, VERSION).motion.off_axis_deg
    assert angle.median == pytest.approx(90.0, abs=0.1)
    assert view_cameras(index, spoilt, ImageConfig())["CAM_FRONT"][0].driven is not None


def test_images_of_another_size(spoilt: Path, tmp_path: Path) -> None:
    for path in (spoilt / "samples" / "CAM_FRONT").glob("*.jpg"):
        Image.new("RGB", (80, 45)).save(path)
    report = report_of(spoilt, tmp_path / "out", status=2, cameras=("CAM_FRONT", "CAM_BACK"))
    (finding,) = report["findings"]
    assert (finding["level"], finding["reason"]) == ("error", "unusable files")
    assert "80x45 px, expected 160x90" in finding["texts"][0]
    # Nothing can be drawn into them.
    assert not (tmp_path / "out" / "CAM_FRONT.png").exists()
    assert (tmp_path / "out" / "CAM_BACK.png").exists()


def test_tables_alone(spoilt: Path, tmp_path: Path) -> None:
    shutil.rmtree(spoilt / "samples")
    report = report_of(spoilt, tmp_path / "out")
    assert findings(report) == [("note", "missing images"), ("note", "missing sweeps")]


def test_sizes_that_tables_lack_are_those_of_files(spoilt: Path) -> None:
    frames = read_table(spoilt, "sample_data")
    for frame in frames:
        del frame["width"], frame["height"]
    write_table(spoilt, "sample_data", frames)
    index = load_index(spoilt, VERSION, CAMERAS)
    camera = survey(index, spoilt, VERSION).cameras[0]
    assert list(camera.sizes) == ["unknown"]
    assert camera.field_deg.median == pytest.approx(2 * math.degrees(math.atan(80 / 128)), abs=0.01)


def test_a_split_whose_scenes_are_missing(spoilt: Path, tmp_path: Path) -> None:
    splits = {"train": ["scene-0001", "scene-0007"], "val": ["scene-0008"]}
    (spoilt / VERSION / "splits.json").write_text(json.dumps(splits))
    report = report_of(spoilt, tmp_path / "out", status=2)
    drives = report["drives"]
    counts = [(s["name"], s["num_listed"], s["num_scenes"]) for s in drives["splits"]]
    assert counts == [("train", 2, 1), ("val", 1, 0)]
    assert drives["num_scenes_in_no_split"] == 2
    assert findings(report) == 2 * [("error", "scenes not in the tables")]
    assert [finding["texts"] for finding in report["findings"]] == [["scene-0007"], ["scene-0008"]]


def test_one_moment_has_no_speed_and_no_future(tmp_path: Path) -> None:
    root = write_tiny(tmp_path / "data", (TinyScene("made-up", seconds=0.0),))
    report = report_of(root, tmp_path / "out")
    assert report["motion"]["speed_mps"]["median"] is None
    assert report["drives"]["pose_step_s"]["most"] is None
    assert findings(report) == [("note", "no futures"), ("note", "no splits")]


def test_scenes_without_lidar(tmp_path: Path) -> None:
    root = write_tiny(tmp_path / "data", (TinyScene("scene-0001", has_lidar=False),))
    report = report_of(root, tmp_path / "out")
    assert report["lidar"]["num_keyframes"] == 0
    assert bad(report) == []


def write_boxes(root: Path, names: Sequence[str]) -> None:
    """A box of each category at the first sample, one beside the other."""
    tokens = [str(number) for number in range(len(names))]
    sample = read_table(root, "sample")[0]["token"]
    pairs = list(zip(tokens, names, strict=True))
    write_table(root, "category", [{"token": token, "name": name} for token, name in pairs])
    write_table(root, "instance", [{"token": t, "category_token": t} for t in tokens])
    boxes = [
        {
            "token": token,
            "sample_token": sample,
            "instance_token": token,
            "translation": [3.0 * number, 0.0, 0.0],
            "size": [1.0, 1.0, 1.0],
            "rotation": [1.0, 0.0, 0.0, 0.0],
        }
        for number, token in enumerate(tokens)
    ]
    write_table(root, "sample_annotation", boxes)


def test_boxes_by_category(spoilt: Path, tmp_path: Path) -> None:
    write_boxes(spoilt, ["vehicle.car", "movable_object.barrier", "gadget"])
    report = report_of(spoilt, tmp_path / "out")
    counted = {box["name"]: (box["num_boxes"], box["is_counted"]) for box in report["boxes"]}
    assert counted == {
        "vehicle.car": (1, True),
        "movable_object.barrier": (1, False),
        "gadget": (1, None),
    }
    assert bad(report) == [("warning", "unknown categories")]
    assert "gadget" in report["findings"][0]["texts"][0]


def test_boxes_that_cannot_be(spoilt: Path, tmp_path: Path) -> None:
    write_boxes(spoilt, ["vehicle.car"])
    boxes = read_table(spoilt, "sample_annotation")
    boxes[0]["size"] = [-1.0, 1.0, 1.0]
    write_table(spoilt, "sample_annotation", boxes)
    report = report_of(spoilt, tmp_path / "out", status=2)
    assert findings(report) == [("error", "unusable annotations")]
    assert report["boxes"] is None


def test_a_damaged_map(spoilt: Path, tmp_path: Path) -> None:
    (spoilt / "maps" / "expansion").mkdir(parents=True)
    (spoilt / "maps" / "expansion" / "boston-seaport.json").write_text("{}")
    report = report_of(spoilt, tmp_path / "out", status=2)
    assert findings(report) == [("error", "unusable map")]
    assert report["locations"][0]["on_road"] is None


def test_names_cannot_steer_a_terminal(tmp_path: Path) -> None:
    root = write_tiny(tmp_path / "data", (TinyScene("scene-0001"),))
    logs = read_table(root, "log")
    logs[0]["location"] = "\x1b[2Jhere"
    write_table(root, "log", logs)
    index = load_index(root, VERSION, CAMERAS)
    text = format_report(survey(index, root, VERSION))
    assert "\x1b" not in text
    assert "here" in text


# Tables made wrong on purpose; all that is named: test_check_mistakes.py


def never_turned(record: Row) -> None:
    record["rotation"] = [1.0, 0.0, 0.0, 0.0]


def full_size_intrinsics(record: Row) -> None:
    if record["camera_intrinsic"]:
        rows = 2.0 * np.asarray(record["camera_intrinsic"][:2])
        record["camera_intrinsic"] = [*rows.tolist(), [0.0, 0.0, 1.0]]


@pytest.mark.parametrize(
    ("table", "spoil", "mistake"),
    [
        ("ego_pose", never_turned, "as if headings had never been written"),
        ("calibrated_sensor", full_size_intrinsics, "intrinsics of images 2 times as large"),
    ],
)
def test_mistakes_are_named_and_drawn(
    table: str, spoil: Callable[[Row], None], mistake: str, spoilt: Path, tmp_path: Path
) -> None:
    records = read_table(spoilt, table)
    for record in records:
        spoil(record)
    write_table(spoilt, table, records)
    report = report_of(spoilt, tmp_path / "out", status=2)
    errors = [one for one in report["findings"] if one["level"] == "error"]
    assert any(mistake in text for one in errors for text in one["texts"]), errors
    # What can be drawn shows it.
    assert (tmp_path / "out" / "CAM_FRONT.png").exists()


def test_warnings_of_the_index_are_findings(spoilt: Path, tmp_path: Path) -> None:
    frames = read_table(spoilt, "sample_data")
    for frame in frames:
        frame["is_key_frame"] = True
    write_table(spoilt, "sample_data", frames)
    report = report_of(spoilt, tmp_path / "out")
    assert findings(report) == [("warning", "several keyframes")]


# What users get wrong


def test_wrong_places(tiny_root: Path, tmp_path: Path) -> None:
    for said, word in (
        (check(tmp_path / "nowhere"), "nowhere"),
        (check(tiny_root, "--data.version", "v1.0-mini"), "v1.0-mini"),
        (check(tiny_root, "--data.cameras", "CAM_ROOF"), "CAM_ROOF"),
    ):
        assert said.status == 2
        (complaint,) = said.err.strip().splitlines()
        assert complaint.startswith("error: ")
        assert word in complaint


# Real tables


@pytest.mark.real
def test_nothing_bad_is_said_of_a_real_scene(real_root: Path, tmp_path: Path) -> None:
    report = report_of(real_root, tmp_path, "--data.version", "v1.0-mini", cameras=CAMERAS)
    assert bad(report) == []
    assert abs(report["motion"]["off_axis_deg"]["median"]) < 2.0
    for camera in report["cameras"]:
        assert 1.3 < camera["height_m"]["median"] < 1.8
        assert abs(camera["pitch_deg"]["median"]) < 3.0
    assert (report["futures"]["num_labels"], report["futures"]["num_starts"]) == (28, 167)
    assert report["locations"][0]["on_road"] == 1.0
    counted = {box["name"]: box["is_counted"] for box in report["boxes"]}
    assert counted["vehicle.car"]
    assert not counted["movable_object.barrier"]


@pytest.mark.real
def test_nothing_bad_is_said_of_lyfts_tables(lyft_root: Path, tmp_path: Path) -> None:
    report = report_of(lyft_root, tmp_path, "--data.version", "v1.01-train", cameras=CAMERAS)
    assert bad(report) == []
    assert "missing images" in dict(map(reversed, findings(report)))  # type: ignore[arg-type]
