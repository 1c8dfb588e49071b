"""The sum of all sub-scores, its switches, and what no frame may change."""

import math
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from straight_road import (
    FRONT_M,
    at_speed,
    busy_scene,
    drive,
    moved_scene,
    other,
    road,
    together,
)

import shoot.metrics.driving_score as door
from shoot.metrics.driving_score import Lanes, Others, Surroundings, Track, epdms, no_others
from shoot.metrics.driving_score.facts import collect_facts
from shoot.metrics.driving_score.score import MULTIPLIERS, SUB_SCORES, WEIGHTS

T = 41
PAGE = Path(__file__).parents[3] / "docs" / "driving_score.md"
CALM = at_speed(8.0, start_m=0.0)


def values(score):
    return [getattr(score, name) for name in SUB_SCORES]


def test_an_empty_road_scores_1_everywhere() -> None:
    score = epdms(
        at_speed(8.0), no_others(T), road(), reference_progress_m=31.9, plans=[CALM, CALM, CALM]
    )
    assert values(score) == [1.0] * 9
    assert score.total == 1.0
    assert score.name == "driving score (EPDMS rules, v1)"
    assert score.counted_progress_m == pytest.approx(32.0)


def test_standing_still_has_no_progress_and_nothing_else_against_it() -> None:
    score = epdms(drive(np.full(T, 30.0)), no_others(T), road(), reference_progress_m=30.0)
    assert score.ep == 0.0
    assert [v for v in values(score) if v != 1.0] == [0.0, None]
    assert score.total == pytest.approx(9 / 14)


def test_each_sub_score_has_its_weight() -> None:
    best = epdms(at_speed(8.0), no_others(T), road(), reference_progress_m=0.0, plans=[CALM] * 2)
    for name, weight in WEIGHTS.items():
        assert replace(best, **{name: 0.0}).total == pytest.approx(1.0 - weight / 16.0)
    for name in MULTIPLIERS:
        assert replace(best, **{name: 0.5}).total == pytest.approx(0.5)
    without = replace(best, ec=None, lk=0.0)
    assert without.total == pytest.approx(1.0 - 2.0 / 14.0)


def test_the_references_own_multipliers_count() -> None:
    """One that ran into something sets no measure."""
    crash = epdms(at_speed(8.0), other(np.full(T, 30.0)), road(), reference_progress_m=0.0)
    assert (crash.nc, crash.progress_m, crash.counted_progress_m) == (0.0, pytest.approx(32.0), 0.0)
    slow = epdms(at_speed(2.0), no_others(T), road(), reference_progress_m=crash.counted_progress_m)
    assert slow.ep == 1.0


def test_where_the_recorded_driver_fails_nobody_is_blamed() -> None:
    around = road()
    ego = at_speed(8.0, y_m=-1.2)
    plain = epdms(ego, no_others(T), around, reference_progress_m=32.0)
    assert (plain.dac, plain.lk, plain.total) == (0.0, 0.0, 0.0)
    assert (plain.has_human_filter, plain.forgiven) == (False, ())
    filtered = epdms(ego, no_others(T), around, reference_progress_m=32.0, human=plain)
    assert (filtered.dac, filtered.lk, filtered.total) == (1.0, 1.0, 1.0)
    assert (filtered.has_human_filter, filtered.forgiven) == (True, ("dac", "lk"))
    good = epdms(at_speed(8.0), no_others(T), around, reference_progress_m=32.0)
    blamed = epdms(ego, no_others(T), around, reference_progress_m=32.0, human=good)
    assert (blamed.dac, blamed.has_human_filter, blamed.forgiven) == (0.0, True, ())


def test_switches_are_said() -> None:
    around = road(junction=(20.0, 40.0), red=np.arange(T) > 20)
    for tolerance_m, dac in ((0.0, 0.0), (0.3, 1.0)):
        for strict, tlc in ((False, 1.0), (True, 0.0)):
            score = epdms(
                at_speed(8.0, y_m=-1.2),
                no_others(T),
                around,
                reference_progress_m=0.0,
                drivable_tolerance_m=tolerance_m,
                strict_lights=strict,
            )
            assert (score.dac, score.tlc) == (dac, tlc)
            assert (score.drivable_tolerance_m, score.strict_lights) == (tolerance_m, strict)


