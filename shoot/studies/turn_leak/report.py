"""How well a planner knows the ego's way: scores with intervals, by road and by what shows."""

import io
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float, Shaped

from lss_core.strict_json import save_json
from shoot.metrics.bootstrap import NUM_DRAWS, SEED, Interval, interval
from shoot.studies.turn_leak.answers import Answers, Array, Question, approach_weights
from shoot.trajectories import HORIZON_S

DISTANCE_BIN_M, REACH_M = 7.5, 45.0


@dataclass(frozen=True)
class Score:
    """How well a planner knows something, in per cent, with its 95 % interval over scenes.

    Attributes:
        value, low, high: Accuracy, or area under the curve; NaN if never asked.
        chance: What guessing blindly reaches.
        majority: What always naming the most frequent answer reaches, chosen in hindsight (so it
            exceeds chance even if there is nothing to know); 50 for areas.
        count: Approaches.
    """

    value: float
    low: float
    high: float
    chance: float
    majority: float
    count: int


@dataclass(frozen=True)
class Group:
    """What a planner knows about one kind of questions.

    Attributes:
        name: Which.
        num_samples, num_approaches, num_scenes: How many.
        way: Names the way taken, of all that are open.
        left_right: Tells left from right, where it takes one and both are open.
        turn_straight: Ranks turning above going straight, where both are open, among questions
            with the same directions open.
    """

    name: str
    num_samples: int
    num_approaches: int
    num_scenes: int
    way: Score
    left_right: Score
    turn_straight: Score


Filter = Callable[[Question, bool], bool]
# Whether the way lies within the horizon is known only afterwards and may follow from what can be
# seen (a queue on a way): that group can exceed chance although nothing leaks; the first cannot.
GROUPS: tuple[tuple[str, Filter], ...] = (
    ("one lane, before braking", lambda q, _: q.is_single_lane and q.stage != "ego"),
    ("one lane, before braking, way within {horizon}",
     lambda q, shown: q.is_single_lane and q.stage != "ego" and shown),
    ("one lane, before braking, others differ",
     lambda q, _: q.is_single_lane and q.stage == "others"),
    ("one lane, braking or waiting", lambda q, _: q.is_single_lane and q.stage == "ego"),
    ("several lanes, before braking", lambda q, _: not q.is_single_lane and q.stage != "ego"),
    ("several lanes, braking or waiting", lambda q, _: not q.is_single_lane and q.stage == "ego"),
)  # fmt: skip


@dataclass(frozen=True)
class LeakReport:
    """Whether a planner knows where the ego will turn.

    Attributes:
        run, split: What was asked.
        num_unanswerable: Questions left out since a way has no template.
        groups: By road and by what had become visible.
        by_distance: For the figure: [(road, stage, nearest m, farthest m, score)].
    """

    run: str
    split: str
    num_unanswerable: int
    groups: tuple[Group, ...]
    by_distance: tuple[tuple[str, str, float, float, Score], ...]

    def save(self, path: Path) -> None:
        """Write it as JSON, whole or not at all; numbers that do not exist become null."""
        save_json(asdict(self), path)


def report(answers: Answers, run: str, split: str, horizon_s: float = HORIZON_S) -> LeakReport:
    """Score answers by group and by distance.

    Args:
        answers: Of one planner.
        run: Name of what was asked.
        split: Name of the scenes.
        horizon_s: Of the templates.
    """
    chosen = [
        (
            name.format(horizon=f"{horizon_s:g} s"),
            [i for i, q in enumerate(answers.questions) if keep(q, bool(answers.is_shown[i]))],
        )
        for name, keep in GROUPS
    ]
    by_distance = []
    for road, is_single in (("one lane a side", True), ("several lanes a side", False)):
        for stage, is_before in (("before braking", True), ("braking or waiting", False)):
            for low_m in np.arange(0.0, REACH_M, DISTANCE_BIN_M).tolist():
                rows = [
                    i
                    for i, q in enumerate(answers.questions)
                    if q.is_single_lane == is_single
                    and (q.stage != "ego") == is_before
                    and low_m <= q.distance_m < low_m + DISTANCE_BIN_M
                ]
                if rows:
                    score = way_score(answers, rows)
                    by_distance.append((road, stage, low_m, low_m + DISTANCE_BIN_M, score))
    return LeakReport(
        run,
        split,
        answers.num_unanswerable,
        tuple(_group(name, answers, rows) for name, rows in chosen),
        tuple(by_distance),
    )


