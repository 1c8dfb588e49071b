import json
from pathlib import Path

import numpy as np
import pytest

from lss_core.geometry import rigid_from_quaternion
from shoot.world.sensing.rig import Camera, make_rig
from shoot.world.sensing.rig_plans import LIDAR_PERIOD_S, LYFT, NUSCENES

ZOOMED = "CAM_FRONT_ZOOMED"


def directions_deg(ego_from_camera: np.ndarray) -> tuple[float, float]:
    """Where a camera looks: to the left, and up."""
    x, y, z = ego_from_camera[:3, 2]
    return float(np.rad2deg(np.arctan2(y, x))), float(np.rad2deg(np.arcsin(z)))


def field_deg(camera: Camera) -> float:
    return float(2 * np.rad2deg(np.arctan(camera.width_px / 2 / camera.pixel_from_camera[0, 0])))


def mounted(scale: float = 1.0) -> dict[str, Camera]:
    return {camera.channel: camera for camera in make_rig(4, scale, 64, LYFT).cameras}


def test_six_of_lyfts_cameras_see_all_around_and_the_seventh_a_little_of_it() -> None:
    cameras = mounted()
    assert len(cameras) == 7
    looks = {name: directions_deg(camera.ego_from_camera) for name, camera in cameras.items()}
    edges = sorted(
        (looks[name][0] - field_deg(camera) / 2, looks[name][0] + field_deg(camera) / 2)
        for name, camera in cameras.items()
        if name != ZOOMED
    )
    for (_, left), (right, _) in zip(edges, [*edges[1:], (edges[0][0] + 360.0, 0.0)], strict=True):
        assert 10.0 < left - right < 30.0
    assert looks[ZOOMED] == pytest.approx((0.0, 8.4), abs=0.8)
    assert field_deg(cameras[ZOOMED]) == pytest.approx(27.2, abs=0.4)


def test_lyfts_cameras_are_upright_and_their_rack_leans_back() -> None:
    plain = mounted()
    for camera in plain.values():
        turn = camera.ego_from_camera[:3, :3]
        assert np.allclose(turn @ turn.T, np.eye(3))
        assert np.linalg.det(turn) == pytest.approx(1.0)
        assert turn[2, 1] < -0.98
        assert abs(turn[2, 0]) < 0.01
        assert (camera.width_px, camera.height_px) == (1920, 1080)
    ahead, behind = (
        directions_deg(plain[name].ego_from_camera)[1] for name in ("CAM_FRONT", "CAM_BACK")
    )
    assert ahead > 0.8
    assert behind < -0.8


def test_a_share_of_lyfts_size_looks_at_the_same_places() -> None:
    small = mounted(0.1)[ZOOMED]
    assert (small.width_px, small.height_px) == (192, 108)
    assert field_deg(small) == pytest.approx(field_deg(mounted()[ZOOMED]), rel=1e-9)


@pytest.mark.parametrize("plan", [NUSCENES, LYFT], ids=["nuscenes", "lyft"])
def test_no_camera_of_the_first_keyframe_fires_before_the_recording(plan) -> None:
    earliest_s = min(camera.delay_s for camera in plan.cameras) - 0.0015
    first_s = plan.first_turn * LIDAR_PERIOD_S
    assert 0.0 <= first_s + earliest_s < LIDAR_PERIOD_S


@pytest.mark.real
def test_the_plan_is_what_lyfts_tables_say(lyft_root: Path) -> None:
    def rows(name: str) -> list[dict]:
        return json.loads((lyft_root / "v1.01-train" / f"{name}.json").read_text())

    channels = {row["token"]: row["channel"] for row in rows("sensor")}
    calibration = {row["token"]: row for row in rows("calibrated_sensor")}
    plans = {camera.channel: camera for camera in LYFT.cameras}
    seen = set()
    for data in rows("sample_data"):
        row = calibration[data["calibrated_sensor_token"]]
        channel = channels[row["sensor_token"]]
        pose = rigid_from_quaternion(np.array(row["translation"]), np.array(row["rotation"]))
        if channel == "LIDAR_TOP":
            assert pose[:3, 3] == pytest.approx(LYFT.lidar_position_m, abs=0.03)
            yaw_rad = np.arctan2(pose[1, 0], pose[0, 0])
            assert np.cos(yaw_rad - LYFT.lidar_yaw_rad) > np.cos(np.deg2rad(1.0))
        if channel not in plans:
            continue
        seen.add(channel)
        plan, matrix = plans[channel], np.array(row["camera_intrinsic"])
        assert (data["width"], data["height"]) == (LYFT.width_px, LYFT.height_px)
        assert plan.focal_px == pytest.approx(matrix[0, 0], rel=0.01)
        assert plan.centre_px == pytest.approx(matrix[:2, 2], abs=3.0)
        assert plan.position_m == pytest.approx(pose[:3, 3], abs=0.03)
        yaw_deg, pitch_deg = directions_deg(pose)
        assert np.cos(np.deg2rad(yaw_deg) - plan.yaw_rad) > np.cos(np.deg2rad(1.0))
        assert np.rad2deg(plan.pitch_rad) == pytest.approx(pitch_deg, abs=0.3)
        # The lidar's stamp of the one sample.
        assert plan.delay_s == pytest.approx(
            (data["timestamp"] - 1556675185903083.2) / 1e6, abs=1e-3
        )
    assert seen == set(plans)
