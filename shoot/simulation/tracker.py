"""The tracker: from a reference and where the car is to what brakes, engine and wheels do."""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import count

import numpy as np
from numpy.typing import NDArray

from lss_core.geometry import FloatArray
from shoot.simulation.plan import Plan
from shoot.simulation.reference import Reference, fit_reference
from shoot.simulation.vehicle import (
    PHYSICS_S,
    WHEELBASE_M,
    VehicleState,
    advance,
    steering_for,
)

HORIZON_STEPS = 10
_SPEED_COST, _ACCEL_COST = 10.0, 1.0
_LATERAL_COST = np.diag([1.0, 10.0, 0.0])  # of the place aside, the heading, the wheels
_STEERING_RATE_COST = 1.0
# Slower than this, both of them, steering makes no sense.
_CREEP_MPS, _CREEP_GAIN_PER_S = 0.2, 0.5


IndexArray = NDArray[np.int64]


@dataclass(frozen=True)
class Command:
    """What the driver's hands and feet ask for.

    Attributes:
        accel_mps2: Along the heading.
        steering_rate_radps: Positive to the left.
    """

    accel_mps2: float
    steering_rate_radps: float


def track(reference: Reference, state: VehicleState, step: int) -> Command:
    """The first of the `HORIZON_STEPS` commands that follow the reference at the least cost.

    Two linear-quadratic problems, with a cost at each step of the horizon: the speed by
    accelerations, then, at the speeds these give, place and heading beside the reference by rates
    of steering. The car's model is linear around the reference's own steering.

    Args:
        reference: In the frame of `state`.
        state: Of the car now.
        step: Steps of `PHYSICS_S` since the reference's start; behind its end its last values hold.
    """
    ahead = np.minimum(step + np.arange(HORIZON_STEPS + 1), len(reference.speed_mps) - 1)
    wished_mps = reference.speed_mps[ahead]
    if max(state.speed_mps, float(wished_mps[-1])) < _CREEP_MPS:
        return Command(_CREEP_GAIN_PER_S * (float(wished_mps[-1]) - state.speed_mps), 0.0)
    # Speed after each step, by the accelerations of all steps.
    by_accel = PHYSICS_S * np.tri(HORIZON_STEPS)
    normal = _SPEED_COST * by_accel.T @ by_accel + _ACCEL_COST * np.eye(HORIZON_STEPS)
    missing_mps = wished_mps[1:] - state.speed_mps
    accel_mps2 = np.linalg.solve(normal, _SPEED_COST * by_accel.T @ missing_mps)
    speed_mps = np.maximum(state.speed_mps + by_accel @ accel_mps2, 0.0)
    mean_mps = 0.5 * (np.concatenate([[state.speed_mps], speed_mps[:-1]]) + speed_mps)
    return Command(float(accel_mps2[0]), _steer(reference, state, ahead, mean_mps))


def follow(plan: Plan, state: VehicleState) -> Iterator[VehicleState]:
    """The states of a car that follows a plan, every `PHYSICS_S` from the first step on, endlessly.

    Args:
        plan: Made where the car is.
        state: Of the car when it begins.
    """
    here_m = np.array([state.x_m, state.y_m])
    reference = fit_reference(plan).placed(here_m, state.yaw_rad)
    for step in count():
        command = track(reference, state, step)
        state = advance(state, command.accel_mps2, command.steering_rate_radps)
        yield state


def _steer(
    reference: Reference, state: VehicleState, ahead: IndexArray, speed_mps: FloatArray
) -> float:
    """Rate of steering, at the mean speeds [N] of the horizon's steps."""
    yaw = float(reference.yaw_rad[ahead[0]])
    away_x, away_y = np.array([state.x_m, state.y_m]) - reference.xy_m[ahead[0]]
    turned = math.remainder(state.yaw_rad - yaw, 2 * math.pi)
    # What comes of no steering, and of each step's.
    beside = np.array([math.cos(yaw) * away_y - math.sin(yaw) * away_x, turned, state.steering_rad])
    by_rate = np.zeros((3, HORIZON_STEPS))
    normal = _STEERING_RATE_COST * np.eye(HORIZON_STEPS)
    slope = np.zeros(HORIZON_STEPS)
    for k in range(HORIZON_STEPS):
        way_m = float(speed_mps[k]) * PHYSICS_S
        wheels = steering_for(float(reference.curvature_per_m[ahead[k : k + 2]].mean()))
        per_rad = way_m / (WHEELBASE_M * math.cos(wheels) ** 2)
        # Within a step, heading and wheels change evenly.
        move = np.array([[1.0, way_m, way_m * per_rad / 2], [0.0, 1.0, per_rad], [0.0, 0.0, 1.0]])
        beside = move @ beside - wheels * per_rad * np.array([way_m / 2, 1.0, 0.0])
        by_rate = move @ by_rate
        by_rate[:, k] += np.array([0.0, per_rad * PHYSICS_S / 2, PHYSICS_S])
        normal += by_rate.T @ _LATERAL_COST @ by_rate
        slope += by_rate.T @ _LATERAL_COST @ beside
    return float(-np.linalg.solve(normal, slope)[0])
