"""A plan's points as a motion that a car can follow: a smooth speed and curvature, every 0.1 s.

A plan gives places, and those of a template are means of many drives: from one to the next, speed
and heading jump. So the speed is fitted to how far apart they lie, the curvature to their
directions, each against how fast it changes; places follow from both.
"""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from lss_core.geometry import FloatArray, direction_of
from shoot.footprint import STANDS_MPS, turn
from shoot.simulation.plan import Plan
from shoot.simulation.vehicle import MAX_STEERING_RAD, PHYSICS_S, WHEELBASE_M

# How far off a plan's points are thought to be, beside a car's usual jerk and change of curvature.
_POINT_M = 0.05
_JERK_MPS3 = 5.0
_CURVATURE_RATE_PER_MS = 0.2
_MAX_CURVATURE_PER_M = np.tan(MAX_STEERING_RAD) / WHEELBASE_M


@dataclass(frozen=True)
class Reference:
    """Where the car is to be at each `PHYSICS_S` from the time of planning, start included.

    Attributes:
        xy_m: [S, 2] rear axle.
        yaw_rad: [S], continuous.
        speed_mps: [S], not negative.
        curvature_per_m: [S], positive to the left.
    """

    xy_m: FloatArray
    yaw_rad: FloatArray
    speed_mps: FloatArray
    curvature_per_m: FloatArray

    def placed(self, xy_m: FloatArray, yaw_rad: float) -> "Reference":
        """The same in the frame in which the ego planned at `xy_m` [2], heading `yaw_rad`."""
        return Reference(
            xy_m + turn(self.xy_m, np.full(len(self.xy_m), yaw_rad)),
            self.yaw_rad + yaw_rad,
            self.speed_mps,
            self.curvature_per_m,
        )


def fit_reference(plan: Plan) -> Reference:
    """The motion along a plan, in `ego` at the time of planning.

    It begins at the origin with the ego's heading; its speed there is the plan's, not the ego's.
    """
    points_m = np.concatenate([np.zeros((1, 2)), np.asarray(plan.points_m, np.float64)])
    chord_m = np.diff(points_m, axis=0)
    length_m, direction_rad = _way(chord_m, plan.dt_s)
    travelled = _integrals(len(chord_m), plan.dt_s)
    speed_mps = np.maximum(_fit_speed(length_m, travelled, plan.dt_s), 0.0)
    curvature = _fit_curvature(length_m, direction_rad, travelled, speed_mps, plan.dt_s)
    way_m = 0.5 * (speed_mps[1:] + speed_mps[:-1]) * PHYSICS_S
    turned = 0.5 * (curvature[1:] + curvature[:-1]) * way_m
    yaw_rad = np.concatenate([[0.0], np.cumsum(turned)])
    middle = yaw_rad[:-1] + turned / 2
    # The chord of an arc is a little shorter than the arc.
    step_m = (way_m * np.sinc(turned / (2 * np.pi)))[:, None]
    steps_m = step_m * np.stack([np.cos(middle), np.sin(middle)], axis=1)
    xy_m = np.concatenate([np.zeros((1, 2)), np.cumsum(steps_m, axis=0)])
    return Reference(xy_m, yaw_rad, speed_mps, curvature)


def _way(chord_m: FloatArray, dt_s: float) -> tuple[FloatArray, FloatArray]:
    """([T] lengths, [T] directions, continuous) of the way from point to point.

    Where the car stands the direction of a chord [2] is noise: the way keeps the one before, or the
    ego's own, and is as long as the chord goes along it, so that noise does not add up to a way.
    """
    length_m = np.hypot(chord_m[:, 0], chord_m[:, 1])
    moves = length_m >= STANDS_MPS * dt_s
    known_rad = np.unwrap(np.concatenate([[0.0], direction_of(chord_m[moves])]))
    direction_rad = known_rad[np.cumsum(moves)]
    along_m = turn(chord_m, -direction_rad)[:, 0]
    return np.where(moves, length_m, along_m), direction_rad


def _fit_speed(length_m: FloatArray, travelled: FloatArray, dt_s: float) -> FloatArray:
    """Speeds [S] whose integrals are the lengths [T], as far as jerk allows."""
    num = travelled.shape[1]
    # Second differences of speeds are jerks.
    jerk = np.diff(np.eye(num), n=2, axis=0) / PHYSICS_S**2
    weight = (_POINT_M / _JERK_MPS3) ** 2 * PHYSICS_S / dt_s
    between = np.diff(travelled, axis=0)
    normal = between.T @ between + weight * jerk.T @ jerk
    speed_mps: FloatArray = np.linalg.solve(normal, between.T @ length_m)
    return speed_mps


def _fit_curvature(
    length_m: FloatArray,
    direction_rad: FloatArray,
    travelled: FloatArray,
    speed_mps: FloatArray,
    dt_s: float,
) -> FloatArray:
    """Curvatures [S] that turn the car into the directions [T], as far as their change allows.

    On an arc a chord points halfway between the headings at its ends. A chord counts for as much as
    it is long, where the car stands for nothing.
    """
    num = len(speed_mps)
    turned = travelled * speed_mps
    halfway = 0.5 * (turned[1:] + turned[:-1])
    lever_m = np.where(length_m >= STANDS_MPS * dt_s, length_m, 0.0)
    rows = lever_m[:, None] * halfway
    change = np.diff(np.eye(num), axis=0) / PHYSICS_S
    weight = (_POINT_M / _CURVATURE_RATE_PER_MS) ** 2 * PHYSICS_S / dt_s
    # The last term decides where nothing else does: a car that stands all the time.
    normal = rows.T @ rows + weight * change.T @ change + 1e-9 * np.eye(num)
    curvature = np.linalg.solve(normal, rows.T @ (lever_m * direction_rad))
    return np.clip(curvature, -_MAX_CURVATURE_PER_M, _MAX_CURVATURE_PER_M)


@lru_cache(maxsize=8)
def _integrals(num_points: int, dt_s: float) -> FloatArray:
    """[T + 1, S]: times speeds every `PHYSICS_S`, the way up to 0, dt_s, 2 dt_s ... .

    Between two of its values a speed runs straight.
    """
    num = int(np.ceil(num_points * dt_s / PHYSICS_S - 1e-9)) + 1
    rows = np.zeros((num_points + 1, num))
    for i in range(1, num_points + 1):
        whole, part = divmod(i * dt_s / PHYSICS_S + 1e-9, 1.0)
        k = int(whole)
        rows[i, :k] += PHYSICS_S / 2
        rows[i, 1 : k + 1] += PHYSICS_S / 2
        if k + 1 < num:
            rows[i, k] += PHYSICS_S * (part - part**2 / 2)
            rows[i, k + 1] += PHYSICS_S * part**2 / 2
    return rows
