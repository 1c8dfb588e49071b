"""Crops keep the horizon of cameras of any shape, and stay as they were on nuScenes' cameras."""

import dataclasses
import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation
from tiny_tables import TRAIN_A, VERSION, write_tiny

from lss_core.camera import horizon_row, project
from lss_core.config import CAMERAS, DataConfig, ImageConfig
from lss_core.data.dataset import CameraDataset
from lss_core.data.samples import load_index
from lss_core.data.sensors.images import PixelMap, draw_pixel_map
from shoot.training.planning.config import PRESETS
from shoot.world.sensing.rig import make_rig

# Argoverse 2's front camera stands on its side: sizes and focal length as its users name them.
PORTRAIT_HW, PORTRAIT_FOCAL_PX = (2048, 1550), 1685.0
PAPER = ImageConfig()


def intrinsics(focal_px: float, hw: tuple[int, int]) -> np.ndarray:
    return np.array([[focal_px, 0, hw[1] / 2 - 0.5], [0, focal_px, hw[0] / 2 - 0.5], [0, 0, 1.0]])


def mounted(yaw_deg: float = 0.0, down_deg: float = 0.0, roll_deg: float = 0.0) -> np.ndarray:
    """A camera 1.5 m up; `down_deg` towards the road, `roll_deg` about its own axis."""
    forward = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
    turn = Rotation.from_euler("ZYX", [yaw_deg, down_deg, roll_deg], degrees=True).as_matrix()
    pose = np.eye(4)
    pose[:3, :3] = turn @ forward
    pose[:3, 3] = 1.7, 0.3, 1.5
    return pose


def shares_of_horizon(pixel_map: PixelMap, row: float) -> tuple[float, float]:
    """Of the result's rows above and below the horizon; negative outside."""
    upper = (row + 0.5) / pixel_map.raw_hw[0] * pixel_map.resized_hw[0] - pixel_map.top_px
    return upper / pixel_map.image_hw[0], 1.0 - upper / pixel_map.image_hw[0]


def drawn(
    config: ImageConfig, hw: tuple[int, int], seed: int | None, row: float | None
) -> PixelMap:
    return draw_pixel_map(config, hw, None if seed is None else np.random.default_rng(seed), row)


def test_horizon_by_hand() -> None:
    matrix = np.array([[1200.0, 0.0, 790.0], [0.0, 1260.0, 470.0], [0.0, 0.0, 1.0]])
    assert horizon_row(matrix, mounted(yaw_deg=123.0)) == pytest.approx(470.0)
    # Looking down by 3 degrees lifts the horizon in the image.
    expected = 470.0 - 1260.0 * math.tan(math.radians(3.0))
    assert horizon_row(matrix, mounted(-40.0, down_deg=3.0)) == pytest.approx(expected)
    assert horizon_row(matrix, mounted(-40.0, down_deg=-3.0)) == pytest.approx(940.0 - expected)


def test_horizon_is_where_far_things_at_the_cameras_height_are() -> None:
    matrix, pose = intrinsics(900.0, (900, 1600)), mounted(57.0, 4.0, -6.0)
    far = pose[:3, 3] + 1e7 * np.array([*pose[:2, 2], 0.0])
    pixel, _ = project(far, matrix, pose)
    assert horizon_row(matrix, pose) == pytest.approx(float(pixel[1]), abs=1e-3)


def test_no_horizon_ahead() -> None:
    matrix = intrinsics(900.0, (900, 1600))
    straight_down = mounted()
    straight_down[:3, :3] = np.diag([1.0, -1.0, -1.0])
    assert horizon_row(matrix, straight_down) is None
    for roll_deg in (90.0, -90.0, 50.0):
        assert horizon_row(matrix, mounted(20.0, 2.0, roll_deg)) is None
    assert horizon_row(matrix, mounted(20.0, 2.0, 40.0)) is not None


@pytest.mark.parametrize("preset", PRESETS)
def test_crops_of_cameras_like_nuscenes_stay_as_they_were(preset: str) -> None:
    config = PRESETS[preset][1].data.image
    rng = np.random.default_rng(0)
    for seed, scale in enumerate((1.0, 0.25, 0.11) * 4):
        for camera in make_rig(seed, scale, 64).cameras:
            row = horizon_row(camera.pixel_from_camera, camera.ego_from_camera)
            hw = camera.height_px, camera.width_px
            for draw in (None, *rng.integers(0, 1 << 30, 20).tolist()):
                assert drawn(config, hw, draw, row) == drawn(config, hw, draw, None)


@pytest.mark.parametrize("preset", PRESETS)
def test_crops_of_the_real_cameras_stay_as_they_were(preset: str, real_root: Path) -> None:
    config = PRESETS[preset][1].data.image
    index = load_index(real_root, "v1.0-mini", CAMERAS)
    for n in range(len(CAMERAS)):
        row = horizon_row(index.rawpixel_from_camera[0, n], index.egocam_from_camera[0, n])
        for draw in (None, *range(100)):
            assert drawn(config, (900, 1600), draw, row) == drawn(config, (900, 1600), draw, None)


