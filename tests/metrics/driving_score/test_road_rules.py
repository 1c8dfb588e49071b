"""DAC, DDC, LK, EP and TLC: each threshold from both sides."""

import numpy as np
import pytest
import shapely
from straight_road import FRONT_M, LANE_M, MIDDLE_M, at_speed, drive, road

from shoot.footprint import EGO_WIDTH_M
from shoot.metrics.driving_score import Lanes, Lights, Surroundings
from shoot.metrics.driving_score.lights import count_red_lights, red_touches, traffic_light
from shoot.metrics.driving_score.progress import ego_progress, measure_progress
from shoot.metrics.driving_score.road import (
    drivable_area,
    driving_direction,
    is_against,
    lane_keeping,
)
from shoot.metrics.driving_score.surroundings import locate

T = 41
# The road's right edge is at y = -2.
EDGE_M = -2.0 + EGO_WIDTH_M / 2


@pytest.mark.parametrize(
    ("y_m", "tolerance_m", "score"),
    [
        (EDGE_M + 0.01, 0.0, 1.0),
        (EDGE_M - 0.01, 0.0, 0.0),
        (EDGE_M - 0.29, 0.3, 1.0),
        (EDGE_M - 0.31, 0.3, 0.0),
    ],
)
def test_a_wheel_off_the_road(y_m: float, tolerance_m: float, score: float) -> None:
    assert drivable_area(locate(at_speed(5.0, y_m=y_m), road()), tolerance_m) == score


def test_one_corner_at_one_step_is_enough() -> None:
    yaw_rad = np.zeros(T)
    yaw_rad[20] = -0.4  # the front right corner is at -3.1 sin(0.4) - 0.925 cos(0.4) = -2.06
    where = locate(at_speed(5.0, yaw_rad=yaw_rad), road())
    assert np.flatnonzero(where.off_road_m).tolist() == [20]
    assert where.off_road_m[20] == pytest.approx(3.1 * np.sin(0.4) + 0.925 * np.cos(0.4) - 2.0)


def test_polygons_side_by_side_are_one_road() -> None:
    around = road()
    halves = [shapely.box(x, -2.0, x + 50.0, 6.0) for x in np.arange(0.0, 300.0, 50.0)]
    seam = Surroundings(shapely.GeometryCollection(halves), around.lanes, around.route_m)
    assert drivable_area(locate(at_speed(20.0), seam)) == 1.0


def ddc(ego, around=None):
    around = around or road()
    return driving_direction(ego, is_against(ego, around, locate(ego, around)))


@pytest.mark.parametrize(
    ("speed_mps", "score"), [(1.99, 1.0), (2.01, 0.5), (5.99, 0.5), (6.01, 0.0)]
)
@pytest.mark.parametrize("backward", [False, True])
def test_metres_in_a_second_against_the_direction(speed_mps, score, backward) -> None:
    """In the oncoming lane; or backwards in the own one."""
    ego = at_speed(-speed_mps, start_m=100.0) if backward else at_speed(speed_mps, y_m=LANE_M)
    assert ddc(ego) == score


def test_with_the_route_every_speed_will_do() -> None:
    assert ddc(at_speed(20.0)) == 1.0


@pytest.mark.parametrize(("steps", "score"), [(1, 1.0), (2, 0.5), (5, 0.5), (6, 0.0)])
def test_a_moment_against_the_direction_is_its_metres(steps: int, score: float) -> None:
    """At 11 m/s a step is 1.1 m. The second may begin anywhere."""
    since = np.arange(T) - 25
    assert driving_direction(at_speed(11.0), (since >= 0) & (since < steps)) == score


def test_metres_of_different_seconds_do_not_add_up() -> None:
    """Two steps of 0.9 m, then the same again 1 s after the first."""
    ego = at_speed(9.0)
    against = np.isin(np.arange(T), [20, 21, 30, 31])
    assert driving_direction(ego, against) == 1.0
    assert driving_direction(ego, against | (np.arange(T) == 29)) == 0.5


def test_intersections_are_left_out() -> None:
    assert ddc(at_speed(8.0, y_m=LANE_M), road(junction=(0.0, 100.0))) == 1.0


def test_a_lane_beside_in_the_same_direction_is_on_the_route() -> None:
    around = road()
    own = around.lanes.centrelines_m[0]
    lanes = Lanes((own, own + np.array([0.0, 4.0])), np.full(2, 4.0), np.array([True, True]))
    beside = Surroundings(around.drivable, lanes, around.route_m)
    assert ddc(at_speed(20.0, y_m=LANE_M), beside) == 1.0


def lk(ego, around=None):
    around = around or road()
    return lane_keeping(ego, around, locate(ego, around))


