"""A planner in the loop reads what it would read from a data set of the same moment."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from world_fixture import TinyRun, TinySegmenter

from lss_core.batch import collate
from lss_core.config import DataConfig
from lss_core.data.dataset import open_sensors
from lss_core.data.samples import SampleIndex, load_index
from shoot.prediction.run import open_run
from shoot.simulation.drivers.seen import read_sights
from shoot.simulation.senses import Senses, SensorSettings
from shoot.world.nuscenes.tiling import seed_of
from shoot.world.town.roads import make_town
from shoot.world.town.town import Town
from shoot.world.traffic.recording import Recording
from shoot.world.traffic.scenario import make_scenario

# As `tiny_segmenter` has them written.
WORLD_SEED, DURATION_S, IMAGE_SCALE, AZIMUTHS = 3, 1.5, 0.08, 48
SCENE = ("train", 0)


@pytest.fixture(scope="module")
def town() -> Town:
    return make_town(seed_of(WORLD_SEED, SCENE[0], "town", 0))


@pytest.fixture(scope="module")
def recording(town: Town) -> Recording:
    return make_scenario(town, seed_of(WORLD_SEED, SCENE[0], "scene", SCENE[1]), DURATION_S)


def last_moment(index: SampleIndex) -> tuple[int, float]:
    """Row of the scene's last sample, and its time in the recording."""
    row = int(np.flatnonzero(index.sample_scene == 0)[-1])
    # The lidar's first turn ends 0.05 s after the recording began.
    time_s = index.time_s[row] - index.track_time_s[index.track(0)][0] + 0.05
    return row, round(float(time_s), 6)


def senses(
    town: Town, recording: Recording, cameras: tuple[str, ...] = (), num_scans: int = 0
) -> Senses:
    car = SensorSettings(
        image_scale=IMAGE_SCALE, lidar_azimuths=AZIMUTHS, cameras=cameras, num_scans=num_scans
    )
    return Senses(town, seed_of(WORLD_SEED, SCENE[0], "scene", SCENE[1]), car, recording)


def test_a_planner_says_the_same_of_a_moment_in_the_loop_and_on_disk(
    town: Town, recording: Recording, tiny_segmenter: TinySegmenter, tiny_run: TinyRun
) -> None:
    run = open_run(tiny_run.folder, root=str(tiny_segmenter.root))
    config = run.config.data
    index = load_index(config.root, config.version, config.cameras)
    row, time_s = last_moment(index)
    on_disk = open_sensors(index, np.array([row]), config)[0, -1]
    seeing = senses(town, recording, config.cameras)
    delays_s = index.camera_time_s[row] - index.time_s[row]  # each shutter errs a little
    seeing.cameras = [
        replace(camera, delay_s=round(float(delay_s), 6))
        for camera, delay_s in zip(seeing.cameras, delays_s, strict=True)
    ]
    in_loop = read_sights(seeing.look(recording, time_s), config)
    assert torch.equal(in_loop.images, on_disk.images)
    assert in_loop.images.float().std() > 10.0
    for name in ("pixel_from_camera", "ego_from_camera"):
        torch.testing.assert_close(
            getattr(in_loop, name), getattr(on_disk, name), atol=2e-4, rtol=0.0
        )
    with torch.no_grad():
        said = run.module(collate([in_loop, on_disk]).to(run.device)).log_softmax(dim=-1)
    torch.testing.assert_close(said[0], said[1], atol=1e-3, rtol=0.0)


def test_lidar_is_read_as_from_disk(
    town: Town, recording: Recording, tiny_segmenter: TinySegmenter
) -> None:
    config = DataConfig(root=str(tiny_segmenter.root), lidar_scans=1)
    index = load_index(config.root, config.version, config.cameras)
    row, time_s = last_moment(index)
    on_disk = open_sensors(index, np.array([row]), config)[0, -1]
    in_loop = read_sights(senses(town, recording, num_scans=1).look(recording, time_s), config)
    assert len(in_loop.points) > 200
    torch.testing.assert_close(in_loop.points, on_disk.points, atol=1e-3, rtol=0.0)


def test_older_scans_lie_where_the_car_was(town: Town, recording: Recording) -> None:
    moving = replace(
        recording,
        ego_xy_m=recording.ego_xy_m[:1] + np.outer(np.arange(31) * 0.05, [3.0, 4.0]),
        ego_yaw_rad=np.full(31, np.arctan2(4.0, 3.0)),
    )
    scans = senses(town, moving, num_scans=3).look(moving, 1.0).scans
    assert [scan.age_s for scan in scans] == pytest.approx([0.0, 0.05, 0.1])
    behind_m = [scan.ego_from_lidar[:3, 3] - scans[0].ego_from_lidar[:3, 3] for scan in scans]
    np.testing.assert_allclose(behind_m, [[0, 0, 0], [-0.25, 0, 0], [-0.5, 0, 0]], atol=1e-9)


def test_nothing_seen_depends_on_what_comes_later(town: Town, recording: Recording) -> None:
    """Cut off at the moment, and with another future, a recording looks the same."""
    step = 20
    agents = recording.agents
    cut = replace(
        recording,
        ego_xy_m=recording.ego_xy_m[: step + 1],
        ego_yaw_rad=recording.ego_yaw_rad[: step + 1],
        agents=tuple(
            replace(
                a, xy_m=a.xy_m[: step + 1], yaw_rad=a.yaw_rad[: step + 1],
                speed_mps=a.speed_mps[: step + 1], is_braking=a.is_braking[: step + 1],
                is_present=a.is_present[: step + 1],
            )
            for a in agents
        ),
        signal_state=recording.signal_state[: step + 1],
    )  # fmt: skip
    seeing = senses(town, recording, ("CAM_FRONT", "CAM_BACK_LEFT"), 1)
    whole, part = seeing.look(recording, step * 0.05), seeing.look(cut, step * 0.05)
    assert [view.jpeg for view in whole.views] == [view.jpeg for view in part.views]
    np.testing.assert_array_equal(whole.scans[0].points_lidar, part.scans[0].points_lidar)