@pytest.mark.parametrize("preset", PRESETS)
def test_portrait_cameras_see_horizon_and_road(preset: str) -> None:
    config = PRESETS[preset][1].data.image
    pose, matrix = mounted(), intrinsics(PORTRAIT_FOCAL_PX, PORTRAIT_HW)
    row = horizon_row(matrix, pose)
    assert row is not None
    # Without it, this camera would see none.
    assert shares_of_horizon(drawn(config, PORTRAIT_HW, None, None), row)[0] < 0.0
    for draw in (None, *range(100)):
        pixel_map = drawn(config, PORTRAIT_HW, draw, row)
        above, below = shares_of_horizon(pixel_map, row)
        assert above >= config.horizon[0] - 1e-9
        assert below >= config.horizon[1] - 1e-9
        upright = dataclasses.replace(pixel_map, flip=False, rotate_rad=0.0)
        road = np.array([[1.7 + ahead_m, 0.3, 0.0] for ahead_m in (8.0, 40.0)])
        pixels, _ = project(road, upright.pixel_from_rawpixel @ matrix, pose)
        assert (pixels > -0.5).all()
        assert (pixels < np.array([config.width_px, config.height_px]) - 0.5).all()


@given(
    raw_h=st.integers(20, 3000),
    raw_w=st.integers(20, 3000),
    row=st.floats(-3000.0, 6000.0),
    shares=st.tuples(st.floats(0.0, 0.5), st.floats(0.0, 0.5)),
    seed=st.integers(0, 1000),
)
def test_only_the_row_of_a_crop_moves_and_no_further_than_the_image(
    raw_h: int, raw_w: int, row: float, shares: tuple[float, float], seed: int
) -> None:
    config = dataclasses.replace(PAPER, horizon=shares)
    before, after = (drawn(config, (raw_h, raw_w), seed, asked) for asked in (None, row))
    assert dataclasses.replace(after, top_px=before.top_px) == before
    assert after.padding == before.padding
    last = before.resized_hw[0] - config.height_px
    if not (0.0 <= row <= raw_h - 1.0 and 0 <= before.top_px <= last):
        if not -0.5 <= row <= raw_h - 0.5 or not 0 <= before.top_px <= last:
            assert after == before
        return
    above, below = shares_of_horizon(after, row)
    # Whole rows only, so that two shares which fill the height may miss by one.
    row_share = 1.0 / config.height_px + 1e-9
    assert above >= shares[0] - row_share or after.top_px == 0
    assert below >= shares[1] - row_share or after.top_px == last


def test_landscape_camera_that_looks_down() -> None:
    hw, matrix = (900, 1600), intrinsics(1266.0, (900, 1600))
    # By 20 degrees, its horizon lies above its image: nothing to keep.
    row = horizon_row(matrix, mounted(down_deg=20.0))
    assert row is not None
    assert row < 0.0
    assert drawn(PAPER, hw, None, row) == drawn(PAPER, hw, None, None)
    # By 16.5, it lies near the upper border: the crop goes there, and no further.
    row = horizon_row(matrix, mounted(down_deg=16.5))
    assert row is not None
    pixel_map = drawn(PAPER, hw, None, row)
    assert pixel_map.top_px == 0
    assert pixel_map.padding == 0.0
    assert 0.1 < shares_of_horizon(pixel_map, row)[0] < PAPER.horizon[0]


def test_crop_that_pads_is_left_to_be_reported() -> None:
    # Per cent for a share: the horizon must not hide it.
    config = dataclasses.replace(PAPER, crop_bottom=(0.8, 0.8))
    assert drawn(config, (900, 1600), None, 480.0) == drawn(config, (900, 1600), None, None)


def test_tall_image_with_a_wide_lens() -> None:
    # A fisheye straightened to a tall pinhole: horizon in the middle, far above the usual crop.
    hw = (1920, 1280)
    row = horizon_row(intrinsics(420.0, hw), mounted(down_deg=2.0))
    assert row is not None
    above, below = shares_of_horizon(drawn(PAPER, hw, None, row), row)
    assert above >= PAPER.horizon[0]
    assert below >= PAPER.horizon[1]


@pytest.mark.parametrize("horizon", [(-0.1, 0.2), (0.6, 0.5), (math.nan, 0.2)])
def test_shares_that_cannot_be(horizon: tuple[float, float]) -> None:
    with pytest.raises(ValueError, match="horizon"):
        ImageConfig(horizon=horizon)


def test_samples_are_cropped_by_their_own_calibration(tmp_path: Path) -> None:
    """Evaluation and training of a data set whose cameras are upright, noise or not."""
    root = write_tiny(tmp_path / "data", (TRAIN_A,), cameras=CAMERAS[:2], image_hw=(128, 97))
    index = load_index(root, VERSION, CAMERAS[:2])
    data = DataConfig(
        root=str(root),
        version=VERSION,
        cameras=CAMERAS[:2],
        image=ImageConfig(height_px=32, width_px=88, rotate_rad=0.0, flip=False),
    )
    noisy = dataclasses.replace(data, extrinsic_noise_rad=0.3)
    rows = np.arange(len(index.sample_token))
    for draw in (-1, 0, 1, 2):
        item = CameraDataset(index, rows, data)[0, draw]
        other = CameraDataset(index, rows, noisy)[0, draw]
        assert (item.images == other.images).all()
        for n in range(2):
            # The centre of these level cameras is their horizon: at row 64 of 128.
            row = float(item.pixel_from_camera[n, 1, 2])
            assert 0.15 * 32 - 1.0 <= row <= 0.75 * 32 + 1.0
        assert (item.images.float().std(dim=(1, 2, 3)) > 0.0).all()