@pytest.mark.parametrize(("y_m", "score"), [(0.49, 1.0), (0.51, 0.0), (-0.49, 1.0), (-0.51, 0.0)])
def test_half_a_metre_beside_the_centre_line(y_m: float, score: float) -> None:
    assert lk(at_speed(5.0, y_m=y_m)) == score


@pytest.mark.parametrize(("steps", "score"), [(19, 1.0), (20, 0.0)])
def test_for_two_seconds_on_end(steps: int, score: float) -> None:
    y_m = np.where((np.arange(T) >= 7) & (np.arange(T) < 7 + steps), 0.6, 0.0)
    assert lk(at_speed(5.0, y_m=y_m)) == score


def test_a_moment_on_the_line_ends_a_stretch_and_an_intersection_does_not() -> None:
    aside = np.full(T, 0.6)
    back = aside.copy()
    back[19::19] = 0.0
    assert lk(at_speed(5.0, y_m=back)) == 1.0
    # Of 41 steps of half a metre two are before the intersection.
    assert lk(at_speed(5.0, y_m=aside), road(junction=(12.0, 100.0))) == 1.0
    # Nine before it, eleven inside; eleven behind it make twenty.
    first_m = 10.0 + MIDDLE_M
    nine, ten = first_m + 4.2, first_m + 9.7
    assert lk(at_speed(5.0, 31, y_m=0.6), road(junction=(nine, ten))) == 0.0
    assert lk(at_speed(5.0, 30, y_m=0.6), road(junction=(nine, ten))) == 1.0


@pytest.mark.parametrize(
    ("progress_m", "multiplier", "reference_m", "score"),
    [
        (20.0, 1.0, 40.0, 0.5),
        (50.0, 1.0, 40.0, 1.0),
        (50.0, 0.0, 40.0, 1.0),  # over what counts of it
        (20.0, 0.0, 40.0, 0.5),
        (0.0, 1.0, 5.0, 1.0),
        (0.0, 1.0, 5.1, 0.0),
        (5.1, 1.0, 0.0, 1.0),
    ],
)
def test_progress_over_the_largest(progress_m, multiplier, reference_m, score) -> None:
    assert ego_progress(progress_m, multiplier, reference_m) == score


def test_progress_is_along_the_route_and_never_negative() -> None:
    assert measure_progress(at_speed(5.0, y_m=1.0), road()) == pytest.approx(20.0)
    assert measure_progress(at_speed(-2.0, start_m=50.0), road()) == 0.0


def red(ego, around, strict=False):
    return red_touches(ego, around, locate(ego, around), strict)


@pytest.mark.parametrize(("gap_m", "score"), [(0.01, 1.0), (-0.01, 0.0)])
def test_a_red_light_touched_by_the_bumper(gap_m: float, score: float) -> None:
    """It comes to a stand just before, or just behind the line."""
    stop_m = 60.0 - FRONT_M - gap_m
    ego = drive(stop_m - np.maximum(4.0 - 0.2 * np.arange(T), 0.0))
    around = road(junction=(60.0, 80.0), red=np.ones(T))
    assert traffic_light(red(ego, around)) == score
    assert count_red_lights(around, red(ego, around)) == 1 - score


def test_green_may_be_driven() -> None:
    around = road(junction=(20.0, 40.0))
    assert traffic_light(red(at_speed(8.0), around)) == 1.0
    assert traffic_light(red(at_speed(8.0), road())) == 1.0


def test_who_is_inside_may_clear_the_intersection() -> None:
    """The middle is on the connector from step 9 on, the bumper from step 7 on."""
    ego = at_speed(10.0)
    junction = (20.0, 40.0)
    for turns, score in ((9, 1.0), (8, 0.0)):
        around = road(junction=junction, red=np.arange(T) >= turns)
        assert traffic_light(red(ego, around)) == score
        assert traffic_light(red(ego, around, strict=True)) == 0.0


def test_a_light_that_turns_red_again_counts_again() -> None:
    """Standing inside for two phases: only the entry on red counts in each."""
    ego = drive(np.concatenate([np.linspace(10.0, 30.0, 21), np.full(20, 30.0)]))
    lit = np.arange(T) < 25
    around = road(junction=(20.0, 40.0), red=lit)
    assert count_red_lights(around, red(ego, around)) == 1
    lit = lit | (np.arange(T) >= 30)
    around = road(junction=(20.0, 40.0), red=lit)
    assert count_red_lights(around, red(ego, around)) == 1
    assert count_red_lights(around, red(ego, around, strict=True)) == 2


def test_lights_of_other_steps_are_refused() -> None:
    around = road(junction=(20.0, 40.0), red=np.ones(7))
    with pytest.raises(ValueError, match="41 steps"):
        red(at_speed(5.0), around)
    with pytest.raises(ValueError, match="is_red must be"):
        Lights((shapely.box(0, 0, 1, 1),))
