import json
import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest

from shoot.studies.turn_leak.answers import (
    Answers,
    Direction,
    Question,
    Stage,
    answer,
    ways_of_paths,
)
from shoot.studies.turn_leak.figure import render_leak
from shoot.studies.turn_leak.report import format_leak, report
from shoot.studies.turn_leak.scores import auc, left_right_score, turn_straight_score, way_score

Array = npt.NDArray[Any]
ALL: tuple[Direction, ...] = ("left", "straight", "right")
SIDE = {"left": 1.0, "straight": 0.0, "right": -1.0}


def _way(direction: Direction, ahead_m: float, reach_m: float = 80.0) -> Array:
    """Straight ahead, then a corner of 90 degrees with a radius of 8 m."""
    side = SIDE[direction]
    if side == 0.0:
        return np.stack([np.linspace(0.0, ahead_m + reach_m, 100), np.zeros(100)], axis=1)
    angle = np.linspace(0.0, np.pi / 2, 20)
    arc = np.stack([ahead_m + 8 * np.sin(angle), side * 8 * (1 - np.cos(angle))], axis=1)
    last = np.array([ahead_m + 8.0, side * reach_m])
    return np.concatenate([[[0.0, 0.0]], arc, [last]])


def _along(way_m: Array, length_m: float) -> Array:
    """Twenty points evenly spaced over the first metres of a way."""
    s_m = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(way_m, axis=0).T))])
    at_m = np.linspace(0.0, length_m, 21)[1:]
    return np.stack([np.interp(at_m, s_m, way_m[:, i]) for i in (0, 1)], axis=1)


def _question(
    position: int,
    taken: Direction,
    distance_m: float = 12.0,
    directions: tuple[Direction, ...] = ALL,
    stage: Stage = "hidden",
    is_single_lane: bool = True,
) -> Question:
    return Question(
        position=position,
        scene=f"scene-{position // 4}",
        approach=position % 4,
        directions=directions,
        ways_m=tuple(_way(d, distance_m) for d in directions),
        taken=directions.index(taken),
        distance_m=distance_m,
        is_single_lane=is_single_lane,
        stage=stage,
    )


def _templates() -> Array:
    """Standing, and for several distances and speeds each of three ways, straight most often."""
    paths = [np.zeros((20, 2))]
    for distance_m in (6.0, 9.0, 12.0, 15.0, 18.0):
        for length_m in (25.0, 32.0, 40.0):
            paths += [_along(_way(d, distance_m), length_m) for d in ALL]
            paths += [_along(_way("straight", distance_m), length_m + 1.0)]
    return np.stack(paths).astype(np.float32)


def _believer(questions: list[Question], templates: Array, weights: list[Array]) -> Array:
    """[Q, K] log-probabilities of a planner with the given odds of the ways of each question."""
    rows = []
    for question, weight in zip(questions, weights, strict=True):
        way_of = ways_of_paths(templates.astype(float), question.ways_m)
        prob = np.full(len(templates), 1e-4)
        for way, odds in enumerate(weight):
            prob[way_of == way] = odds / max(int((way_of == way).sum()), 1)
        rows.append(np.log(prob / prob.sum()))
    return np.stack(rows)


def _questions(count: int, seed: int = 0, **kwargs: Any) -> list[Question]:
    rng = np.random.default_rng(seed)
    return [
        _question(i, str(rng.choice(ALL)), float(rng.uniform(6.0, 18.0)), **kwargs)  # type: ignore[arg-type]
        for i in range(count)
    ]


def _answers(questions: list[Question], weights: list[Array]) -> Answers:
    templates = _templates()
    futures = np.stack([_along(q.ways_m[q.taken], q.distance_m + 20.0) for q in questions])
    return answer(questions, _believer(questions, templates, weights), templates, futures)


def test_a_path_belongs_to_the_way_it_ends_on_once_ways_have_parted() -> None:
    ways = [_way(d, 10.0) for d in ALL]
    paths = np.stack(
        [
            _along(ways[0], 30.0),
            _along(ways[1], 30.0),
            _along(ways[2], 30.0),
            _along(ways[0], 8.0),  # before the intersection
            _along(ways[0], 12.0),  # in the turn, 0.25 m off the straight way
            _along(ways[0], 75.0),  # further along the left way
            np.tile([25.0, -12.0], (20, 1)),  # between two arms
            _along(ways[1], 30.0) * [-1.0, 1.0],  # backwards
        ]
    )
    assert ways_of_paths(paths, ways).tolist() == [0, 1, 2, -1, -1, 0, -1, -1]


