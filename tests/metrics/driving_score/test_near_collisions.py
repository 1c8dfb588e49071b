"""TTC: straight on at one speed for up to 0.9 s."""

import numpy as np
import pytest
from straight_road import FRONT_M, MIDDLE_M, at_speed, drive, moved_scene, other, road

from shoot.metrics.driving_score import no_others
from shoot.metrics.driving_score.surroundings import locate
from shoot.metrics.driving_score.time_to_collision import near_collisions, time_to_collision

T, LONGER = 41, 50
STEPS = np.arange(LONGER)


def ttc(ego, others, around=None):
    """In two frames, which must not matter."""
    scene = (ego, others, around or road())
    here, there = (time_to_collision(e, o, locate(e, a)) for e, o, a in (scene, moved_scene(scene)))
    assert here == there
    return here


def test_nobody_there() -> None:
    assert ttc(at_speed(8.0), no_others(LONGER)) == 1.0
    assert ttc(at_speed(8.0, num_steps=5), no_others(5)) == 1.0


@pytest.mark.parametrize(("gap_m", "score"), [(8.9, 0.0), (9.1, 1.0)])
def test_closing_in_at_10_mps_on_a_gap_of_09_s(gap_m: float, score: float) -> None:
    """A car that keeps its distance but would not if it stood: others are where they will be."""
    ego = at_speed(10.0, num_steps=2)
    standing = other(np.full(11, 10.0 + FRONT_M + 1.0 + gap_m + 2.0))
    assert ttc(ego, standing) == score


def test_a_car_ahead_at_the_same_speed_is_no_danger() -> None:
    ahead = other(10.0 + FRONT_M + 1.0 + 2.0 + 1.0 * STEPS, speed_mps=10.0)
    assert ttc(at_speed(10.0), ahead) == 1.0


@pytest.mark.parametrize("around", [road(), road(junction=(0.0, 100.0))])
def test_one_that_comes_up_from_behind_does_not_count(around) -> None:
    """Neither where one beside would."""
    ego = at_speed(4.0, start_m=30.0)
    assert ttc(ego, other(20.0 + 0.9 * STEPS, speed_mps=9.0), around) == 1.0


@pytest.mark.parametrize(("speed_mps", "score"), [(0.004, 1.0), (0.006, 0.0)])
def test_who_stands_does_not_count(speed_mps: float, score: float) -> None:
    ego = drive(np.full(T, 30.0), speed_mps=speed_mps)
    assert ttc(ego, other(60.0 - 1.0 * STEPS, yaw_rad=np.pi, speed_mps=10.0)) == score


@pytest.mark.parametrize(("off_deg", "score"), [(29.0, 0.0), (31.0, 1.0)])
def test_ahead_is_within_30_degrees(off_deg: float, score: float) -> None:
    ego = at_speed(5.0, num_steps=2)
    x_m, y_m = 6.0 * np.cos(np.deg2rad(off_deg)), 6.0 * np.sin(np.deg2rad(off_deg))
    big = other(np.full(11, 10.0 + x_m), y_m, size_m=(1.0, 4.5))
    assert ttc(ego, big) == score


@pytest.mark.parametrize(
    ("ego", "around", "score"),
    [
        (at_speed(5.0), road(), 1.0),
        (at_speed(5.0, y_m=1.2), road(), 0.0),  # in two lanes
        (at_speed(5.0, y_m=-1.2), road(), 0.0),  # off the road
        (at_speed(5.0), road(junction=(0.0, 100.0)), 0.0),
        (at_speed(5.0), road(junction=(60.0, 100.0)), 1.0),
    ],
)
def test_one_beside_counts_where_more_heed_is_due(ego, around, score) -> None:
    """It comes from the side into the middle of the car, far off the heading."""
    y_m = ego.xy_m[0, 1]
    beside = other(
        10.0 + 0.5 * STEPS, y_m + np.maximum(6.0 - 0.2 * STEPS, 1.0), speed_mps=5.0, size_m=(1, 1)
    )
    assert ttc(ego, beside, around) == score


def test_what_comes_later_is_judged_by_how_it_began() -> None:
    """Cut in from the side, then ahead: the danger was the other's making until it is over."""
    ego = at_speed(5.0)
    x_m = 10.0 + MIDDLE_M + 0.5 * STEPS + np.clip(0.2 * (STEPS - 5.0), 0.0, 3.5)
    merging = other(x_m, np.maximum(4.0 - 0.3 * STEPS, 1.2), speed_mps=5.0)
    assert ttc(ego, merging) == 1.0


def test_what_touches_at_the_start_is_not_looked_at_before_they_are_apart() -> None:
    ego = at_speed(5.0)
    x_m = np.full(LONGER, 14.0)
    assert ttc(ego, other(x_m)) == 1.0
    x_m[3:] = 100.0
    x_m[20:] = 30.0
    where = locate(ego, road())
    assert not near_collisions(ego, other(x_m), where)[:10].any()
    assert near_collisions(ego, other(x_m), where)[10:].any()


def test_the_end_is_left_out_unless_the_others_future_is_known() -> None:
    ego = at_speed(10.0)
    appears = other(np.full(LONGER, ego.xy_m[-1, 0] + FRONT_M + 1.0 + 2.0))
    appears.is_present[:, : T - 1] = False
    assert ttc(ego, appears) == 0.0
    until_the_end = other(appears.centre_m[0, :T, 0])
    until_the_end.is_present[:, : T - 1] = False
    assert ttc(ego, until_the_end) == 1.0
