import numpy as np
import pytest

from shoot.world.sensing.rig import Rig, make_rig, quaternion_wxyz, rotation_z


def test_rig_is_close_to_its_plan_and_differs_between_scenes():
    first, second = make_rig(1, 0.25, 64), make_rig(2, 0.25, 64)
    yaws = {}
    for a, b in zip(first.cameras, second.cameras, strict=True):
        assert (a.width_px, a.height_px) == (400, 225)
        ahead = a.ego_from_camera[:3, 2]
        yaws[a.channel] = np.rad2deg(np.arctan2(ahead[1], ahead[0]))
        assert np.allclose(a.ego_from_camera[:3, :3] @ a.ego_from_camera[:3, :3].T, np.eye(3))
        assert np.linalg.det(a.ego_from_camera[:3, :3]) == pytest.approx(1.0)
        # Image y points down.
        assert a.ego_from_camera[2, 1] < -0.99
        assert not np.allclose(a.pixel_from_camera, b.pixel_from_camera)
        assert not np.allclose(a.ego_from_camera, b.ego_from_camera)
        assert -0.05 <= a.delay_s <= 0.0
    expected = {
        "CAM_FRONT": 0, "CAM_FRONT_RIGHT": -55, "CAM_BACK_RIGHT": -110,
        "CAM_BACK_LEFT": 110, "CAM_FRONT_LEFT": 55,
    }  # fmt: skip
    for channel, yaw in expected.items():
        assert yaws[channel] == pytest.approx(yaw, abs=1.0)
    assert abs(yaws["CAM_BACK"]) > 179
    assert list(yaws) == ["CAM_FRONT", "CAM_FRONT_RIGHT", "CAM_BACK_RIGHT", "CAM_BACK",
                          "CAM_BACK_LEFT", "CAM_FRONT_LEFT"]  # fmt: skip


def test_shrinking_an_image_keeps_where_its_rays_go():
    large, small = make_rig(3, 0.5, 64).cameras[1], make_rig(3, 0.25, 64).cameras[1]
    # Pixel i of the half-sized image covers pixels 2 i and 2 i + 1: its centre is 2 i + 0.5.
    ray = np.array([0.2, -0.1, 1.0])
    u_large, u_small = (c.pixel_from_camera @ ray for c in (large, small))
    assert (u_large[:2] - 0.5) / 2 == pytest.approx(u_small[:2], abs=1e-9)


def test_rays_meet_their_own_pixels():
    view = make_rig(3, 0.1, 64).cameras[2]
    rays = view.rays_camera().reshape(view.height_px, view.width_px, 3)
    back = rays[30, 71] @ view.pixel_from_camera.T
    assert back[:2] / back[2] == pytest.approx([71, 30], abs=1e-4)
    assert np.linalg.norm(rays, axis=-1) == pytest.approx(1.0, abs=1e-6)


def test_quaternions():
    half = np.sqrt(0.5)
    assert quaternion_wxyz(rotation_z(np.pi / 2)) == pytest.approx([half, 0, 0, half])
    flip = np.diag([1.0, -1.0, -1.0])
    assert quaternion_wxyz(flip) == pytest.approx([0, 1, 0, 0])
    assert quaternion_wxyz(rotation_z(-3.0)) == pytest.approx([np.cos(1.5), 0, 0, -np.sin(1.5)])


def test_lidar_beams_of_a_rig():
    rig: Rig = make_rig(1, 0.1, 8)
    beams, rings = rig.rays_lidar()
    assert beams.shape == (256, 3)
    assert np.rad2deg(np.arcsin(beams[rings == 0, 2])) == pytest.approx(-30.0, abs=1e-3)
    assert np.rad2deg(np.arcsin(beams[rings == 31, 2])) == pytest.approx(10.0, abs=1e-3)
