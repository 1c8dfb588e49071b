"""Everything that happened on a route, written down as it happens."""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from lss_core.geometry import FloatArray
from shoot.simulation.plan import Plan
from shoot.simulation.vehicle import PHYSICS_S, VehicleState
from shoot.world.traffic.bodies import Bodies, Cast
from shoot.world.traffic.recording import Agent, Recording

Mode = Literal["reactive", "replay"]


@dataclass(frozen=True)
class EgoTrack:
    """The ego every `PHYSICS_S`, in the town's frame.

    Attributes:
        xy_m: [T, 2] rear axle.
        yaw_rad: [T], continuous.
        speed_mps: [T].
        accel_mps2: [T] in the step that led there.
        steering_rad: [T] positive to the left.
        route_at_m: [T] how far along its route.
    """

    xy_m: FloatArray
    yaw_rad: FloatArray
    speed_mps: FloatArray
    accel_mps2: FloatArray
    steering_rad: FloatArray
    route_at_m: FloatArray


@dataclass(frozen=True)
class AgentTracks:
    """All others every `PHYSICS_S`, in the order of the cast, in the town's frame.

    Attributes:
        xy_m: [A, T, 2] centres of their boxes.
        yaw_rad: [A, T].
        speed_mps: [A, T].
        is_braking: [A, T].
    """

    xy_m: FloatArray
    yaw_rad: FloatArray
    speed_mps: FloatArray
    is_braking: NDArray[np.bool_]


@dataclass(frozen=True)
class RouteLog:
    """Everything that happened, from time 0; the first seconds are the rule driver's.

    Attributes:
        town_seed, seed, mode: What the route was made of.
        ego: What the ego did.
        agents: What all others did.
        cast: Who they are.
        signal_state: [T, signals] as in `Recording`.
        plans: The moments of planning in seconds, and what was planned.
        route_lanes: Lanes and paths that the ego was to take, in order.
        dt_s: Time between rows.
    """

    town_seed: int
    seed: int
    mode: Mode
    ego: EgoTrack
    agents: AgentTracks
    cast: Cast
    signal_state: NDArray[np.int64]
    plans: tuple[tuple[float, Plan], ...]
    route_lanes: tuple[int, ...]
    dt_s: float = PHYSICS_S

    def recording(self) -> Recording:
        """The same as sensors read it; which lane the ego is on it does not say (-1)."""
        ego, agents, cast = self.ego, self.agents, self.cast
        num_times = len(ego.yaw_rad)
        return Recording(
            dt_s=self.dt_s,
            ego_xy_m=ego.xy_m,
            ego_yaw_rad=ego.yaw_rad,
            ego_speed_mps=ego.speed_mps,
            ego_lane=np.full(num_times, -1, np.int64),
            agents=tuple(
                Agent(
                    kind, cast.sizes_m[i], cast.styles[i], agents.xy_m[i], agents.yaw_rad[i],
                    agents.speed_mps[i], agents.is_braking[i], np.ones(num_times, np.bool_),
                )
                for i, kind in enumerate(cast.kinds)
            ),
            signal_state=self.signal_state,
        )  # fmt: skip


class Diary:
    """Takes down one moment after the other."""

    def __init__(
        self, town_seed: int, seed: int, mode: Mode, cast: Cast, route_lanes: tuple[int, ...]
    ) -> None:
        self._of_route = (town_seed, seed, mode)
        self._cast = cast
        self._route_lanes = route_lanes
        self._states: list[VehicleState] = []
        self._route_at_m: list[float] = []
        self._bodies: list[Bodies] = []
        self._signals: list[NDArray[np.int64]] = []
        self._plans: list[tuple[float, Plan]] = []

    def note(
        self,
        state: VehicleState,
        route_at_m: float,
        bodies: Bodies,
        signals: NDArray[np.int64],
    ) -> None:
        """The next moment."""
        self._states.append(state)
        self._route_at_m.append(route_at_m)
        self._bodies.append(bodies)
        self._signals.append(signals)

    def note_plan(self, time_s: float, plan: Plan) -> None:
        """What was planned at a time."""
        self._plans.append((time_s, plan))

    def log(self) -> RouteLog:
        """Everything so far."""
        states, bodies = self._states, self._bodies
        return RouteLog(
            *self._of_route,
            ego=EgoTrack(
                np.array([(s.x_m, s.y_m) for s in states]),
                np.array([s.yaw_rad for s in states]),
                np.array([s.speed_mps for s in states]),
                np.array([s.accel_mps2 for s in states]),
                np.array([s.steering_rad for s in states]),
                np.array(self._route_at_m),
            ),
            agents=AgentTracks(
                np.stack([b.xy_m for b in bodies], axis=1),
                np.stack([b.yaw_rad for b in bodies], axis=1),
                np.stack([b.speed_mps for b in bodies], axis=1),
                np.stack([b.is_braking for b in bodies], axis=1),
            ),
            cast=self._cast,
            signal_state=np.stack(self._signals),
            plans=tuple(self._plans),
            route_lanes=self._route_lanes,
        )
