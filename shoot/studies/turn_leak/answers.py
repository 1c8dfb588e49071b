"""Asks a planner, before each intersection, which way the ego will go: it must not know.

The hidden route must not be visible. What a planner believes is the mass of its templates that
lead through the intersection on each way the ego's lane allows. Ways differ in how many templates
lead there and how many seconds it takes, so a belief is compared with what the same planner
believes on average where the same directions are open, at about the same distance. Each approach
counts once, however many samples were taken on it.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
import shapely
from jaxtyping import Bool, Float, Int

Array = np.ndarray[Any, np.dtype[Any]]
Direction = Literal["left", "straight", "right"]
Stage = Literal["hidden", "others", "ego"]

# A template takes a way if it ends near it and clearly nearer to it than to any other.
NEAR_WAY_M, PARTED_M = 4.0, 2.5
# Places whose distance to their intersection differs by less than about this are alike.
ALIKE_M = 8.0
# A share below this is no stronger belief.
LEAST_SHARE = 1e-3


@dataclass(frozen=True)
class Question:
    """One sample before an intersection at which the ego has a choice.

    Attributes:
        position: Place of the sample in its split.
        scene: Name of its scene.
        approach: Number of the approach in its scene.
        directions: How each of W ways crosses the intersection.
        ways_m: Per way [P, 2] points from the ego on, in metres in `ego`.
        taken: The way it takes.
        distance_m: To the intersection, along the lane.
        is_single_lane: Whether the road has one lane a side.
        stage: What can tell the way: nothing at all (`hidden`), what other road users do
            (`others`), or already the ego's own braking or waiting (`ego`).
    """

    position: int
    scene: str
    approach: int
    directions: tuple[Direction, ...]
    ways_m: tuple[Array, ...]
    taken: int
    distance_m: float
    is_single_lane: bool
    stage: Stage


def ways_of_paths(
    paths: Float[Array, "K T 2"], ways_m: Sequence[Float[Array, "_ 2"]]
) -> Int[Array, " K"]:
    """Which way each path has taken by its end; -1 if none, or if they have not parted there.

    Args:
        paths: Points in metres in `ego`.
        ways_m: Ways in metres in `ego`, at least one.
    """
    ends = np.array(shapely.points(paths[:, -1].astype(np.float64)), dtype=object)
    lines = np.array([shapely.LineString(way_m) for way_m in ways_m])
    distance_m = shapely.distance(ends[:, None], lines)
    order = np.sort(distance_m, axis=1)
    # Driving back is no way on.
    taken = (order[:, 0] < NEAR_WAY_M) & (paths[:, -1, 0] > 0.0)
    if len(ways_m) > 1:
        taken &= order[:, 1] > order[:, 0] + PARTED_M
    return np.where(taken, distance_m.argmin(axis=1), -1)


@dataclass(frozen=True)
class Answers:
    """What a planner believes about Q questions, of which not all can be answered.

    Attributes:
        questions: Those for which every way has a template that leads through.
        log_shares: Per question [W] log of the share of the mass that goes each way.
        beliefs: The same less what the planner believes on average in such places.
        is_shown: [Q] whether the way taken shows within the horizon of the templates.
        num_unanswerable: Questions left out since a way has no template.
    """

    questions: tuple[Question, ...]
    log_shares: tuple[Array, ...]
    beliefs: tuple[Array, ...]
    is_shown: Bool[Array, " Q"]
    num_unanswerable: int


def answer(
    questions: Sequence[Question],
    log_probs: Float[Array, "S K"],
    templates: Float[Array, "K T 2"],
    futures: Float[Array, "S T 2"],
) -> Answers:
    """Read a planner's beliefs off its template probabilities.

    Args:
        questions: About samples of a split.
        log_probs: Of the templates, for all samples of the split.
        templates: In metres in `ego`.
        futures: Driven, of all samples of the split.
    """
    kept, shares, shown = [], [], []
    for question in questions:
        way_of = ways_of_paths(templates, question.ways_m)
        own = log_probs[question.position].astype(np.float64)
        masses = [own[way_of == way] for way in range(len(question.ways_m))]
        if not all(len(mass) for mass in masses):
            continue
        log_mass = np.array([np.logaddexp.reduce(mass) for mass in masses])
        kept.append(question)
        shares.append(log_mass - np.logaddexp.reduce(log_mass))
        driven = ways_of_paths(futures[question.position][None], question.ways_m)
        shown.append(int(driven[0]) == question.taken)
    return Answers(
        tuple(kept),
        tuple(shares),
        _beyond_reference(kept, shares),
        np.array(shown, dtype=np.bool_),
        len(questions) - len(kept),
    )


def _beyond_reference(
    questions: Sequence[Question], log_shares: Sequence[Array]
) -> tuple[Array, ...]:
    """Log shares less their mean over places alike; the mean knows of no way taken."""
    # Ways come in any order; the reference is per direction.
    orders = [np.argsort(np.array(q.directions), kind="stable") for q in questions]
    weights = approach_weights(questions)
    kinds: dict[tuple[str, ...], list[int]] = {}
    for i, question in enumerate(questions):
        kinds.setdefault(tuple(sorted(question.directions)), []).append(i)
    beliefs: list[Array] = [np.zeros(0)] * len(questions)
    for members in kinds.values():
        table = np.stack([log_shares[i][orders[i]] for i in members])
        table = np.maximum(table, np.log(LEAST_SHARE))
        distance_m = np.array([questions[i].distance_m for i in members])
        gap = (distance_m[:, None] - distance_m) / ALIKE_M
        # The floor lets places of another distance decide where there is no other one.
        alike = (np.exp(-0.5 * gap**2) + 1e-3) * weights[members]
        beyond = table - (alike @ table) / alike.sum(axis=1, keepdims=True)
        for i, row in zip(members, beyond, strict=True):
            beliefs[i] = row[np.argsort(orders[i])]
    return tuple(beliefs)


def approach_weights(questions: Sequence[Question]) -> Float[Array, " Q"]:
    """One over the number of questions on the same approach."""
    keys = [(q.scene, q.approach) for q in questions]
    counts: dict[tuple[str, int], int] = {}
    for key in keys:
        counts[key] = counts.get(key, 0) + 1
    return np.array([1.0 / counts[key] for key in keys])
