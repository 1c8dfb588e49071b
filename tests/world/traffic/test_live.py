from typing import get_args

import numpy as np
import pytest

from shoot.world.town.roads import make_town
from shoot.world.town.town import Town
from shoot.world.traffic.bodies import EgoBody
from shoot.world.traffic.live import LiveTraffic, Mode, stage
from shoot.world.traffic.recording import Recording
from shoot.world.traffic.scenario import make_scenario
from shoot.world.traffic.traffic import STEP_S

DURATION_S = 8.0
NUM_STEPS = round(DURATION_S / STEP_S)
SEEDS = (1, 4)
MODES: tuple[Mode, ...] = get_args(Mode)


@pytest.fixture(scope="module")
def town() -> Town:
    return make_town(3)


@pytest.fixture(scope="module")
def recordings(town: Town) -> dict[int, Recording]:
    return {seed: make_scenario(town, seed, DURATION_S) for seed in SEEDS}


def _body(recording: Recording, step: int) -> EgoBody:
    i = step * round(STEP_S / recording.dt_s)
    return EgoBody(
        recording.ego_xy_m[i],
        float(recording.ego_yaw_rad[i]),
        float(recording.ego_speed_mps[i]),
    )


def _is_as_recorded(live: LiveTraffic, recording: Recording, step: int) -> None:
    """Others near are where they were, point where they did and brake when they did."""
    if step % 6:
        return
    i = step * round(STEP_S / recording.dt_s)
    bodies = live.bodies
    for agent in recording.agents:
        away_m = np.hypot(*(bodies.xy_m - agent.xy_m[i]).T)
        same = [
            k
            for k in np.flatnonzero(away_m < 1e-6)
            if live.cast.styles[k] == agent.style and live.cast.kinds[k] == agent.kind
        ]
        assert len(same) == 1
        assert bodies.yaw_rad[same[0]] == pytest.approx(agent.yaw_rad[i], abs=1e-6)
        assert bodies.is_braking[same[0]] == agent.is_braking[i]
        if agent.kind != "pedestrian":
            assert bodies.speed_mps[same[0]] == pytest.approx(agent.speed_mps[i], abs=1e-6)


@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize("seed", SEEDS)
def test_an_ego_left_to_the_rules_makes_the_recording(
    town: Town, recordings: dict[int, Recording], seed: int, mode: Mode
) -> None:
    live, recording = stage(town, seed, DURATION_S, mode), recordings[seed]
    assert live.time_s == 0.0
    for step in range(NUM_STEPS + 1):
        if step:
            live.step(None)
        body = _body(recording, step)
        np.testing.assert_allclose(live.ego.xy_m, body.xy_m, atol=1e-9)
        assert live.ego.yaw_rad == pytest.approx(body.yaw_rad, abs=1e-9)
        assert live.ego.speed_mps == pytest.approx(body.speed_mps, abs=1e-9)
        _is_as_recorded(live, recording, step)
    assert live.time_s == DURATION_S


@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize("seed", SEEDS)
def test_an_ego_that_drives_as_recorded_changes_nothing(
    town: Town, recordings: dict[int, Recording], seed: int, mode: Mode
) -> None:
    live, recording = stage(town, seed, DURATION_S, mode), recordings[seed]
    for step in range(1, NUM_STEPS + 1):
        live.step(_body(recording, step))
        _is_as_recorded(live, recording, step)


@pytest.mark.parametrize("mode", MODES)
def test_in_the_recordings_state_the_ego_foresees_the_recording(
    town: Town, recordings: dict[int, Recording], mode: Mode
) -> None:
    for seed, recording in recordings.items():
        live = stage(town, seed, DURATION_S, mode)
        for _ in range(25):
            live.step(None)
        xy_m, yaw_rad, speed_mps = live.foresee(5.0)
        bodies = [_body(recording, 25 + step) for step in range(1, 51)]
        np.testing.assert_allclose(xy_m, [body.xy_m for body in bodies], atol=1e-9)
        np.testing.assert_allclose(yaw_rad, [body.yaw_rad for body in bodies], atol=1e-9)
        np.testing.assert_allclose(speed_mps, [body.speed_mps for body in bodies], atol=1e-9)
