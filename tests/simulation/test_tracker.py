"""A plan is followed: speed and wheels take the car where the points lie."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from shoot.simulation.plan import Plan
from shoot.simulation.reference import fit_reference
from shoot.simulation.tracker import Command, track
from shoot.simulation.vehicle import PHYSICS_S, VehicleState, advance, steering_for

TIMES_S = 0.25 * np.arange(1, 21)
HERE = VehicleState(31.0, -7.0, 2.3, 0.0)
RADIUS_M = 12.0


def straight(way_m: Callable[[np.ndarray], np.ndarray]) -> np.ndarray:
    return np.stack([way_m(TIMES_S), np.zeros(20)], axis=1)


def circle() -> np.ndarray:
    """6 m/s to the left."""
    turned = 6.0 / RADIUS_M * TIMES_S
    return RADIUS_M * np.stack([np.sin(turned), 1.0 - np.cos(turned)], axis=1)


def lane_change() -> np.ndarray:
    """One lane to the left within 4 s at 10 m/s."""
    share = np.minimum(TIMES_S / 4.0, 1.0)
    return np.stack([10.0 * TIMES_S, 3.5 * (3 * share**2 - 2 * share**3)], axis=1)


def stopping(times_s: np.ndarray) -> np.ndarray:
    """From 8 m/s at 2.4 m/s2, then at rest."""
    braked_s = np.minimum(times_s, 8.0 / 2.4)
    return 8.0 * braked_s - 1.2 * braked_s**2


# Points, speed and curvature at the start, and how far off the car may be in 4 s, along and aside.
DRIVES = {
    "straight": (straight(lambda t: 8.0 * t), 8.0, 0.0, 0.001, 0.001),
    "circle": (circle(), 6.0, 1 / RADIUS_M, 0.02, 0.02),
    "into a circle": (circle(), 6.0, 0.0, 0.15, 0.25),
    "lane change": (lane_change(), 10.0, 0.0, 0.03, 0.06),
    "stop": (straight(stopping), 8.0, 0.0, 0.45, 0.001),
    "setting off": (straight(lambda t: t**2), 0.0, 0.0, 0.25, 0.001),
    "standing": (np.zeros((20, 2)), 0.0, 0.0, 0.0, 0.0),
}


def follow(points_m: np.ndarray, state: VehicleState, steps: int = 40) -> list[VehicleState]:
    here_m = np.array([state.x_m, state.y_m])
    reference = fit_reference(Plan(points_m)).placed(here_m, state.yaw_rad)
    states = [state]
    for k in range(steps):
        command = track(reference, states[-1], k)
        states.append(advance(states[-1], command.accel_mps2, command.steering_rate_radps))
    return states


def in_start(states: list[VehicleState]) -> np.ndarray:
    """[S, 2] where the car is, seen from its start."""
    away = np.array([(s.x_m - states[0].x_m, s.y_m - states[0].y_m) for s in states])
    cos, sin = np.cos(states[0].yaw_rad), np.sin(states[0].yaw_rad)
    return away @ np.array([[cos, -sin], [sin, cos]])


@pytest.mark.parametrize("name", DRIVES)
def test_a_plan_is_followed(name: str) -> None:
    points_m, speed, curvature, along_m, aside_m = DRIVES[name]
    start = replace(HERE, speed_mps=speed, steering_rad=steering_for(curvature))
    # Every fifth step of 0.1 s is every second point of 0.25 s.
    off_m = in_start(follow(points_m, start))[5::5] - points_m[1:16:2]
    ahead = np.diff(np.concatenate([[[0.0, 0.0]], points_m]), axis=0)[1:16:2]
    ahead = ahead / np.maximum(np.hypot(*ahead.T), 1e-9)[:, None]
    ahead[np.hypot(*ahead.T) < 0.5] = (1.0, 0.0)
    assert np.abs((off_m * ahead).sum(1)).max() <= along_m
    assert np.abs(ahead[:, 0] * off_m[:, 1] - ahead[:, 1] * off_m[:, 0]).max() <= aside_m


def test_a_perfect_plan_of_constant_speed_asks_for_nothing() -> None:
    state = replace(HERE, speed_mps=7.0)
    here_m = np.array([state.x_m, state.y_m])
    reference = fit_reference(Plan(straight(lambda t: 7.0 * t))).placed(here_m, state.yaw_rad)
    command = track(reference, state, 0)
    assert command.accel_mps2 == pytest.approx(0.0, abs=1e-6)
    assert command.steering_rate_radps == pytest.approx(0.0, abs=1e-6)


def test_left_and_right_are_mirrored() -> None:
    rng = np.random.default_rng(4)
    points_m = lane_change() + rng.normal(0.0, 0.05, (20, 2))
    start = VehicleState(0.0, 0.0, 0.0, 9.0, 0.0, 0.03)
    left = in_start(follow(points_m, start))
    right = in_start(follow(points_m * [1.0, -1.0], replace(start, steering_rad=-0.03)))
    np.testing.assert_allclose(left, right * [1.0, -1.0], atol=1e-9)


def test_a_standing_car_with_a_standing_plan_stays() -> None:
    jitter = np.random.default_rng(5).normal(0.0, 0.005, (20, 2))
    states = follow(jitter, HERE, 50)
    assert np.hypot(*in_start(states)[-1]) < 0.03
    assert track(fit_reference(Plan(np.zeros((20, 2)))), replace(HERE, x_m=0.0), 0) == Command(
        0.0, 0.0
    )


def test_where_a_plan_stands_its_noise_does_not_steer() -> None:
    points_m = straight(stopping)
    noisy = points_m + np.random.default_rng(6).normal(0.0, 0.01, points_m.shape)
    turned = [s.yaw_rad - HERE.yaw_rad for s in follow(noisy, replace(HERE, speed_mps=8.0), 50)]
    assert np.abs(turned).max() < 0.03


def test_the_fit_takes_noise_out_and_keeps_places() -> None:
    clean = circle()
    noisy = clean + np.random.default_rng(7).normal(0.0, 0.03, clean.shape)
    reference = fit_reference(Plan(noisy))
    assert reference.xy_m.shape == (51, 2)
    at_s = np.arange(51) * PHYSICS_S
    places = np.stack([np.interp(TIMES_S, at_s, reference.xy_m[:, i]) for i in (0, 1)], axis=1)
    assert np.hypot(*(places - clean).T).max() < 0.15
    assert np.abs(np.diff(reference.speed_mps)).max() < 0.25
    # Read off the points themselves, speed jumps by four times that and more.
    raw = np.hypot(*np.diff(noisy, axis=0).T) / 0.25
    assert np.abs(np.diff(raw)).max() > 0.25
