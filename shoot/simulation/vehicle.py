"""The ego as a body that is steered: a kinematic bicycle, moved on by steps of 0.1 s."""

import math
from dataclasses import dataclass

from shoot.footprint import EGO_LENGTH_M, EGO_REAR_M

PHYSICS_S = 0.1
# Between the axles; it leaves 0.7 m before the front axle, where the footprint has 1 m behind the
# rear one.
WHEELBASE_M = 2.4
FRONT_M = EGO_LENGTH_M - EGO_REAR_M - WHEELBASE_M
# A turning circle of the rear axle of 2.8 m radius; the town's tightest paths take less.
MAX_STEERING_RAD = 0.7
MAX_STEERING_RATE_RADPS = 1.0
# Full brakes on a dry road, and what a strong car gains.
MAX_BRAKE_MPS2, MAX_ACCEL_MPS2 = 8.0, 4.0


@dataclass(frozen=True)
class VehicleState:
    """The ego at one moment, in the town's frame.

    Attributes:
        x_m, y_m: Rear axle.
        yaw_rad: Heading, continuous (unwrapped).
        speed_mps: Forward; a car does not back here.
        accel_mps2: Along the heading, in the step that led here.
        steering_rad: Angle of the front wheels, positive to the left.
    """

    x_m: float
    y_m: float
    yaw_rad: float
    speed_mps: float
    accel_mps2: float = 0.0
    steering_rad: float = 0.0


def steering_for(curvature_per_m: float) -> float:
    """Angle of the front wheels, in rad, that drives a curve; positive to the left."""
    return math.atan(WHEELBASE_M * curvature_per_m)


def advance(
    state: VehicleState,
    accel_mps2: float,
    steering_rate_radps: float,
    dt_s: float = PHYSICS_S,
) -> VehicleState:
    """The state one step later, under commands that stay within the vehicle's limits.

    The rear axle drives an arc: of the mean steering angle of the step, as long as the step's mean
    speed makes it. Brakes end at rest.

    Args:
        state: Now.
        accel_mps2: Asked for; `-MAX_BRAKE_MPS2` to `MAX_ACCEL_MPS2` is given.
        steering_rate_radps: Asked for, positive to the left; up to `MAX_STEERING_RATE_RADPS` either
            way is given, until the wheels stand at `MAX_STEERING_RAD`.
        dt_s: Length of the step.
    """
    accel = min(max(accel_mps2, -MAX_BRAKE_MPS2), MAX_ACCEL_MPS2)
    rate = min(max(steering_rate_radps, -MAX_STEERING_RATE_RADPS), MAX_STEERING_RATE_RADPS)
    turned = state.steering_rad + rate * dt_s
    steering = min(max(turned, -MAX_STEERING_RAD), MAX_STEERING_RAD)
    speed = state.speed_mps + accel * dt_s
    way_m = 0.5 * (state.speed_mps + speed) * dt_s
    if speed < 0.0:
        speed, way_m = 0.0, state.speed_mps**2 / (-2.0 * accel)
    turn = way_m * math.tan(0.5 * (state.steering_rad + steering)) / WHEELBASE_M
    chord_m = way_m * (math.sin(turn / 2) / (turn / 2) if turn else 1.0)
    return VehicleState(
        x_m=state.x_m + chord_m * math.cos(state.yaw_rad + turn / 2),
        y_m=state.y_m + chord_m * math.sin(state.yaw_rad + turn / 2),
        yaw_rad=state.yaw_rad + turn,
        speed_mps=speed,
        accel_mps2=(speed - state.speed_mps) / dt_s,
        steering_rad=steering,
    )
