"""A driven route as scores ask for it: the ego's track, all others, its surroundings, its plans.

Scores begin when the rule driver hands over; what came before is history.
"""

from dataclasses import dataclass
from itertools import islice

import numpy as np

from lss_core.geometry import FloatArray
from shoot.metrics.driving_score.tracks import Others, Track
from shoot.simulation.plan import Plan
from shoot.simulation.route_log import RouteLog
from shoot.simulation.routes.ground import Ground, ground_of_route
from shoot.simulation.routes.standing import standing_things
from shoot.simulation.simulator import WARM_UP_S
from shoot.simulation.tracker import follow
from shoot.simulation.vehicle import PHYSICS_S, VehicleState
from shoot.world.town.town import Town

FIRST_STEP = round(WARM_UP_S / PHYSICS_S)
HISTORY_STEPS = round(1.5 / PHYSICS_S)
# navsim compares plans of 4 s.
PLAN_STEPS = round(4.0 / PHYSICS_S)
# What is further off than this is never touched.
_REACH_M = 20.0


@dataclass(frozen=True)
class RouteScene:
    """What the functions of `shoot.metrics.driving_score` take, in the town's frame.

    Attributes:
        ego: From the hand-over on.
        others: At the ego's steps: the cast, then what stands near its way.
        names: Of the others, in words.
        ground: Road, lanes, route and lights.
        history: The 1.5 s before.
        plans: Each as the tracker drives it for 4 s, were it left to it.
    """

    ego: Track
    others: Others
    names: tuple[str, ...]
    ground: Ground
    history: Track
    plans: tuple[Track, ...]


def scene_of(log: RouteLog, town: Town) -> RouteScene:
    """What there is to score of a route.

    Args:
        log: Of a whole route.
        town: Its town.

    Raises:
        ValueError: If the log is of another town, or ends before anybody took over.
    """
    if log.town_seed != town.seed:
        raise ValueError(f"The route is of town {log.town_seed}, got town {town.seed}.")
    if len(log.ego.yaw_rad) <= FIRST_STEP:
        raise ValueError(f"A route is scored from {WARM_UP_S:g} s on, this one is not so long.")
    ego = _track(log, slice(FIRST_STEP, None))
    others, names = _others(log, town, ego)
    return RouteScene(
        ego=ego,
        others=others,
        names=names,
        ground=ground_of_route(
            town,
            log.route_lanes,
            log.ego.route_at_m[FIRST_STEP:],
            ego,
            log.signal_state[FIRST_STEP:],
        ),
        history=_track(log, slice(FIRST_STEP - HISTORY_STEPS, FIRST_STEP)),
        plans=tuple(_roll_out(log, time_s, plan) for time_s, plan in log.plans),
    )


def _track(log: RouteLog, steps: slice) -> Track:
    ego = log.ego
    return Track(ego.xy_m[steps], ego.yaw_rad[steps], ego.speed_mps[steps], log.dt_s)


def _others(log: RouteLog, town: Town, ego: Track) -> tuple[Others, tuple[str, ...]]:
    low_m, high_m = ego.xy_m.min(axis=0) - _REACH_M, ego.xy_m.max(axis=0) + _REACH_M

    def is_near(xy_m: FloatArray, reach_m: float) -> bool:
        return bool(((xy_m > low_m - reach_m) & (xy_m < high_m + reach_m)).all())

    things = [one for one in standing_things(town) if is_near(one.xy_m, float(one.size_m.max()))]
    num, steps = len(things), len(ego)
    agents = log.agents
    standing_m = np.array([one.xy_m for one in things]).reshape(num, 1, 2)
    standing_rad = np.array([one.yaw_rad for one in things]).reshape(num, 1)
    centre_m = [agents.xy_m[:, FIRST_STEP:], np.tile(standing_m, (1, steps, 1))]
    yaw_rad = [agents.yaw_rad[:, FIRST_STEP:], np.tile(standing_rad, steps)]
    speed_mps = [agents.speed_mps[:, FIRST_STEP:], np.zeros((num, steps))]
    size_m = [log.cast.sizes_m[:, :2], np.array([one.size_m for one in things]).reshape(num, 2)]
    others = Others(
        centre_m=np.concatenate(centre_m),
        yaw_rad=np.concatenate(yaw_rad),
        speed_mps=np.concatenate(speed_mps),
        size_m=np.concatenate(size_m),
        is_present=np.ones((len(log.cast.kinds) + num, steps), dtype=np.bool_),
        kinds=(*log.cast.kinds, *(one.kind for one in things)),
    )
    return others, (*log.cast.kinds, *(one.name for one in things))


def _state(log: RouteLog, step: int) -> VehicleState:
    ego = log.ego
    return VehicleState(
        x_m=float(ego.xy_m[step, 0]),
        y_m=float(ego.xy_m[step, 1]),
        yaw_rad=float(ego.yaw_rad[step]),
        speed_mps=float(ego.speed_mps[step]),
        accel_mps2=float(ego.accel_mps2[step]),
        steering_rad=float(ego.steering_rad[step]),
    )


def _roll_out(log: RouteLog, time_s: float, plan: Plan) -> Track:
    """A plan as the tracker would drive it."""
    start = _state(log, round(time_s / log.dt_s))
    states = [start, *islice(follow(plan, start), PLAN_STEPS)]
    return Track(
        np.array([(one.x_m, one.y_m) for one in states]),
        np.array([one.yaw_rad for one in states]),
        np.array([one.speed_mps for one in states]),
        log.dt_s,
    )
