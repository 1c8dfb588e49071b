"""What cars do is no flaw of their poses, however many poses there are and however noisy."""

import math

import numpy as np
import pytest
from driven_tracks import DRIVES, driven, joined, tracks_of
from scipy.spatial.transform import Rotation

from lss_core.data.checks.pose_repairs import likely_mistakes
from lss_core.data.checks.poses import find_flaws
from lss_core.data.tables.tracks import Tracks


@pytest.mark.parametrize("noise", [0.0, 1.0])
@pytest.mark.parametrize("rate_hz", [1.0, 2.0, 10.0, 20.0, 100.0])
@pytest.mark.parametrize("drive", DRIVES)
def test_what_cars_do_is_no_flaw(drive: str, rate_hz: float, noise: float) -> None:
    rng = np.random.default_rng(5)
    times_s = np.arange(0.0, 20.0, 1.0 / rate_hz)
    # Time stamps are not even, and what they belong to was a little later.
    times_s = times_s + rng.uniform(0.0, 0.2 / rate_hz, len(times_s))
    places_m, yaw_rad = DRIVES[drive](times_s)
    places_m = places_m + noise * rng.normal(0.0, 0.05, places_m.shape)
    yaw_rad = yaw_rad + noise * rng.normal(0.0, np.deg2rad(0.5), yaw_rad.shape)
    assert find_flaws(tracks_of(times_s, places_m, yaw_rad)) == {}


def test_a_steep_road_is_no_flaw() -> None:
    tracks = tracks_of(
        0.1 * np.arange(80), np.stack([np.arange(80.0), np.zeros(80)], -1), np.zeros(80)
    )
    climbing = Rotation.from_euler("y", -math.atan(0.15)).as_matrix()
    tracks.global_from_ego[:, :3, :3] = climbing
    assert find_flaws(tracks) == {}


def test_poses_shared_by_the_cameras_of_a_moment_are_no_flaw() -> None:
    # Six cameras fire within 50 ms and have one pose, twice a second.
    times_s = (0.5 * np.arange(30)[:, None] + 0.01 * np.arange(6)).ravel()
    places_m = np.repeat(np.stack([10.0 * np.arange(30), np.zeros(30)], -1), 6, axis=0)
    assert find_flaws(tracks_of(times_s, places_m, np.zeros(180))) == {}


def test_the_nearest_of_ten_poses_a_second_is_no_flaw() -> None:
    # Cameras that fire whenever they like, and have the pose of the nearest moment that has one.
    times_s = np.sort(np.random.default_rng(3).uniform(0.0, 20.0, 400))
    places_m, yaw_rad = driven(20.0, lambda t: 25.0, lambda t: 0.004)(np.round(times_s, 1))
    assert find_flaws(tracks_of(times_s, places_m, yaw_rad)) == {}


def test_short_scenes_count_together() -> None:
    def scene(number: int, off_rad: float) -> Tracks:
        times_s = 0.1 * np.arange(9)
        places_m, yaw_rad = DRIVES["straight"](times_s)
        return tracks_of(times_s, places_m, yaw_rad + off_rad, number)

    assert find_flaws(scene(0, 1.0)) == {}
    assert find_flaws(joined([scene(n, 0.0) for n in range(5)])) == {}
    flaws = find_flaws(joined([scene(n, 1.0) for n in range(5)]))
    assert sorted(flaws) == list(range(5))
    assert "left of its motion by 57 degrees" in flaws[3].measured


def test_one_scene_may_be_wrong_among_others() -> None:
    parts = []
    for number, off_rad in enumerate([0.0, -np.pi / 2, 0.0]):
        times_s = 0.1 * np.arange(100)
        places_m, yaw_rad = DRIVES["slalom"](times_s)
        parts.append(tracks_of(times_s, places_m, yaw_rad + off_rad, number))
    tracks = joined(parts)
    flaws = find_flaws(tracks)
    assert list(flaws) == [1]
    assert "y axis looks forward" in likely_mistakes(tracks, flaws)[1]


def test_scenes_together_are_scenes_one_by_one() -> None:
    rng = np.random.default_rng(0)
    parts = []
    for scene, name in enumerate(DRIVES):
        times_s = 100.0 * rng.permutation(9)[0] + np.sort(rng.uniform(0.0, 20.0, 150))
        places_m, yaw_rad = DRIVES[name](times_s % 100.0)
        if scene % 3 == 0:
            yaw_rad = yaw_rad + np.pi / 2
        if scene % 3 == 1:
            places_m[70] += 9.0
        parts.append(tracks_of(times_s, places_m, yaw_rad, scene))
    together = joined(parts)
    singly = {scene: flaw.measured for part in parts for scene, flaw in find_flaws(part).items()}
    assert {scene: flaw.measured for scene, flaw in find_flaws(together).items()} == singly
    assert len(singly) > 4
