"""What a planner knows of the ego's way, by road and by what shows."""

import io
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np

from lss_core.strict_json import save_json
from shoot.studies.turn_leak.answers import Answers, Question
from shoot.studies.turn_leak.scores import (
    Score,
    left_right_score,
    num_approaches,
    turn_straight_score,
    way_score,
)
from shoot.trajectories import HORIZON_S

DISTANCE_BIN_M, REACH_M = 7.5, 45.0


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
        num_approaches(asked),
        len({q.scene for q in asked}),
        way_score(answers, rows),
        left_right_score(answers, rows),
        turn_straight_score(answers, rows),
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
