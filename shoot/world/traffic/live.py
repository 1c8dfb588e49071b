"""Traffic that goes on around an ego driven by somebody else, from where a recording begins."""

from collections.abc import Sequence
from copy import copy
from typing import Literal

import numpy as np

from lss_core.geometry import direction_of
from shoot.world.town.town import FloatArray, Town
from shoot.world.traffic.bodies import Bodies, Cast, EgoBody, Kind
from shoot.world.traffic.cars import Car, lights_brakes
from shoot.world.traffic.driver import Route
from shoot.world.traffic.free_traffic import FreeTraffic
from shoot.world.traffic.junctions import SignalPlan
from shoot.world.traffic.scenario import (
    BURN_IN_S,
    BURN_IN_STEPS,
    choose_ego,
    populate,
    scenario_rng,
)
from shoot.world.traffic.traffic import STEP_S
from shoot.world.traffic.walkers import Pavements, Walker

Mode = Literal["reactive", "replay"]


def stage(town: Town, seed: int, duration_s: float, mode: Mode) -> "LiveTraffic":
    """The traffic of `make_scenario(town, seed, duration_s)`, settled, at the recording's begin.

    Args:
        town: Where.
        seed: Any non-negative integer.
        duration_s: For how long routes and people last, at the least; part of the chance.
        mode: Whether others answer what the ego does, or do what they did in the recording.
    """
    rng = scenario_rng(seed)
    plan, cars, walkers = populate(town, rng, duration_s)
    ego = choose_ego(cars, rng)
    traffic = FreeTraffic(town, plan, Pavements(town, plan, walkers), cars, ego)
    for step in range(BURN_IN_STEPS):
        traffic.decide(_clock_s(step))
        traffic.move_on(None)
    traffic.decide(_clock_s(BURN_IN_STEPS))
    return LiveTraffic(plan, traffic, mode)


class LiveTraffic:
    """Everybody at one moment of a scene, and how it goes on; made by `stage`.

    In `replay` the recording is driven again beside it, with its own ego: it says where the others
    are. What they would do about the ego is forgotten after each step.

    Attributes:
        cast: Everybody but the ego.
        plan: What the lights show, and when.
        route: The ego's, longer than anybody can drive in the time.
    """

    def __init__(self, plan: SignalPlan, traffic: FreeTraffic, mode: Mode) -> None:
        """Begin with traffic that has decided at the recording's time 0."""
        self.plan = plan
        self.route: Route = traffic.ego.route
        self._traffic = traffic
        self._recorded = traffic.copy() if mode == "replay" else None
        self._steps = BURN_IN_STEPS
        self.cast: Cast = _cast_of(*traffic.others())

    @property
    def time_s(self) -> float:
        """Time of the recording; 0.0 at first."""
        return round((self._steps - BURN_IN_STEPS) * STEP_S, 6)

    @property
    def ego(self) -> EgoBody:
        """Where the ego is: at first as recorded, then as `step` was told."""
        return self._traffic.body

    @property
    def route_at_m(self) -> float:
        """How far along its route the ego is; where it left it, if it has."""
        return self._traffic.ego.at_m

    @property
    def bodies(self) -> Bodies:
        """Where all others are."""
        return _bodies_of(*(self._recorded or self._traffic).others())

    def step(self, ego: EgoBody | None) -> None:
        """Move everybody on by `STEP_S` (0.1 s).

        Args:
            ego: Where the ego will then be. None: it drives by the rules, as in the recording, from
                its place on its route; one that has left the route brakes straight on.
        """
        self._steps += 1
        now_s = _clock_s(self._steps)
        self._traffic.move_on(ego)
        if self._recorded is not None:
            self._recorded.move_on(None)
            self._traffic.adopt(self._recorded)
            self._recorded.decide(now_s)
        self._traffic.decide(now_s)

    def foresee(self, seconds: float) -> tuple[FloatArray, FloatArray, FloatArray]:
        """What the ego would do by the rules from here on; nothing of this traffic changes.

        Everybody else goes on as in `step(None)`. An ego up to 2 m off its route, and up to 60
        degrees, is taken to be at the nearest point of the route. One farther off brakes straight
        on.

        Args:
            seconds: How far to look ahead.

        Returns:
            [n, 2] rear axle in the town's frame, [n] headings, [n] speeds, each `STEP_S`, the
            first a step from now.
        """
        there = copy(self)
        there._traffic = self._traffic.copy()
        if self._recorded is not None:
            there._recorded = self._recorded.copy()
        seen = []
        for _ in range(round(seconds / STEP_S)):
            there.step(None)
            seen.append(there.ego)
        return (
            np.array([body.xy_m for body in seen]).reshape(-1, 2),
            np.array([body.yaw_rad for body in seen]),
            np.array([body.speed_mps for body in seen]),
        )


def _clock_s(step: int) -> float:
    """Time of a step as `simulate` counts it, to the last bit."""
    return -BURN_IN_S + step * STEP_S


def _cast_of(cars: Sequence[Car], walkers: Sequence[Walker]) -> Cast:
    kinds: list[Kind] = ["truck" if car.is_truck else "car" for car in cars]
    kinds += ["pedestrian" for _ in walkers]
    return Cast(
        kinds=tuple(kinds),
        sizes_m=np.array([*(car.size_m for car in cars), *(w.size_m() for w in walkers)]),
        styles=(*(car.style for car in cars), *(walker.style for walker in walkers)),
    )


def _bodies_of(cars: Sequence[Car], walkers: Sequence[Walker]) -> Bodies:
    """Everybody after all have decided, which people on foot follow at once.

    Args:
        cars: Where they are.
        walkers: Where they will be a step later; their traces end where they are.
    """
    num = len(cars) + len(walkers)
    xy_m, yaw_rad = np.zeros((num, 2)), np.zeros(num)
    for i, car in enumerate(cars):
        xy_m[i : i + 1], yaw_rad[i : i + 1] = car.box(np.array([car.at_m]))
    along_m = np.zeros((len(walkers), 2))
    for i, walker in enumerate(walkers):
        place_m, along_m[i : i + 1] = walker.points(np.array(walker.trace_m[-1:]))
        xy_m[len(cars) + i] = place_m[0]
    yaw_rad[len(cars) :] = direction_of(along_m)
    paces = [(walker.at_m - walker.trace_m[-1]) / STEP_S for walker in walkers]
    speed_mps = np.array([car.speed_mps for car in cars])
    is_braking = np.zeros(num, dtype=np.bool_)
    is_braking[: len(cars)] = lights_brakes(speed_mps, np.array([car.accel_mps2 for car in cars]))
    return Bodies(xy_m, yaw_rad, np.concatenate([speed_mps, paces]), is_braking)
