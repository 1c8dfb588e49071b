"""Stand-in: others as they were recorded, whatever the ego does."""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from shoot.world.town.town import FloatArray, Town
from shoot.world.traffic.driver import Route, follow_lanes
from shoot.world.traffic.junctions import SignalPlan, plan_signals
from shoot.world.traffic.scenario import make_scenario
from shoot.world.traffic.traffic import STEP_S

Mode = Literal["reactive", "replay"]
AHEAD_S = 6.0


@dataclass(frozen=True)
class EgoBody:
    """What others see of the ego now."""

    xy_m: FloatArray
    yaw_rad: float
    speed_mps: float


@dataclass(frozen=True)
class Cast:
    """Who there is."""

    kinds: tuple[Literal["car", "truck", "pedestrian"], ...]
    sizes_m: FloatArray
    styles: tuple[int, ...]


@dataclass(frozen=True)
class Bodies:
    """All others at one moment."""

    xy_m: FloatArray
    yaw_rad: FloatArray
    speed_mps: FloatArray
    is_braking: NDArray[np.bool_]


class LiveTraffic:
    """Others around an ego."""

    def __init__(self, town: Town, seed: int, duration_s: float) -> None:
        self._recording = make_scenario(town, seed, duration_s + AHEAD_S)
        agents = self._recording.agents
        self.cast = Cast(
            tuple(a.kind for a in agents),
            np.array([a.size_m for a in agents]).reshape(-1, 3),
            tuple(a.style for a in agents),
        )
        self.plan: SignalPlan = plan_signals(town, np.random.default_rng([seed, 0x71]))
        lanes = list(dict.fromkeys(self._recording.ego_lane.tolist()))
        self.route: Route = follow_lanes([town.lanes[i] for i in lanes], 1.0)
        self._step = 0
        self.ego = self._recorded(0)

    @property
    def time_s(self) -> float:
        """Recording time."""
        return self._step * STEP_S

    @property
    def bodies(self) -> Bodies:
        """All others now."""
        row, agents = 2 * self._step, self._recording.agents
        return Bodies(
            np.array([a.xy_m[row] for a in agents]).reshape(-1, 2),
            np.array([a.yaw_rad[row] for a in agents]),
            np.array([a.speed_mps[row] for a in agents]),
            np.array([a.is_braking[row] for a in agents], bool),
        )

    def _recorded(self, step: int) -> EgoBody:
        r = self._recording
        row = min(2 * step, len(r.ego_yaw_rad) - 1)
        return EgoBody(r.ego_xy_m[row], float(r.ego_yaw_rad[row]), float(r.ego_speed_mps[row]))

    def step(self, ego: EgoBody | None) -> None:
        """Move everybody on."""
        self._step += 1
        self.ego = self._recorded(self._step) if ego is None else ego

    def foresee(self, seconds: float) -> tuple[FloatArray, FloatArray, FloatArray]:
        """What the ego would do."""
        count = round(seconds / STEP_S)
        bodies = [self._recorded(self._step + k) for k in range(1, count + 1)]
        return (
            np.array([b.xy_m for b in bodies]),
            np.array([b.yaw_rad for b in bodies]),
            np.array([b.speed_mps for b in bodies]),
        )


def stage(town: Town, seed: int, duration_s: float, mode: Mode) -> LiveTraffic:
    """Others of a recording."""
    return LiveTraffic(town, seed, duration_s)