def _group(name: str, answers: Answers, rows: list[int]) -> Group:
    asked = [answers.questions[i] for i in rows]
    return Group(
        name,
        len(asked),
        _num_approaches(asked),
        len({q.scene for q in asked}),
        way_score(answers, rows),
        left_right_score(answers, rows),
        turn_straight_score(answers, rows),
    )


def way_score(answers: Answers, rows: Sequence[int]) -> Score:
    """How often the way believed in most is taken; ties count by halves, thirds, ...

    Args:
        answers: Of one planner.
        rows: Which of them.
    """
    hits, chance, kinds = [], [], []
    for i in rows:
        question, belief = answers.questions[i], answers.beliefs[i]
        best = np.flatnonzero(belief >= belief.max() - 1e-12)
        hits.append(float(question.taken in best) / len(best))
        chance.append(1.0 / len(belief))
        kinds.append("/".join(sorted(question.directions)))
    return _accuracy(hits, chance, kinds, [answers.questions[i] for i in rows])


def left_right_score(answers: Answers, rows: Sequence[int]) -> Score:
    """How often left and right are told apart where both are open and one is taken.

    Args:
        answers: Of one planner.
        rows: Which of them.
    """
    hits, kept = [], []
    for i in rows:
        question, belief = answers.questions[i], answers.beliefs[i]
        direction = question.directions[question.taken]
        if not {"left", "right"} <= set(question.directions) or direction == "straight":
            continue
        left, right = (
            max(b for b, d in zip(belief, question.directions, strict=True) if d == side)
            for side in ("left", "right")
        )
        lead = (left - right) * (1.0 if direction == "left" else -1.0)
        hits.append(0.5 if abs(lead) <= 1e-12 else float(lead > 0.0))
        kept.append(question)
    return _accuracy(hits, [0.5] * len(hits), [""] * len(hits), kept)


def turn_straight_score(answers: Answers, rows: Sequence[int]) -> Score:
    """Area under the curve of turning against going straight; 50 is chance.

    Only questions with the same directions open are compared: where three ways are open turning is
    more frequent than where two are, and that is no secret.

    Args:
        answers: Of one planner.
        rows: Which of them.
    """
    scores, is_turn, kinds, kept = [], [], [], []
    for i in rows:
        question, belief = answers.questions[i], answers.beliefs[i]
        is_straight = np.array([d == "straight" for d in question.directions])
        if is_straight.all() or not is_straight.any():
            continue
        scores.append(float(belief[~is_straight].max() - belief[is_straight].max()))
        is_turn.append(not bool(is_straight[question.taken]))
        kinds.append("/".join(sorted(question.directions)))
        kept.append(question)
    area = auc(
        np.array(scores),
        np.array(is_turn, dtype=bool),
        np.array(kinds),
        np.array([q.scene for q in kept]),
        approach_weights(kept),
    )
    return Score(
        100.0 * area.value, 100.0 * area.low, 100.0 * area.high, 50.0, 50.0, _num_approaches(kept)
    )


