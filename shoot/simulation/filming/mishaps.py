"""What went wrong on a drive and when, in words: from the same arrays that the score reads."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lss_core.geometry import FloatArray
from shoot.metrics.driving_score.collisions import Cause, Contact, find_contacts
from shoot.metrics.driving_score.facts import is_stuck
from shoot.metrics.driving_score.lights import red_touches
from shoot.metrics.driving_score.road import is_against, moves
from shoot.metrics.driving_score.surroundings import Surroundings, locate
from shoot.metrics.driving_score.time_to_collision import near_collisions
from shoot.metrics.driving_score.tracks import Others, Track

# What stops for a shorter time than this has not stopped.
_PAUSE_S = 1.0
# Told of once it is so long, or so far.
_STUCK_S, _FAR_M = 2.0, 2.0

_AT_FAULT: dict[Cause, str] = {
    "front": "",
    "side": " with its side",
    "other stands": " that stands",
}
_BLAMELESS: dict[Cause, str] = {
    "before the start": "from the start",
    "ego stands": "while standing",
    "from behind": "from behind",
    "side": "at its side",
}


@dataclass(frozen=True)
class Mishap:
    """Something that went wrong.

    Attributes:
        time_s: When it began, since the route began.
        words: What, beginning with a verb.
        xy_m: [2] where the middle of the ego then was, in the town's frame.
    """

    time_s: float
    words: str
    xy_m: FloatArray


def find_mishaps(
    ego: Track,
    others: Others,
    names: Sequence[str],
    around: Surroundings,
    strict: Surroundings,
    start_s: float = 0.0,
) -> tuple[Mishap, ...]:
    """What went wrong, in the order of time; each stretch of it is told once, where it begins.

    Args:
        ego: What was driven.
        others: At the same steps, or more.
        names: Of the others, in words.
        around: Where; all lanes may be driven in their direction.
        strict: The same, where only lanes of the route may.
        start_s: Time of the route at the ego's first step.
    """
    where = locate(ego, around)
    moved_m = moves(ego)
    is_wrong_way = is_against(ego, around, where)
    contacts = find_contacts(ego, others, where)
    told = [(contact.step, _of_contact(contact, names[contact.other])) for contact in contacts]
    at_once = {
        "leaves the road": where.off_road_m > 0.0,
        "runs a red light": red_touches(ego, around, where).any(axis=0),
    }
    pause = ego.steps_in(_PAUSE_S)
    for words, is_so in at_once.items():
        told += [(begin, words) for begin, _ in _stretches(is_so, pause)]
    for begin, _ in _stretches(near_collisions(ego, others, where), pause):
        if not any(begin <= contact.step <= begin + pause for contact in contacts):
            told.append((begin, "nearly hits something"))
    after_metres = {
        "drives in no lane of its direction": is_wrong_way,
        "strays from its route": is_against(ego, strict, where) & ~is_wrong_way,
    }
    for words, is_so in after_metres.items():
        for begin, end in _stretches(is_so, pause):
            far_m = np.cumsum(np.where(is_so, moved_m, 0.0)[begin:end])
            told += [(begin + int(step), words) for step in np.flatnonzero(far_m >= _FAR_M)[:1]]
    for begin, end in _stretches(is_stuck(ego, others, around), 1):
        if end - begin > ego.steps_in(_STUCK_S):
            told.append((begin + ego.steps_in(_STUCK_S), "stands, and nothing shows why"))
    return tuple(
        Mishap(round(start_s + step * ego.dt_s, 6), words, ego.centre_m[step])
        for step, words in sorted(told, key=lambda of: of[0])
    )


def _of_contact(contact: Contact, name: str) -> str:
    whom = f"an {name}" if name[:1] in "aeiou" else f"a {name}"
    if contact.is_at_fault and contact.kind == "object":
        return f"hits {whom}, at fault"
    if contact.is_at_fault:
        return f"hits {whom}{_AT_FAULT[contact.cause]}, at fault"
    return f"is touched by {whom} {_BLAMELESS[contact.cause]}, not at fault"


def _stretches(is_so: NDArray[np.bool_], pause: int) -> list[tuple[int, int]]:
    """Begins and ends of what is so, shorter pauses than `pause` steps left out."""
    steps = np.flatnonzero(is_so)
    if not len(steps):
        return []
    breaks = np.flatnonzero(np.diff(steps) > max(pause, 1))
    begins = steps[np.concatenate([[0], breaks + 1])]
    ends = steps[np.concatenate([breaks, [len(steps) - 1]])] + 1
    return [(int(begin), int(end)) for begin, end in zip(begins, ends, strict=True)]
