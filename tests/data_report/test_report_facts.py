"""What shoot-check says of data sets: known facts of made-up ones."""

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from checked_data import SCENES, bad, findings, report_of
from PIL import Image
from pyquaternion import Quaternion
from tiny_tables import (
    KEPT_A_SCENE,
    KEYFRAMES_A_SCENE,
    SWEEPS_A_SCENE,
    SWEEPS_KEPT_A_SCENE,
    VERSION,
    read_table,
    write_table,
)

from lss_core.camera import field_of_view, horizon_line, project
from lss_core.config import CAMERAS, ImageConfig
from lss_core.data.samples import load_index
from lss_core.data.sensors.images import draw_pixel_map
from lss_core.geometry import apply
from shoot.data_report import survey, view_cameras
from shoot.rendering import render_calibration

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