def test_mirrored_paths_take_the_mirrored_way() -> None:
    rng = np.random.default_rng(1)
    paths = rng.normal([15.0, 0.0], [10.0, 12.0], size=(200, 20, 2))
    mirror = np.array([1.0, -1.0])
    ways = [_way(d, 10.0) for d in ALL]
    taken = ways_of_paths(paths, ways)
    mirrored = ways_of_paths(paths * mirror, [way * mirror for way in ways])
    assert len(set(taken.tolist())) == 4
    np.testing.assert_array_equal(taken, mirrored)


def test_shares_are_the_mass_that_goes_each_way() -> None:
    question = _question(0, "left")
    odds = np.array([0.2, 0.5, 0.1])
    answers = _answers([question], [odds])
    np.testing.assert_allclose(np.exp(answers.log_shares[0]), odds / 0.8, rtol=1e-6)
    # Alone of its kind it is its own reference.
    np.testing.assert_allclose(answers.beliefs[0], 0.0, atol=1e-12)
    assert answers.is_shown.tolist() == [True]


def test_one_who_knows_the_way_scores_everything() -> None:
    questions = _questions(80)
    knowing = [np.where(np.arange(3) == q.taken, 0.9, 0.05) for q in questions]
    answers = _answers(questions, knowing)
    rows = list(range(len(answers.questions)))
    assert len(rows) == 80
    for score in (way_score(answers, rows), left_right_score(answers, rows)):
        assert (score.value, score.low, score.high) == pytest.approx((100.0, 100.0, 100.0))
    assert turn_straight_score(answers, rows).value == 100.0


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_one_who_guesses_scores_chance(seed: int) -> None:
    questions = _questions(240, seed)
    rng = np.random.default_rng(seed + 10)
    answers = _answers(questions, list(rng.dirichlet(np.ones(3), size=240)))
    rows = list(range(240))
    for score in (
        way_score(answers, rows),
        left_right_score(answers, rows),
        turn_straight_score(answers, rows),
    ):
        width = score.high - score.low
        assert abs(score.value - score.chance) < 0.75 * width
        assert width < 22.0


def test_a_fixed_preference_tells_nothing() -> None:
    # Nearly all mass goes straight on, in all places alike: that is no knowledge of the way.
    questions = _questions(60)
    answers = _answers(questions, [np.array([0.05, 0.9, 0.05])] * 60)
    rows = list(range(60))
    assert way_score(answers, rows).value == pytest.approx(100 / 3)
    assert left_right_score(answers, rows).value == pytest.approx(50.0)
    assert turn_straight_score(answers, rows).value == pytest.approx(50.0)


def test_knowledge_shows_through_a_preference_for_straight() -> None:
    # The way taken gets twice the odds it otherwise has, and straight still gets most.
    usual = np.array([0.05, 0.9, 0.05])
    questions = _questions(120)
    weights = [usual * np.where(np.arange(3) == q.taken, 2.0, 1.0) for q in questions]
    answers = _answers(questions, weights)
    rows = list(range(120))
    assert way_score(answers, rows).value > 90.0
    assert turn_straight_score(answers, rows).value > 90.0


def test_an_approach_counts_once_however_long_it_takes() -> None:
    # On one approach a wrong belief in 20 samples; on seven others a right one in one sample each.
    taken: tuple[Direction, ...] = ("right", "left", "left", "left", *(["straight"] * 4))
    questions = [replace(_question(i, way), scene=f"scene-{i}") for i, way in enumerate(taken)]
    questions += [replace(questions[0], position=8 + i) for i in range(19)]
    beliefs = [
        np.where(np.arange(3) == (0 if q.scene == "scene-0" else q.taken), 0.8, 0.1)
        for q in questions
    ]
    answers = _answers(questions, beliefs)
    score = way_score(answers, range(len(questions)))
    assert score.count == 8
    assert score.value == pytest.approx(100 * 7 / 8)
    assert score.majority == pytest.approx(100 * 4 / 8)


