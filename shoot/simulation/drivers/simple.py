"""Drivers without a network: by the rules of the world, straight on as before, not at all."""

import numpy as np

from lss_core.geometry import FloatArray
from shoot.footprint import turn
from shoot.simulation.observation import Observation
from shoot.simulation.plan import Plan

DT_S = 0.25
HORIZON_S = 5.0
# The rules stop to the millimetre before what they stop for, and drive on if they are beyond. A
# tracked car does not stop so well.
STOP_SHORT_M = 0.3
_RESTS_MPS, _SETS_OFF_M = 0.05, 0.02
_TIMES_S = np.arange(1, round(HORIZON_S / DT_S) + 1) * DT_S


def foreseen_points(
    observation: Observation, num_points: int = len(_TIMES_S), dt_s: float = DT_S
) -> FloatArray:
    """[T, 2] in `ego`: where the world's rule driver would be, from where the ego is now."""
    horizon_s = num_points * dt_s
    traffic, state = observation.world.traffic, observation.state
    xy_m, _, speed_mps = traffic.foresee(float(np.ceil(round(horizon_s * 10, 6)) / 10))
    here_m = np.array([state.x_m, state.y_m])
    ahead_m = np.concatenate([here_m[None], xy_m]) - here_m
    ahead_m = turn(ahead_m, np.full(len(ahead_m), -state.yaw_rad))
    ahead_m = stop_short(ahead_m, speed_mps)
    times_s = np.arange(len(ahead_m)) * 0.1
    asked_s = np.arange(1, num_points + 1) * dt_s
    return np.stack([np.interp(asked_s, times_s, ahead_m[:, i]) for i in (0, 1)], axis=1)


def stop_short(path_m: FloatArray, speed_mps: FloatArray) -> FloatArray:
    """The path, on which the car comes to rest `STOP_SHORT_M` before it would, if it would.

    Args:
        path_m: [n + 1, 2] from where the car is, evenly spaced in time.
        speed_mps: [n] from the second point on.
    """
    steps_m = np.hypot(*np.diff(path_m, axis=0).T)
    way_m = np.concatenate([[0.0], np.cumsum(steps_m)])
    rests = (speed_mps < _RESTS_MPS) & (way_m[1:] > _SETS_OFF_M)
    if not rests.any():
        return path_m
    stop_m = way_m[1 + int(np.argmax(rests))]
    shorter_m = way_m - min(STOP_SHORT_M, stop_m) * np.minimum(way_m / stop_m, 1.0)
    return np.stack([np.interp(shorter_m, way_m, path_m[:, i]) for i in (0, 1)], axis=1)


class RuleDriver:
    """Drives as all cars of the world do; it sees everything."""

    name = "rule"
    cameras: tuple[str, ...] = ()
    num_scans = 0

    def plan(self, observation: Observation) -> Plan:
        """What the rules would do."""
        return Plan(foreseen_points(observation), DT_S)


class ConstantVelocityDriver:
    """Goes straight on at the speed it has."""

    name = "constant_velocity"
    cameras: tuple[str, ...] = ()
    num_scans = 0

    def plan(self, observation: Observation) -> Plan:
        """Straight on."""
        ahead_m = observation.state.speed_mps * _TIMES_S
        return Plan(np.stack([ahead_m, np.zeros_like(ahead_m)], axis=1), DT_S)


class StillDriver:
    """Stops and stands."""

    name = "still"
    cameras: tuple[str, ...] = ()
    num_scans = 0

    def plan(self, observation: Observation) -> Plan:
        """Nowhere."""
        return Plan(np.zeros((len(_TIMES_S), 2)), DT_S)