@given(seed=st.integers(0, 10**6), angle_rad=st.floats(-3.0, 3.0), x_m=st.floats(-500, 500))
@settings(max_examples=8, deadline=None, derandomize=True)
def test_turning_and_moving_the_whole_scene_changes_nothing(seed, angle_rad, x_m) -> None:
    scene = busy_scene(seed)
    moved = moved_scene(scene, angle_rad, (x_m, -7.0))
    here, there = (epdms(*s, reference_progress_m=30.0) for s in (scene, moved))
    assert values(there)[:4] == values(here)[:4]
    assert values(there)[5:] == values(here)[5:]
    assert there.ep == pytest.approx(here.ep, abs=1e-6)
    assert collect_facts(*moved).contacts == collect_facts(*scene).contacts


def test_order_of_others_changes_nothing_and_far_ones_neither() -> None:
    for seed in range(4):
        ego, others, around = busy_scene(seed)
        score = epdms(ego, others, around, reference_progress_m=30.0)
        turned = np.arange(len(others))[::-1]
        arrays = ("centre_m", "yaw_rad", "speed_mps", "size_m", "is_present")
        reversed_ = Others(
            *(getattr(others, name)[turned] for name in arrays),
            kinds=tuple(others.kinds[i] for i in turned),
        )
        far = together(others, other(np.full(T, 900.0)))
        for same in (reversed_, far):
            assert epdms(ego, same, around, reference_progress_m=30.0) == score


def test_scenes_of_the_properties_meet_every_rule() -> None:
    """Else they would say little."""
    scores = [epdms(*busy_scene(seed), reference_progress_m=30.0) for seed in range(30)]
    for name in SUB_SCORES[:-1]:
        assert len({getattr(score, name) for score in scores}) > 1, name


def test_a_whole_route_is_scored_as_a_plan_is() -> None:
    """18 s: what happens late counts as what happens early."""
    steps = np.arange(181)
    ego = drive(10.0 + 0.8 * steps, speed_mps=8.0)
    wall = other(np.full(181, 10.0 + 0.8 * 170 + FRONT_M + 2.0), kind="object")
    score = epdms(ego, wall, road(num_steps=181), reference_progress_m=144.0)
    assert (score.nc, score.ttc, score.ep) == (0.5, 0.0, 1.0)
    assert score.total == pytest.approx(0.5 * 9 / 14)


def test_what_does_not_fit_is_refused() -> None:
    ego = at_speed(8.0)
    with pytest.raises(ValueError, match="Others must be known at the ego's 41 steps"):
        epdms(ego, no_others(40), road(), reference_progress_m=0.0)
    with pytest.raises(ValueError, match="finite"):
        Track(ego.xy_m, np.full(T, math.nan), ego.speed_mps)
    with pytest.raises(ValueError, match="dt_s"):
        Track(ego.xy_m, ego.yaw_rad, ego.speed_mps, 0.0)
    with pytest.raises(ValueError, match="one or more steps"):
        Track(np.zeros((0, 2)), np.zeros(0), np.zeros(0))
    with pytest.raises(ValueError, match="kinds"):
        replace(no_others(T), kinds=("car",))
    with pytest.raises(ValueError, match="Each lane"):
        Lanes((), np.ones(1), np.ones(1, bool))
    with pytest.raises(ValueError, match="two or more points"):
        Surroundings(road().drivable, road().lanes, np.zeros((1, 2)))


def test_every_name_of_the_door_opens() -> None:
    assert all(hasattr(door, name) for name in door.__all__)


def test_the_example_of_the_page_runs_and_prints_what_it_says() -> None:
    text = PAGE.read_text(encoding="utf-8")
    (code,) = re.findall(r"^```python\n(.*?)^```", text, re.MULTILINE | re.DOTALL)
    (said,) = re.findall(r"^```text\n(.*?)^```", text, re.MULTILINE | re.DOTALL)
    printed: list[str] = []
    exec(
        compile(code, PAGE.name, "exec"),
        {"print": lambda *words: printed.append(" ".join(str(word) for word in words))},
    )
    assert "\n".join(printed) + "\n" == said
