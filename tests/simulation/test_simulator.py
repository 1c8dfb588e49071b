"""The loop: begun as recorded, the same for the same plans, driven by simple drivers."""

from dataclasses import replace

import numpy as np
import pytest
from world_fixture import result_beside

from shoot.simulation.drivers.driver import drive
from shoot.simulation.drivers.simple import ConstantVelocityDriver, RuleDriver, StillDriver
from shoot.simulation.plan import Plan
from shoot.simulation.route_log import RouteLog
from shoot.simulation.senses import SensorSettings
from shoot.simulation.simulator import WARM_UP_S, Simulator
from shoot.simulation.vehicle import PHYSICS_S, WHEELBASE_M
from shoot.world.town.roads import make_town
from shoot.world.town.town import Town
from shoot.world.traffic.scenario import make_scenario

TOWN, SEED, DURATION_S = 5, 2, 7.0
SMALL_CAR = SensorSettings(image_scale=0.05, lidar_azimuths=48)
TURNED_RAD = 0.25 * np.arange(1, 21)
SHARP_LEFT = Plan(6.0 * np.stack([np.sin(TURNED_RAD), 1.0 - np.cos(TURNED_RAD)], axis=1))
WARM_UP_STEPS = round(WARM_UP_S / PHYSICS_S)


@pytest.fixture(scope="module")
def town() -> Town:
    return make_town(TOWN)


def simple_drives() -> dict[str, RouteLog]:
    town = make_town(TOWN)
    drivers = (RuleDriver(), StillDriver(), ConstantVelocityDriver())
    return {d.name: drive(d, town, SEED, "replay", SMALL_CAR, DURATION_S) for d in drivers}


@pytest.fixture(scope="module")
def logs() -> dict[str, RouteLog]:
    """Each simple driver's route."""
    found: dict[str, RouteLog] = result_beside(simple_drives)
    return found


@pytest.fixture(scope="module")
def ruled(logs: dict[str, RouteLog]) -> RouteLog:
    return logs["rule"]


def test_a_route_begins_as_it_was_recorded(town: Town, ruled: RouteLog) -> None:
    recording = make_scenario(town, SEED, DURATION_S)
    num = WARM_UP_STEPS + 1
    np.testing.assert_allclose(ruled.ego.xy_m[:num], recording.ego_xy_m[::2][:num], atol=1e-6)
    np.testing.assert_allclose(ruled.ego.yaw_rad[:num], recording.ego_yaw_rad[::2][:num], atol=1e-6)
    np.testing.assert_array_equal(ruled.signal_state, recording.signal_state[::2])
    assert ruled.ego.speed_mps[WARM_UP_STEPS] > 2.0  # else the tests below test nothing


def test_driven_by_the_rules_the_ego_does_as_recorded(town: Town, ruled: RouteLog) -> None:
    recording = make_scenario(town, SEED, DURATION_S)
    off_m = np.hypot(*(ruled.ego.xy_m - recording.ego_xy_m[::2]).T)
    assert off_m.max() < 1.0
    assert np.hypot(*(ruled.ego.xy_m[-1] - ruled.ego.xy_m[0])) > 20.0


def test_the_log_is_of_one_length_and_obeys_the_vehicle(ruled: RouteLog) -> None:
    num_times, num_agents = round(DURATION_S / PHYSICS_S) + 1, len(ruled.cast.kinds)
    ego = ruled.ego
    assert ego.xy_m.shape == (num_times, 2)
    assert ruled.agents.xy_m.shape == (num_agents, num_times, 2)
    assert ruled.signal_state.shape[0] == num_times
    assert [time_s for time_s, _ in ruled.plans] == [2.0 + 0.5 * k for k in range(10)]
    way_m = np.hypot(*np.diff(ego.xy_m[WARM_UP_STEPS:], axis=0).T)
    speed_mps = ego.speed_mps[WARM_UP_STEPS:]
    np.testing.assert_allclose(way_m, 0.05 * (speed_mps[1:] + speed_mps[:-1]), atol=2e-3)
    wheels = ego.steering_rad[WARM_UP_STEPS:]
    turned = np.tan(0.5 * (wheels[1:] + wheels[:-1])) / WHEELBASE_M * way_m
    np.testing.assert_allclose(np.diff(ego.yaw_rad[WARM_UP_STEPS:]), turned, atol=1e-4)


def test_who_plans_to_stand_stands_and_who_keeps_its_velocity_keeps_it(
    logs: dict[str, RouteLog],
) -> None:
    assert logs["still"].ego.speed_mps[-1] < 0.05
    speed_mps = logs["constant_velocity"].ego.speed_mps[WARM_UP_STEPS:]
    assert speed_mps == pytest.approx(speed_mps[0], abs=1e-6)


def left_drives() -> list[list[bytes]]:
    """All that was seen and done, in two simulators, and in one that is reset."""
    car = replace(SMALL_CAR, cameras=("CAM_FRONT_LEFT",), num_scans=2)
    town = make_town(TOWN)
    simulators = [Simulator(town, SEED, "reactive", car, 3.0) for _ in range(2)]
    drives = []
    for simulator in (*simulators, simulators[0]):
        sights = [simulator.reset().sights]
        while not simulator.is_over:
            sights.append(simulator.step(SHARP_LEFT).sights)
        seen = [view.jpeg for s in sights for view in s.views]
        seen += [scan.points_lidar.tobytes() for s in sights for scan in s.scans]
        log = simulator.log()
        drives.append([*seen, log.ego.xy_m.tobytes(), log.agents.xy_m.tobytes()])
    return drives


def test_the_same_plans_give_the_same_bytes() -> None:
    first, second, again = result_beside(left_drives)
    assert len(first) == 3 + 3 * 2 + 2
    assert len(set(first)) == len(first)
    assert first == second == again


def test_cameras_see_from_where_the_ego_came_to(town: Town) -> None:
    """After a turn that nobody recorded, a camera's pose is that of its shutter's time."""
    car = replace(SMALL_CAR, cameras=("CAM_FRONT",))
    simulator = Simulator(town, SEED, "replay", car, 3.0)
    simulator.reset()
    observation = simulator.step(SHARP_LEFT)
    (view,) = observation.sights.views
    state = observation.state
    # 0.035 s before, on the chord of the last step.
    x_m, y_m, turned = observation.past_m[0] * 0.35
    away = view.ego_from_camera[:3, 3] - view.egocam_from_camera[:3, 3]
    cos, sin = np.cos(turned), np.sin(turned)
    mount_x, mount_y = view.egocam_from_camera[:2, 3]
    asked = (x_m + (cos - 1) * mount_x - sin * mount_y, y_m + sin * mount_x + (cos - 1) * mount_y)
    np.testing.assert_allclose(away, [*asked, 0.0], atol=1e-9)
    assert turned < -0.001
    assert state.steering_rad > 0.1


def test_what_is_over_or_not_begun_takes_no_plan(town: Town) -> None:
    plan = Plan(np.zeros((20, 2)))
    simulator = Simulator(town, SEED, "replay", SMALL_CAR, 2.5)
    with pytest.raises(RuntimeError, match="call reset"):
        simulator.step(plan)
    simulator.reset()
    simulator.step(plan)
    assert simulator.is_over
    with pytest.raises(RuntimeError, match="call reset"):
        simulator.step(plan)
    with pytest.raises(ValueError, match="finite points"):
        Plan(np.full((20, 2), np.nan))