def test_the_order_of_ways_does_not_matter() -> None:
    questions = _questions(60)
    rng = np.random.default_rng(5)
    weights = list(rng.dirichlet(np.ones(3), size=60))
    turned = [
        _question(q.position, q.directions[q.taken], q.distance_m, ("straight", "right", "left"))
        if i % 2
        else q
        for i, q in enumerate(questions)
    ]
    turned_weights = [w[[1, 2, 0]] if i % 2 else w for i, w in enumerate(weights)]
    rows = list(range(60))
    plain, other = _answers(questions, weights), _answers(turned, turned_weights)
    assert way_score(plain, rows) == way_score(other, rows)
    assert left_right_score(plain, rows) == left_right_score(other, rows)
    assert turn_straight_score(plain, rows) == turn_straight_score(other, rows)


def test_ways_without_a_template_cannot_be_asked_about() -> None:
    questions = [_question(0, "left"), _question(1, "left", 70.0)]
    answers = _answers(questions, [np.ones(3) / 3] * 2)
    assert [q.position for q in answers.questions] == [0]
    assert answers.num_unanswerable == 1


def test_auc_compares_pairs_within_a_stratum_only() -> None:
    scores = np.array([3.0, 1.0, 2.0, 0.0, 2.0])
    turns = np.array([True, False, True, False, False])
    stratum = np.array(["a", "a", "b", "b", "b"])
    scene = np.arange(5)
    # Pairs: 3 > 1, 2 > 0 and the tie 2 = 2.
    assert auc(scores, turns, stratum, scene, np.ones(5)).value == pytest.approx(2.5 / 3)
    assert auc(-scores, turns, stratum, scene, np.ones(5)).value == pytest.approx(0.5 / 3)
    assert math.isnan(auc(scores, turns, np.arange(5), scene, np.ones(5)).value)


def test_auc_agrees_with_a_loop() -> None:
    rng = np.random.default_rng(2)
    scores = rng.integers(0, 6, size=60).astype(float)
    turns = rng.random(60) < 0.4
    stratum, scene = rng.integers(0, 3, size=60), rng.integers(0, 12, size=60)
    weight = rng.uniform(0.2, 1.0, size=60)
    pairs = [
        (0.5 * (scores[i] == scores[j]) + (scores[i] > scores[j]), weight[i] * weight[j])
        for i in np.flatnonzero(turns)
        for j in np.flatnonzero(~turns)
        if stratum[i] == stratum[j]
    ]
    found = auc(scores, turns, stratum, scene, weight)
    assert found.value == pytest.approx(
        np.average([w for w, _ in pairs], weights=[x for _, x in pairs])
    )
    assert found.low < found.value < found.high


def test_report_parts_what_was_hidden_from_what_was_not(tmp_path: Path) -> None:
    hidden = _questions(40)
    told = [
        _question(40 + i, q.directions[q.taken], q.distance_m, stage="ego")
        for i, q in enumerate(hidden)
    ]
    knowing = [np.where(np.arange(3) == q.taken, 0.9, 0.05) for q in told]
    rng = np.random.default_rng(3)
    answers = _answers([*hidden, *told], [*rng.dirichlet(np.ones(3), size=40), *knowing])
    leak = report(answers, "run", "val")
    groups = {group.name: group for group in leak.groups}
    assert groups["one lane, before braking"].num_samples == 40
    assert groups["one lane, braking or waiting"].num_samples == 40
    assert groups["several lanes, before braking"].num_samples == 0
    assert groups["one lane, braking or waiting"].way.value > 80.0
    assert groups["one lane, before braking"].way.value < 60.0
    assert sum(score.count for *_, score in leak.by_distance) == 80
    leak.save(tmp_path / "leak.json")
    loaded = json.loads((tmp_path / "leak.json").read_text())
    assert loaded["groups"][0]["way"]["chance"] == pytest.approx(100 / 3)
    # Nobody was asked on several lanes: no number, rather than a made-up one.
    assert loaded["groups"][4]["way"]["value"] is None
    assert "one lane, before braking" in format_leak(leak)


def test_picture_shows_chance_and_both_roads() -> None:
    answers = _answers(_questions(60), [np.ones(3) / 3] * 60)
    figure = render_leak(report(answers, "run", "val"))
    one, several = figure.axes
    assert one.get_title(loc="left") == "one lane a side"
    chance = [line for line in one.lines if line.get_label() == "chance"]
    np.testing.assert_allclose(chance[0].get_ydata(), 100 / 3)
    assert not several.lines