def auc(
    scores: Float[Array, " Q"],
    is_positive: Bool[Array, " Q"],
    stratum: Shaped[Array, " Q"],
    scene: Shaped[Array, " Q"],
    weights: Float[Array, " Q"],
) -> Interval:
    """Share of pairs from one stratum in which the positive scores higher, ties by halves.

    Args:
        scores: One number per sample.
        is_positive: What they should tell.
        stratum: Only samples of equal strata are compared.
        scene: Unit of the bootstrap.
        weights: How much each sample counts; a pair counts the product.

    Returns:
        With its 95 % interval over draws of scenes; all NaN if there is no pair, bounds NaN if
        there is one scene only.
    """
    high, low = np.flatnonzero(is_positive), np.flatnonzero(~is_positive)
    same = (stratum[high][:, None] == stratum[low]) * weights[high][:, None] * weights[low]
    if not same.any():
        return Interval(float("nan"), float("nan"), float("nan"))
    lead = scores[high][:, None] - scores[low]
    wins = np.where(np.abs(lead) <= 1e-12, 0.5, (lead > 0.0).astype(float)) * same
    value = float(wins.sum() / same.sum())
    names, row = np.unique(scene, return_inverse=True)
    if len(names) == 1:
        return Interval(value, float("nan"), float("nan"))
    shares = np.full(len(names), 1.0 / len(names))
    draws = np.random.default_rng(SEED).multinomial(len(names), shares, size=NUM_DRAWS)
    weight = draws[:, row].astype(float)
    pairs = ((weight[:, high] @ same) * weight[:, low]).sum(axis=1)
    won = ((weight[:, high] @ wins) * weight[:, low]).sum(axis=1)
    bounds = np.percentile((won / np.where(pairs > 0, pairs, np.nan))[pairs > 0], [2.5, 97.5])
    return Interval(value, float(bounds[0]), float(bounds[1]))


def _num_approaches(questions: Sequence[Question]) -> int:
    return len({(q.scene, q.approach) for q in questions})


def _accuracy(
    hits: Sequence[float],
    chance: Sequence[float],
    kinds: Sequence[str],
    questions: Sequence[Question],
) -> Score:
    """Per cent of approaches; the majority is counted within each kind of question."""
    if not hits:
        nan = float("nan")
        return Score(nan, nan, nan, nan, nan, 0)
    keys = [(q.scene, q.approach) for q in questions]
    first = {key: i for i, key in reversed(list(enumerate(keys)))}
    sums = dict.fromkeys(first, 0.0)
    for key, hit, weight in zip(keys, hits, approach_weights(questions), strict=True):
        sums[key] += hit * float(weight)
    counts: dict[str, dict[str, int]] = {}
    for i in first.values():
        of_kind = counts.setdefault(kinds[i], {})
        direction = questions[i].directions[questions[i].taken]
        of_kind[direction] = of_kind.get(direction, 0) + 1
    majority = sum(max(of_kind.values()) for of_kind in counts.values()) / len(first)
    bounds = interval(np.array(list(sums.values())), np.array([scene for scene, _ in sums]))
    return Score(
        100.0 * bounds.value,
        100.0 * bounds.low,
        100.0 * bounds.high,
        100.0 * float(np.mean([chance[i] for i in first.values()])),
        100.0 * majority,
        len(first),
    )


def format_leak(leak: LeakReport) -> str:
    """The groups as a table."""
    out = io.StringIO()
    out.write(
        f"{'':42} {'samples':>7} {'approaches':>10}  {'way taken, %':>20} {'chance':>6}"
        f"  {'left or right, %':>20}  {'turns, AUC':>20}\n"
    )
    for group in leak.groups:
        out.write(
            f"{group.name:42} {group.num_samples:7d} {group.num_approaches:10d}  "
            f"{_text(group.way):>20} {group.way.chance:6.1f}  {_text(group.left_right):>20}  "
            f"{_text(group.turn_straight):>20}\n"
        )
    out.write(
        f"Accuracies are per approach. Left out, since a way has no template that leads through: "
        f"{leak.num_unanswerable} samples.\n"
    )
    return out.getvalue()


def _text(score: Score) -> str:
    if np.isnan(score.value):
        return "-"
    if np.isnan(score.low):
        return f"{score.value:.1f} (one scene)"
    return f"{score.value:.1f} [{score.low:.1f}, {score.high:.1f}]"
