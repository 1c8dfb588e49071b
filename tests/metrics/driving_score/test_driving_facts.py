"""Plain facts, and the two other scores of a route."""

import numpy as np
import pytest
from straight_road import FRONT_M, LANE_M, at_speed, drive, other, road, together

from shoot.metrics.driving_score import epdms, no_others
from shoot.metrics.driving_score.facts import collect_facts, is_stuck
from shoot.metrics.driving_score.route_scores import bench2drive, nuplan_closed_loop, speed_limit

T = 41


def test_an_empty_road_has_metres_only() -> None:
    facts = collect_facts(at_speed(8.0), no_others(T), road())
    assert (facts.driven_m, facts.progress_m) == pytest.approx((32.0, 32.0))
    assert facts.contacts == ()
    rest = (
        facts.off_road_m,
        facts.against_m,
        facts.red_lights,
        facts.near_collisions,
        facts.stuck_s,
    )
    assert rest == (0.0, 0.0, 0, 0, 0.0)
    assert (facts.max_accel_mps2, facts.max_brake_mps2) == pytest.approx((0.0, 0.0), abs=1e-9)


def test_metres_off_road_and_against() -> None:
    y_m = np.where(np.arange(T) >= 31, -1.5, 0.0)
    off = collect_facts(drive(10.0 + 0.5 * np.arange(T), y_m), no_others(T), road())
    # Nine steps of half a metre, and the one aside.
    assert off.off_road_m == pytest.approx(9 * 0.5 + np.hypot(0.5, 1.5))
    against = collect_facts(at_speed(5.0, y_m=LANE_M), no_others(T), road())
    assert against.against_m == pytest.approx(20.0)


def test_strongest_braking_and_speeding_up() -> None:
    for accel_mps2 in (1.5, -2.5):
        speed_mps = 15.0 + accel_mps2 * 0.1 * np.arange(T)
        ego = drive(10.0 + np.cumsum(speed_mps) * 0.1, speed_mps=speed_mps)
        facts = collect_facts(ego, no_others(T), road())
        assert facts.max_accel_mps2 == pytest.approx(max(accel_mps2, 0.0), abs=1e-9)
        assert facts.max_brake_mps2 == pytest.approx(max(-accel_mps2, 0.0), abs=1e-9)


def stuck(ego, others, around=None) -> float:
    return float(is_stuck(ego, others, around or road()).sum() * 0.1)


def test_who_stands_with_nobody_ahead_is_stuck() -> None:
    ego = drive(np.full(T, 30.0), speed_mps=np.where(np.arange(T) < 11, 0.11, 0.09))
    assert stuck(ego, no_others(T)) == pytest.approx(3.0)


@pytest.mark.parametrize(
    ("ahead_m", "aside_m", "is_reason"),
    [(9.9, 0.0, True), (10.1, 0.0, False), (5.0, 1.8, True), (5.0, 2.1, False), (-8.0, 0.0, False)],
)
def test_someone_ahead_is_a_reason(ahead_m: float, aside_m: float, is_reason: bool) -> None:
    """A walker of 0.2 m: of the nearest edge ahead, of the middle aside (0.925 + 1 + 0.1)."""
    walker = other(
        np.full(T, 30.0 + FRONT_M + ahead_m + 0.1), aside_m, 0.0, 0.0, "pedestrian", (0.2, 0.2)
    )
    found = stuck(drive(np.full(T, 30.0)), together(walker, other(np.full(T, 200.0))))
    assert found == pytest.approx(0.0 if is_reason else 4.1)


@pytest.mark.parametrize(("line_m", "is_reason"), [(9.9, True), (10.1, False)])
def test_a_red_light_ahead_is_a_reason_and_a_green_one_none(line_m: float, is_reason: bool) -> None:
    from_m = 30.0 + FRONT_M + line_m
    lit = np.arange(T) < 20
    ego = drive(np.full(T, 30.0))
    found = stuck(ego, no_others(T), road((from_m, from_m + 20.0), lit))
    assert found == pytest.approx(2.1 if is_reason else 4.1)


def test_penalties_multiply() -> None:
    found = bench2drive(0.5, ["pedestrian", "car", "truck", "object"], red_lights=2, stop_signs=1)
    assert found.score == pytest.approx(0.5 * 0.5 * 0.6 * 0.6 * 0.65 * 0.7 * 0.7 * 0.8)
    assert not found.is_success


@pytest.mark.parametrize(
    ("completion", "red_lights", "score", "success"),
    [(1.0, 0, 1.0, True), (1.3, 0, 1.0, True), (0.99, 0, 0.99, False), (1.0, 1, 0.7, False)],
)
def test_success_is_complete_and_clean(completion, red_lights, score, success) -> None:
    found = bench2drive(completion, [], red_lights)
    assert (found.score, found.is_success) == (score, success)


def test_speed_limits_cost_what_is_above_them() -> None:
    limit_mps = np.full(T, 10.0)
    assert speed_limit(np.full(T, 9.9), limit_mps) == 1.0
    assert speed_limit(np.full(T, 10.0 + 2.23 / 4), limit_mps) == pytest.approx(0.75)
    assert speed_limit(np.full(T, 13.0), limit_mps) == 0.0


def test_closed_loop_weights() -> None:
    score = epdms(at_speed(5.0), no_others(T), road(), reference_progress_m=100.0)
    assert score.ep == pytest.approx(0.2)
    assert nuplan_closed_loop(score, 0.5) == pytest.approx((5 * 0.2 + 5 + 4 * 0.5 + 2) / 16)
    slower = epdms(at_speed(4.9), no_others(T), road(), reference_progress_m=100.0)
    assert nuplan_closed_loop(slower, 1.0) == 0.0
