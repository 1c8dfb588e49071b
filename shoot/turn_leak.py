"""Asks a planner, before each intersection, which way the ego will go: it must not know.

The hidden route must not be visible. What a planner believes is the mass of its templates that
lead through the intersection on each way the ego's lane allows. Ways differ in how many templates
lead there and how many seconds it takes, so a belief is compared with what the same planner
believes on average where the same directions are open, at about the same distance. Each approach
counts once, however many samples were taken on it.
"""

import io
import json
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
import numpy.typing as npt
import shapely
from jaxtyping import Bool, Float, Int, Shaped
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from lss_core.files import write_atomically
from shoot.bootstrap import NUM_DRAWS, SEED, Interval, interval
from shoot.rendering import palette

Array = npt.NDArray[Any]
Direction = Literal["left", "straight", "right"]
Stage = Literal["hidden", "others", "ego"]

# A template takes a way if it ends near it and clearly nearer to it than to any other.
NEAR_WAY_M, PARTED_M = 4.0, 2.5
# Places whose distance to their intersection differs by less than about this are alike.
ALIKE_M = 8.0
# A share below this is no stronger belief.
LEAST_SHARE = 1e-3
FIGURE_BIN_M, FIGURE_REACH_M = 7.5, 45.0


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
GROUPS: tuple[tuple[str, Filter], ...] = (
    ("one lane, before braking", lambda q, _: q.is_single_lane and q.stage != "ego"),
    ("one lane, before braking, way within 5 s",
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
        text = json.dumps(_without_nan(asdict(self)), indent=2)
        with write_atomically(path) as stream:
            stream.write((text + "\n").encode())


def _without_nan(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _without_nan(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_without_nan(item) for item in value]
    return None if isinstance(value, float) and not np.isfinite(value) else value


def report(answers: Answers, run: str, split: str) -> LeakReport:
    """Score answers by group and by distance.

    Args:
        answers: Of one planner.
        run: Name of what was asked.
        split: Name of the scenes.
    """
    chosen = [
        (name, [i for i, q in enumerate(answers.questions) if keep(q, bool(answers.is_shown[i]))])
        for name, keep in GROUPS
    ]
    by_distance = []
    for road, is_single in (("one lane a side", True), ("several lanes a side", False)):
        for stage, is_before in (("before braking", True), ("braking or waiting", False)):
            for low_m in np.arange(0.0, FIGURE_REACH_M, FIGURE_BIN_M).tolist():
                rows = [
                    i
                    for i, q in enumerate(answers.questions)
                    if q.is_single_lane == is_single
                    and (q.stage != "ego") == is_before
                    and low_m <= q.distance_m < low_m + FIGURE_BIN_M
                ]
                if rows:
                    score = way_score(answers, rows)
                    by_distance.append((road, stage, low_m, low_m + FIGURE_BIN_M, score))
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
    return f"{score.value:.1f} [{score.low:.1f}, {score.high:.1f}]" if score.count else "-"


def render_leak(leak: LeakReport) -> Figure:
    """Picture of how often the way taken is named, by distance to the intersection.

    Args:
        leak: Of one planner.
    """
    figure = Figure(figsize=(10.5, 4.6), facecolor=palette.PAPER)
    all_axes = figure.subplots(1, 2, sharey=True)
    figure.subplots_adjust(left=0.075, right=0.985, bottom=0.215, top=0.80, wspace=0.06)
    roads = ("one lane a side", "several lanes a side")
    for axes, road in zip(all_axes, roads, strict=True):
        _draw_road(axes, leak, road)
    all_axes[0].set_ylabel("names the way taken (%)", fontsize=11)
    for axes in all_axes:
        if axes.lines:
            axes.legend(frameon=False, fontsize=10, loc="lower right")
    figure.text(
        0.012, 0.975, f"Does the planner know where the ego will turn?  ({leak.split})",
        va="top", fontsize=13, fontweight="bold", color=palette.INK,
    )  # fmt: skip
    figure.text(
        0.012, 0.02,
        "Bands: 95 % over scenes. Small numbers: approaches. Nothing in the images may tell "
        "the way before the ego brakes or waits for it.",
        fontsize=9, color=palette.SOFT_INK,
    )  # fmt: skip
    return figure


def _draw_road(axes: Axes, leak: LeakReport, road: str) -> None:
    styles = (
        ("before braking", palette.DRIVEN, "-", "o", 97.0),
        ("braking or waiting", palette.PLANNED, "--", "s", 92.5),
    )
    for stage, colour, line, marker, text_y in styles:
        bins = [row for row in leak.by_distance if row[0] == road and row[1] == stage]
        if not bins:
            continue
        middle_m = [(low + high) / 2 for _, _, low, high, _ in bins]
        scores = [score for *_, score in bins]
        # One scene alone has no interval.
        low = [s.value if np.isnan(s.low) else s.low for s in scores]
        high = [s.value if np.isnan(s.high) else s.high for s in scores]
        axes.fill_between(middle_m, low, high, color=colour, alpha=0.18, linewidth=0)
        axes.plot(
            middle_m, [s.value for s in scores], line, color=colour, marker=marker, label=stage
        )
        for x, score in zip(middle_m, scores, strict=True):
            axes.text(x, text_y, str(score.count), color=colour, fontsize=8.5, ha="center")
        if stage == "before braking":
            axes.plot(
                middle_m, [s.chance for s in scores], ":", color=palette.INK, linewidth=1.6,
                label="chance",
            )  # fmt: skip
    axes.set_title(road, fontsize=11, loc="left", color=palette.INK)
    axes.set_xlim(FIGURE_REACH_M, 0.0)
    axes.set_ylim(0.0, 102.0)
    axes.set_xlabel("distance to the intersection (m)", fontsize=11)
    axes.tick_params(labelsize=10)
    axes.grid(color="#e4e7ea", linewidth=0.6)
    axes.set_axisbelow(True)
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)
