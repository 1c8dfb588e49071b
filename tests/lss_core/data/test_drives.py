"""One drive under two names is seen by its poses, and what only looks alike is not."""

import math
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest
from tiny_tables import TRAIN_A, TRAIN_B, VAL, VERSION, TinyScene, write_tiny
from world_fixture import TRAIN_RIDES, VAL_RIDES, TinyRide

from lss_core.data.drives import KnownScene, find_shared, know_scenes
from lss_core.data.samples import SampleIndex, load_index

CAMERA = "CAM_FRONT"


@dataclass(frozen=True)
class Waiting(TinyScene):
    """Stands at a light, its poses trembling by a millimetre, until it drives on."""

    until_s: float = 6.0

    def pose(self, time_s: float) -> tuple[float, float, float]:
        way_m = max(0.0, 3.0 * (time_s - self.until_s))
        x_m, y_m, yaw_rad = replace(TRAIN_A, yaw_rate_radps=0.0).pose(way_m / TRAIN_A.speed_mps)
        tremble_m = 1e-3 * math.sin(40.0 * time_s)
        return x_m + tremble_m, y_m - tremble_m, yaw_rad


def index_of(root: Path, *scenes: TinyScene) -> SampleIndex:
    write_tiny(root, scenes, cameras=(CAMERA,), image_hw=(9, 16))
    return load_index(root, VERSION, (CAMERA,))


def known(root: Path, *scenes: TinyScene) -> tuple[KnownScene, ...]:
    return know_scenes(index_of(root, *scenes), range(len(scenes)))


def with_poses(index: SampleIndex, xy_m: np.ndarray) -> KnownScene:
    """An only scene that takes these positions."""
    poses = np.tile(np.eye(4), (len(xy_m), 1, 1))
    poses[:, :2, 3] = xy_m
    start = np.array([0, len(xy_m)])
    (scene,) = know_scenes(replace(index, global_from_track=poses, track_start=start), [0])
    return replace(scene, token="another")


def test_different_drives_share_nothing(tmp_path: Path) -> None:
    rides = known(tmp_path, *TRAIN_RIDES, *VAL_RIDES)
    assert all(len(ride.digest) >= 8 * 20 for ride in rides)
    for number, ride in enumerate(rides):
        assert find_shared([ride], rides) == [(ride, rides[number])]


def test_one_drive_under_two_names_and_at_another_time(tmp_path: Path) -> None:
    # The second scene has other tokens, starts 100 s later and stands in another place of the list.
    again = replace(TRAIN_A, name="scene-0003")
    one, other, twin = known(tmp_path, TRAIN_A, TRAIN_B, again)
    assert twin.digest == one.digest
    assert find_shared([one, other], [twin]) == [(one, twin)]


@pytest.mark.parametrize("noise_m", [0.0, 1e-4, 1e-3])
def test_a_part_driven_in_both_is_seen(tmp_path: Path, noise_m: float) -> None:
    index = index_of(tmp_path, replace(TRAIN_A, seconds=40.0))
    xy_m = index.global_from_track[:, :2, 3]
    rng = np.random.default_rng(0)
    (whole,) = know_scenes(index, [0])
    # The last 10 s of 40, copied with fewer digits.
    part = with_poses(index, xy_m[300:] + rng.uniform(-noise_m, noise_m, xy_m[300:].shape))
    assert find_shared([part], [whole]) == [(part, whole)]
    # A place that both pass is not enough.
    crossing = with_poses(index, xy_m[:4])
    assert find_shared([crossing], [whole]) == []


def test_two_scenes_that_wait_at_one_light(tmp_path: Path) -> None:
    standing, waiting = known(tmp_path, Waiting("scene-0001", until_s=60.0), Waiting("scene-0002"))
    assert standing.digest == ""
    assert waiting.digest != ""
    assert find_shared([waiting], [standing]) == []
    assert find_shared([standing], [standing]) == [(standing, standing)]  # by its token


def test_cars_that_follow_one_lane_are_not_one_drive(tmp_path: Path) -> None:
    rng = np.random.default_rng(1)
    rides = [
        TinyRide(
            f"scene-{number:04d}", 8.0,
            speed_mps=speed, yaw_rate_radps=speed * 0.02, acceleration_mps2=gain,
        )
        for number, (speed, gain) in enumerate(
            zip(rng.uniform(1.0, 12.0, 20), rng.uniform(-0.1, 1.0, 20), strict=True)
        )
    ]  # fmt: skip
    drives = known(tmp_path, *rides)
    assert len(find_shared(drives, drives)) == len(drives)


def test_a_car_that_never_was_recorded(tmp_path: Path) -> None:
    index = index_of(tmp_path, VAL)
    assert with_poses(index, np.zeros((0, 2))).digest == ""
    assert with_poses(index, np.zeros((1, 2))).digest == ""
    assert (
        find_shared([], know_scenes(index, [0])) == find_shared(know_scenes(index, [0]), []) == []
    )


@pytest.mark.parametrize("digest", ["0", "0123456", "x" * 8, "0" * 8 * 65, "ABCDEF01"])
def test_what_is_no_digest(digest: str) -> None:
    with pytest.raises(ValueError, match="digest of scene 'one'"):
        KnownScene("one", "token", digest)
