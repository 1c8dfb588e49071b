"""The kinematic bicycle: arcs, brakes and limits."""

import math

import pytest

from shoot.simulation.vehicle import (
    MAX_ACCEL_MPS2,
    MAX_BRAKE_MPS2,
    MAX_STEERING_RAD,
    MAX_STEERING_RATE_RADPS,
    PHYSICS_S,
    WHEELBASE_M,
    VehicleState,
    advance,
    steering_for,
)


def test_fixed_wheels_drive_a_circle() -> None:
    """A quarter of one of 10 m to the left, from heading north: 10 m west, 10 m north."""
    quarter_m, speed = 10.0 * math.pi / 2, 5.0
    state = VehicleState(3.0, 4.0, math.pi / 2, speed, 0.0, steering_for(0.1))
    steps = 20
    for _ in range(steps):
        state = advance(state, 0.0, 0.0, quarter_m / speed / steps)
    assert (state.x_m, state.y_m, state.yaw_rad) == pytest.approx((-7.0, 14.0, math.pi))
    assert math.tan(state.steering_rad) / WHEELBASE_M == pytest.approx(0.1)


def test_evenly_gained_speed() -> None:
    state = VehicleState(0.0, 0.0, 0.0, 2.0)
    for _ in range(10):
        state = advance(state, 3.0, 0.0)
    assert (state.x_m, state.speed_mps, state.accel_mps2) == pytest.approx((3.5, 5.0, 3.0))


def test_brakes_end_at_rest_within_a_step() -> None:
    """0.2 m/s at 4 m/s2 take 0.05 s and 5 mm."""
    state = advance(VehicleState(1.0, 0.0, 0.0, 0.2), -4.0, 0.0)
    assert state.x_m == pytest.approx(1.005)
    assert state.speed_mps == 0.0
    assert state.accel_mps2 == pytest.approx(-2.0)
    assert advance(state, -4.0, 0.5).x_m == state.x_m


@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_limits(sign: float) -> None:
    state = VehicleState(0.0, 0.0, 0.0, 10.0)
    one = advance(state, sign * 99.0, sign * 99.0)
    assert one.accel_mps2 == pytest.approx(MAX_ACCEL_MPS2 if sign > 0 else -MAX_BRAKE_MPS2)
    assert one.steering_rad == pytest.approx(sign * MAX_STEERING_RATE_RADPS * PHYSICS_S)
    for _ in range(20):
        state = advance(state, 0.0, sign * 99.0)
    assert state.steering_rad == sign * MAX_STEERING_RAD
