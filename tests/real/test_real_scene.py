"""Mining, calibration and projection on one real nuScenes scene; skipped where there is none."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from lss_core.camera import project
from lss_core.config import CAMERAS, DataConfig
from lss_core.data.dataset import CameraDataset, ego_from_camera
from lss_core.data.samples import SampleIndex, load_index, rows_of_split
from lss_core.data.sensors.lidar import load_scans, load_sweep
from lss_core.data.usable import Needs, usable_rows
from lss_core.errors import DataError
from lss_core.geometry import apply, invert
from lss_core.grid import BevGrid
from lss_core.lidar_encoder import PillarEncoder
from shoot.trajectories import mine_futures

pytestmark = pytest.mark.real
VERSION = "v1.0-mini"


@pytest.fixture(scope="module")
def index(real_root: Path) -> SampleIndex:
    return load_index(real_root, VERSION, CAMERAS)


@pytest.fixture(scope="module")
def rows(index: SampleIndex, real_root: Path) -> np.ndarray:
    return rows_of_split(index, real_root, VERSION, "train")


@pytest.fixture(scope="module")
def devkit(real_root: Path) -> Any:
    from nuscenes.nuscenes import NuScenes

    return NuScenes(VERSION, dataroot=str(real_root), verbose=False)


def test_all_keyframes_are_there(index: SampleIndex, rows: np.ndarray) -> None:
    assert len(rows) == 39
    steps_s = np.diff(index.time_s[rows])
    assert steps_s.min() == pytest.approx(0.40, abs=0.01)
    assert steps_s.max() == pytest.approx(0.60, abs=0.01)
    assert steps_s.sum() == pytest.approx(19.150, abs=0.001)
    assert index.has_camera[rows[0]].all()
    assert not index.has_camera[rows[1:]].any()


def test_nothing_is_wrong_with_it(index: SampleIndex) -> None:
    assert not index.scene_problem.any()
    assert not index.camera_problem.any()
    assert not len(index.warning_text)


def test_every_start_with_five_seconds_is_mined(index: SampleIndex, rows: np.ndarray) -> None:
    keyframes = mine_futures(index, rows, "keyframes")
    assert (len(keyframes.xy_m), keyframes.num_left_out) == (28, 11)
    sweeps = mine_futures(index, rows, "sweeps")
    assert (len(sweeps.xy_m), sweeps.num_left_out) == (167, 60)


def test_first_future_ends_where_the_car_was(index: SampleIndex, rows: np.ndarray) -> None:
    future = mine_futures(index, rows, "keyframes").xy_m[0]
    np.testing.assert_allclose(future[-1], [38.5, 1.1], atol=0.1)
    # Never backwards, never faster than a city allows.
    steps_m = np.linalg.norm(np.diff(future, axis=0, prepend=np.zeros((1, 2))), axis=-1)
    assert (np.diff(future[:, 0]) > 0.0).all()
    assert (steps_m < 0.25 * 15.0).all()


def test_constant_velocity_is_a_fair_guess_at_first(index: SampleIndex, rows: np.ndarray) -> None:
    # What is known of the past predicts the next quarter of a second: frames and signs agree.
    futures = mine_futures(index, rows, "keyframes")
    guess = 0.25 * futures.velocity_mps[1:]
    assert np.linalg.norm(guess - futures.xy_m[1:, 0], axis=-1).max() < 0.4


def test_each_camera_has_its_own_calibration_and_pose(index: SampleIndex, rows: np.ndarray) -> None:
    row = int(rows[0])
    looks = index.egocam_from_camera[row][:, :3, 2]
    angles = np.degrees(np.arctan2(looks[:, 1], looks[:, 0]))
    expected = {"CAM_FRONT": 0, "CAM_FRONT_LEFT": 55, "CAM_FRONT_RIGHT": -55, "CAM_BACK_LEFT": 108}
    expected |= {"CAM_BACK_RIGHT": -110}
    for name, angle in expected.items():
        assert angles[CAMERAS.index(name)] == pytest.approx(angle, abs=4.0)
    assert abs(angles[CAMERAS.index("CAM_BACK")]) > 175.0
    focal_px = index.rawpixel_from_camera[row][:, 0, 0]
    assert len(set(focal_px.tolist())) == 6
    # The rear camera is the wide one.
    assert focal_px.argmin() == CAMERAS.index("CAM_BACK")
    assert (index.image_hw[row] == [900, 1600]).all()


def test_cameras_fire_at_other_times_than_the_lidar(index: SampleIndex, rows: np.ndarray) -> None:
    row = int(rows[0])
    early_s = index.camera_time_s[row] - index.time_s[row]
    assert (early_s < 0.0).all()
    assert early_s.min() == pytest.approx(-0.043, abs=0.002)
    moved = ego_from_camera(index, row)[:, :3, 3] - ego_from_camera(index, row, False)[:, :3, 3]
    # The car drives at about 8 m/s: an early camera stood further back, more so the earlier.
    speed_mps = moved[:, 0] / early_s
    front = CAMERAS.index("CAM_FRONT_LEFT")
    assert moved[front, 0] < -0.2
    assert 5.0 < speed_mps[front] < 12.0


def test_sweep_lands_in_the_front_image(
    index: SampleIndex, rows: np.ndarray, real_root: Path
) -> None:
    row, n = int(rows[0]), CAMERAS.index("CAM_FRONT")
    points = load_sweep(index, real_root, row)
    assert len(points) == 34_688
    pixels, depth_m = project(
        points, index.rawpixel_from_camera[row, n], ego_from_camera(index, row)[n]
    )
    inside = (depth_m > 1.0) & (pixels >= 0.0).all(-1) & (pixels < [1600.0, 900.0]).all(-1)
    # Of 360 degrees the camera sees about 65.
    assert 2000 < inside.sum() < 6000
    # Ground points ahead lie below the horizon, and lower the nearer they are.
    ground = inside & (np.abs(points[:, 2]) < 0.2) & (np.abs(points[:, 1]) < 3.0)
    assert ground.sum() > 50
    assert (pixels[ground, 1] > 450.0).all()
    assert np.corrcoef(1.0 / depth_m[ground], pixels[ground, 1])[0, 1] > 0.95


def test_projection_is_the_devkits(
    index: SampleIndex, rows: np.ndarray, real_root: Path, devkit: Any
) -> None:
    from nuscenes.utils.geometry_utils import view_points

    row = int(rows[0])
    sample = devkit.get("sample", str(index.sample_token[row]))
    for n, camera in enumerate(CAMERAS):
        _, boxes, intrinsics = devkit.get_sample_data(sample["data"][camera])
        ours = []
        for box in boxes:
            annotation = devkit.get("sample_annotation", box.token)
            centre_ego = apply(
                invert(index.global_from_ego[row]), np.asarray([annotation["translation"]])
            )
            pixel, depth_m = project(
                centre_ego, index.rawpixel_from_camera[row, n], ego_from_camera(index, row)[n]
            )
            ours.append([*pixel[0], depth_m[0]])
        centres = np.stack([box.center for box in boxes], axis=-1)
        theirs = view_points(centres, intrinsics, normalize=True)[:2].T
        in_front = centres[2] > 0.5
        assert in_front.sum() > 0
        np.testing.assert_allclose(np.array(ours)[in_front, :2], theirs[in_front], atol=1e-3)
        np.testing.assert_allclose(np.array(ours)[in_front, 2], centres[2][in_front], atol=1e-6)


def test_boxes_hold_the_lidar_points_they_say(
    index: SampleIndex, rows: np.ndarray, real_root: Path, devkit: Any
) -> None:
    from nuscenes.utils.geometry_utils import points_in_box

    row = int(rows[0])
    points_global = apply(index.global_from_ego[row], load_sweep(index, real_root, row))
    sample = devkit.get("sample", str(index.sample_token[row]))
    counted, told = [], []
    for token in sample["anns"]:
        inside = points_in_box(devkit.get_box(token), points_global.T)
        counted.append(int(inside.sum()))
        told.append(devkit.get("sample_annotation", token)["num_lidar_pts"])
    assert len(told) == 68
    close = np.abs(np.subtract(counted, told)) <= np.maximum(2, 0.1 * np.array(told))
    assert close.mean() > 0.9
    assert sum(counted) == pytest.approx(sum(told), rel=0.05)


def test_network_input_of_the_real_sample(
    index: SampleIndex, rows: np.ndarray, real_root: Path
) -> None:
    config = DataConfig(root=str(real_root), version=VERSION)
    item = CameraDataset(index, rows[:1], config)[0, -1]
    assert item.images.shape == (6, 3, 128, 352)
    assert item.camera_mask.all()
    # Real pictures of one moment are neither black nor alike.
    means = item.images.float().mean(dim=(1, 2, 3))
    assert (means > 20.0).all()
    assert len(set(means.tolist())) == 6


def test_later_samples_lack_images(index: SampleIndex, rows: np.ndarray, real_root: Path) -> None:
    with pytest.raises(DataError, match="38 of 39 samples cannot be used"):
        usable_rows(index, real_root, rows, skip_bad=False)
    assert usable_rows(index, real_root, rows, skip_bad=True).rows.tolist() == [rows[0]]


def test_pillars_of_the_real_sweep(index: SampleIndex, rows: np.ndarray, real_root: Path) -> None:
    row = int(rows[0])
    points = load_scans(index, real_root, row, 1)
    whole = load_sweep(index, real_root, row)
    lidar_xy = index.ego_from_lidar[row][:2, 3]
    far = np.hypot(*(whole[:, :2] - lidar_xy).T)
    # Some hundred returns are of the car itself; nothing else is left out.
    assert 100 < len(whole) - len(points) < 0.5 * len(whole)
    np.testing.assert_allclose(points[:, :3], whole[far >= 2.2], atol=0.02)
    assert (points[:, 4] == 0.0).all()
    assert 0.0 <= points[:, 3].min() < points[:, 3].max() <= 255.0

    encoder = PillarEncoder(BevGrid(), channels=8, z_min_m=-10.0, z_max_m=10.0).eval()
    with torch.no_grad():
        pillars = encoder(torch.from_numpy(points), torch.tensor([0]))[0]
    cells, inside = BevGrid().cells(torch.from_numpy(points[:, :2]))
    hit = torch.zeros(BevGrid().shape, dtype=torch.bool)
    hit[cells[inside][:, 0], cells[inside][:, 1]] = True
    assert (pillars[:, ~hit] == 0.0).all()
    assert hit.float().mean() > 0.02


def test_earlier_scans_are_missed_by_name(
    index: SampleIndex, rows: np.ndarray, real_root: Path
) -> None:
    """Only one sweep of the scene is in the folder."""
    assert usable_rows(index, real_root, rows[:1], False, Needs(False, 1)).rows.tolist() == [
        rows[0]
    ]
    with pytest.raises(DataError, match=r"cannot be used.*LIDAR_TOP"):
        usable_rows(index, real_root, rows, False, Needs(False, 10))
