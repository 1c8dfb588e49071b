"""Whom the ego touched, and whether it was its fault: NC, no collision at fault."""

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from jaxtyping import Bool, Float

from lss_core.geometry import direction_of, wrap_angle
from shoot.footprint import EGO_WIDTH_M
from shoot.metrics.driving_score.surroundings import Whereabouts
from shoot.metrics.driving_score.tracks import Kind, Others, Track

Array = np.ndarray[Any, np.dtype[Any]]

# Up to this speed one stands, whoever it is.
STANDING_MPS = 0.05
AHEAD_RAD, BEHIND_RAD = np.deg2rad(30.0), np.deg2rad(150.0)
# What hitting a thing costs, where hitting an agent costs all.
_OBJECT_SCORE = 0.5

Cause = Literal["before the start", "ego stands", "other stands", "from behind", "front", "side"]


@dataclass(frozen=True)
class Contact:
    """The first time that the ego and another share ground.

    Attributes:
        other: Its place in `Others`.
        kind: What it is.
        step: When.
        time_s: The same, from step 0 on.
        cause: How it came to it, see `find_contacts`.
        is_at_fault: Whether the ego is to blame.
    """

    other: int
    kind: Kind
    step: int
    time_s: float
    cause: Cause
    is_at_fault: bool


def off_heading(ego: Track, step: Array, points_m: Float[Array, "*S 2"]) -> Float[Array, "*S"]:
    """Angle in [0, pi] between the ego's heading at a step and the way from its rear axle there."""
    away_rad = direction_of(points_m - ego.xy_m[step])
    return np.abs(wrap_angle(away_rad - ego.yaw_rad[step]))


def find_contacts(ego: Track, others: Others, where: Whereabouts) -> tuple[Contact, ...]:
    """The first contact with each other, in the order of time and then of `Others`.

    The first of these that holds is the cause:

    - "before the start": they share ground at step 0. Not at fault.
    - "ego stands": it drives at most 0.05 m/s. Not at fault.
    - "other stands": at most 0.05 m/s. At fault.
    - "from behind": its middle lies more than 150 degrees off the heading, seen from the ego's rear
      axle. Not at fault.
    - "front": it touches the front bumper. At fault.
    - "side": at fault while the ego is in several lanes or off the road.

    One that has been touched is not looked at again.
    """
    touches = others.overlap(ego.centre_m, ego.yaw_rad)
    who = np.flatnonzero(touches.any(axis=1))
    when = touches[who].argmax(axis=1)
    order = np.lexsort((who, when))
    on_bumper = _on_bumper(ego, others)
    off_rad = off_heading(ego, when, others.centre_m[who, when])
    is_astray = where.is_in_several_lanes | (where.off_road_m > 0.0)
    contacts = []
    for i in order:
        other, step = int(who[i]), int(when[i])
        cause: Cause
        if step == 0:
            cause = "before the start"
        elif abs(ego.speed_mps[step]) <= STANDING_MPS:
            cause = "ego stands"
        elif abs(others.speed_mps[other, step]) <= STANDING_MPS:
            cause = "other stands"
        elif off_rad[i] > BEHIND_RAD:
            cause = "from behind"
        else:
            cause = "front" if on_bumper[other, step] else "side"
        at_fault = cause in ("other stands", "front") or (cause == "side" and is_astray[step])
        time_s = step * ego.dt_s
        contacts.append(Contact(other, others.kinds[other], step, time_s, cause, bool(at_fault)))
    return tuple(contacts)


def no_collision(contacts: tuple[Contact, ...]) -> float:
    """NC: 0 if an agent was hit at fault, 1/2 if only things were, else 1."""
    costs = [_OBJECT_SCORE if c.kind == "object" else 0.0 for c in contacts if c.is_at_fault]
    return min(costs, default=1.0)


def _on_bumper(ego: Track, others: Others) -> Bool[Array, "A T"]:
    """Whether the front edge of the footprint, a rectangle without length, meets each other."""
    middle_m = ego.corners_m[:, [0, 3]].mean(axis=1)
    return others.overlap(middle_m, ego.yaw_rad, np.array([0.0, EGO_WIDTH_M]))
