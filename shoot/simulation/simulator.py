"""The closed loop on simulated time: plans in, what is seen of where they led out."""

from itertools import islice

import numpy as np

from shoot.footprint import turn
from shoot.simulation.observation import Observation, Sights, World
from shoot.simulation.plan import Plan
from shoot.simulation.progress import next_place
from shoot.simulation.route_log import Diary, Mode, RouteLog
from shoot.simulation.senses import Senses, SensorSettings
from shoot.simulation.tracker import follow
from shoot.simulation.vehicle import PHYSICS_S, VehicleState, steering_for
from shoot.world.town.town import FloatArray, Town
from shoot.world.traffic.bodies import EgoBody
from shoot.world.traffic.live import LiveTraffic, stage

# The rule driver drives so long, so that speed and history exist.
WARM_UP_S = 2.0
REPLAN_S = 0.5
PAST_S = 2.0
STEPS_A_PLAN = round(REPLAN_S / PHYSICS_S)
NO_SENSORS = SensorSettings()
# Below this one step tells no curvature.
_TELLING_M = 0.02


class Simulator:
    """One route: a town, its traffic, and an ego that follows plans.

    The same arguments and plans give the same bytes.

    Args:
        town: Where.
        seed: Of traffic, light, weather and sensors, as of a data set's scene in this town.
        mode: `reactive`: others see the ego, follow it and give way to it. `replay`: they do what
            they did in the recording.
        sensors: What the car carries and the driver reads.
        duration_s: Length of the route, the first `WARM_UP_S` by the rule driver included.
    """

    def __init__(
        self,
        town: Town,
        seed: int,
        mode: Mode = "reactive",
        sensors: SensorSettings = NO_SENSORS,
        duration_s: float = 20.0,
    ) -> None:
        self.town = town
        self.seed = seed
        self.mode: Mode = mode
        self._settings = sensors
        self._num_steps = round(duration_s / PHYSICS_S)
        self._step = 0
        self._senses: Senses | None = None

    @property
    def time_s(self) -> float:
        """Since the route began."""
        return self._step / round(1 / PHYSICS_S)

    @property
    def is_over(self) -> bool:
        """Whether the route's time is up."""
        return self._step >= self._num_steps

    def reset(self) -> Observation:
        """Begin anew: the rule driver drives the first `WARM_UP_S`."""
        duration_s = self._num_steps * PHYSICS_S
        self._traffic: LiveTraffic = stage(self.town, self.seed, duration_s, self.mode)
        traffic = self._traffic
        self._diary = Diary(self.town.seed, self.seed, self.mode, traffic.cast, traffic.route.lanes)
        self._step = 0
        self._state = _state_after(traffic.ego, traffic.ego)
        self._route_at_m = next_place(traffic.route, self._state, traffic.route_at_m)
        self._note()
        self._drive_by_rules(round(WARM_UP_S / PHYSICS_S))
        return self._observe()

    def finish_by_rules(self) -> RouteLog:
        """What happens if the world itself drives the ego to the end of the route.

        Raises:
            RuntimeError: If the route has not begun.
        """
        if self._step == 0:
            raise RuntimeError("The route has not begun; call reset first.")
        self._drive_by_rules(self._num_steps - self._step)
        return self.log()

    def step(self, plan: Plan) -> Observation:
        """Follow a plan for `REPLAN_S`.

        Raises:
            RuntimeError: If the route is over or has not begun.
        """
        if self.is_over or self._step == 0:
            raise RuntimeError("The route is over or has not begun; call reset first.")
        self._diary.note_plan(self.time_s, plan)
        num_steps = min(STEPS_A_PLAN, self._num_steps - self._step)
        for state in islice(follow(plan, self._state), num_steps):
            body = EgoBody(np.array([state.x_m, state.y_m]), state.yaw_rad, state.speed_mps)
            self._traffic.step(body)
            self._move_to(state)
        return self._observe()

    def log(self) -> RouteLog:
        """Everything that has happened so far."""
        return self._diary.log()

    def _drive_by_rules(self, num_steps: int) -> None:
        for _ in range(num_steps):
            before = self._traffic.ego
            self._traffic.step(None)
            self._move_to(_state_after(before, self._traffic.ego))

    def _move_to(self, state: VehicleState) -> None:
        self._state = state
        self._route_at_m = next_place(self._traffic.route, state, self._route_at_m)
        self._step += 1
        self._note()

    def _note(self) -> None:
        traffic = self._traffic
        signals = traffic.plan.states(self.time_s)
        self._diary.note(self._state, self._route_at_m, traffic.bodies, signals)

    def _observe(self) -> Observation:
        log = self._diary.log()
        return Observation(
            time_s=self.time_s,
            state=self._state,
            past_m=_past(log),
            sights=self._look(log),
            world=World(self.town, self._traffic, self._route_at_m),
        )

    def _look(self, log: RouteLog) -> Sights:
        if not self._settings.cameras and not self._settings.num_scans:
            return Sights()
        recording = log.recording()
        if self._senses is None:
            self._senses = Senses(self.town, self.seed, self._settings, recording)
        return self._senses.look(recording, self.time_s)


def _state_after(before: EgoBody, now: EgoBody) -> VehicleState:
    """The state of a car that the rules have moved on by one step."""
    way_m = float(np.hypot(*(now.xy_m - before.xy_m)))
    turned = now.yaw_rad - before.yaw_rad
    return VehicleState(
        x_m=float(now.xy_m[0]),
        y_m=float(now.xy_m[1]),
        yaw_rad=now.yaw_rad,
        speed_mps=now.speed_mps,
        accel_mps2=(now.speed_mps - before.speed_mps) / PHYSICS_S,
        steering_rad=steering_for(turned / way_m) if way_m > _TELLING_M else 0.0,
    )


def _past(log: RouteLog) -> FloatArray:
    """[P, 3] see `Observation.past_m`."""
    num = min(round(PAST_S / PHYSICS_S), len(log.ego.yaw_rad) - 1)
    xy_m, yaw = log.ego.xy_m, log.ego.yaw_rad
    behind_m = turn(xy_m[-2 : -num - 2 : -1] - xy_m[-1], np.full(num, -yaw[-1]))
    return np.column_stack([behind_m, yaw[-2 : -num - 2 : -1] - yaw[-1]])
