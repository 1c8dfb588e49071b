"""What the ego is in the way of; all poses are off-axis, all numbers worked out by hand."""

import numpy as np
import pytest

from shoot.footprint import EGO_LENGTH_M, EGO_REAR_M, EGO_WIDTH_M
from shoot.world.town.roads import make_town
from shoot.world.town.town import FloatArray, Town
from shoot.world.traffic.bodies import EgoBody
from shoot.world.traffic.cars import Car
from shoot.world.traffic.driver import ROUTE_STEP_M, Route
from shoot.world.traffic.obstacle import (
    bars_way,
    gap_ahead,
    occupied_paths,
    threatened_crosswalks,
)
from shoot.world.traffic.route_place import find_place

YAW_RAD = 2.5
START_M = np.array([30.0, -12.0])
AHEAD = np.array([np.cos(YAW_RAD), np.sin(YAW_RAD)])
LEFT = np.array([-AHEAD[1], AHEAD[0]])


@pytest.fixture(scope="module")
def town() -> Town:
    return make_town(3)


def _route(xy_m: FloatArray, yaw_rad: FloatArray) -> Route:
    length_m = (len(xy_m) - 1) * ROUTE_STEP_M
    starts_m = (0.0, length_m, length_m, length_m, length_m)
    return Route((0, 1, 2, 3), starts_m, xy_m, yaw_rad, np.full(len(xy_m), 10.0), 1.0)


def _straight() -> Route:
    s_m = np.arange(0.0, 100.0, ROUTE_STEP_M)
    return _route(START_M + s_m[:, None] * AHEAD, np.full(len(s_m), YAW_RAD))


def _car(at_m: float) -> Car:
    size_m = np.array([EGO_LENGTH_M, EGO_WIDTH_M, 1.5])
    return Car(_straight(), size_m, EGO_REAR_M, 0, False, at_m, 8.0)


def _ego(along_m: float, left_m: float, turned_rad: float, speed_mps: float) -> EgoBody:
    """An ego whose footprint's middle is at a place beside the route."""
    yaw_rad = YAW_RAD + turned_rad
    middle_m = START_M + along_m * AHEAD + left_m * LEFT
    own = np.array([np.cos(yaw_rad), np.sin(yaw_rad)])
    return EgoBody(middle_m - own * (EGO_LENGTH_M / 2 - EGO_REAR_M), yaw_rad, speed_mps)


def test_room_before_an_ego_across_ends_at_its_side() -> None:
    lead = gap_ahead(_ego(40.0, 0.5, np.pi / 2, 3.0), _car(10.2), 60.0)
    assert lead is not None
    # Its right side is half a width and the air before 40 m, the bumper 3.1 m ahead of 10.2 m.
    room_m = 40.0 - EGO_WIDTH_M / 2 - 0.3 - 3.1 - 10.2
    assert room_m - ROUTE_STEP_M <= lead[0] <= room_m
    assert lead[1] == pytest.approx(0.0, abs=1e-9)


def test_speed_of_an_ego_ahead_is_that_along_the_route() -> None:
    speeds_mps = []
    for turned_rad in (0.3, np.pi + 0.3):
        lead = gap_ahead(_ego(30.0, 0.0, turned_rad, 5.0), _car(3.0), 60.0)
        assert lead is not None
        speeds_mps.append(lead[1])
    assert speeds_mps == pytest.approx([5.0 * np.cos(0.3), 0.0])


@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_an_ego_beside_the_corridor_is_not_in_the_way(side: float) -> None:
    touching_m = EGO_WIDTH_M + 0.3
    assert gap_ahead(_ego(30.0, side * (touching_m + 0.02), 0.0, 5.0), _car(3.0), 60.0) is None
    assert gap_ahead(_ego(30.0, side * (touching_m - 0.02), 0.0, 5.0), _car(3.0), 60.0)


def test_an_ego_close_behind_or_far_ahead_is_not_in_the_way_and_one_overlapped_leaves_no_room() -> (
    None
):
    car = _car(40.0)
    middle_m = 40.0 + EGO_LENGTH_M / 2 - EGO_REAR_M
    assert gap_ahead(_ego(middle_m - EGO_LENGTH_M - 0.05, 0.0, 0.0, 5.0), car, 60.0) is None
    assert gap_ahead(_ego(middle_m - EGO_LENGTH_M + 0.05, 0.0, 0.0, 5.0), car, 60.0) == (0.0, 0.0)
    assert gap_ahead(_ego(middle_m + 25.0, 0.0, 0.0, 5.0), car, 15.0) is None


def test_paths_are_occupied_by_who_is_on_them_not_by_who_waits_before(town: Town) -> None:
    path = next(lane for lane in town.lanes if lane.turn == "left")
    middle = len(path.centreline_m) // 2
    chord_m = path.centreline_m[middle + 1] - path.centreline_m[middle]
    on_it = EgoBody(path.centreline_m[middle], float(np.arctan2(chord_m[1], chord_m[0])), 0.0)
    assert path.lane_id in occupied_paths(on_it, town)
    for lane in town.lanes:
        if lane.turn is None:
            end_m, last_m = lane.centreline_m[-1], lane.centreline_m[-1] - lane.centreline_m[-2]
            along = last_m / np.hypot(*last_m)
            nose_m = end_m - 0.3 * along
            waiting = EgoBody(
                nose_m - (EGO_LENGTH_M - EGO_REAR_M) * along,
                float(np.arctan2(along[1], along[0])),
                0.0,
            )
            assert not occupied_paths(waiting, town) & set(lane.successors)


def test_a_crosswalk_is_threatened_by_who_could_not_stop_before_it(town: Town) -> None:
    walk = town.crosswalks[0]
    across_m = walk.path_m[1] - walk.path_m[0]
    along = np.array([-across_m[1], across_m[0]]) / np.hypot(*across_m)
    edge_m = max(float((corner - walk.path_m[0]) @ along) for corner in walk.outline_m)
    # Towards the crosswalk, 10 m from bumper to edge: 4 m/s need 3.1 + 0.5 m, 9 m/s 15.6 + 0.5 m.
    axle_m = walk.path_m.mean(axis=0) + along * (edge_m + 10.0 + EGO_LENGTH_M - EGO_REAR_M)
    yaw_rad = float(np.arctan2(-along[1], -along[0]))
    assert 0 not in threatened_crosswalks(EgoBody(axle_m, yaw_rad, 4.0), town)
    assert 0 in threatened_crosswalks(EgoBody(axle_m, yaw_rad, 9.0), town)
    assert 0 not in threatened_crosswalks(EgoBody(axle_m, yaw_rad + np.pi, 9.0), town)


def _is_barred(ego: EgoBody, before: tuple[float, float], after: tuple[float, float]) -> bool:
    """A step from one place to another, both in `ego`."""
    frame = np.array([AHEAD, LEFT])
    return bars_way(ego, ego.xy_m + np.array(before) @ frame, ego.xy_m + np.array(after) @ frame)


def test_a_step_into_the_ego_is_barred_and_one_away_from_it_is_not() -> None:
    stands = EgoBody(START_M, YAW_RAD, 0.0)
    side_m = EGO_WIDTH_M / 2 + 0.6
    assert _is_barred(stands, (1.0, side_m + 0.1), (1.0, side_m - 0.05))
    assert not _is_barred(stands, (1.0, side_m + 0.2), (1.0, side_m + 0.05))
    assert not _is_barred(stands, (1.0, side_m - 0.2), (1.0, side_m - 0.05))
    # Into its front, 3.1 m before the axle, and its rear, 1 m behind.
    assert _is_barred(stands, (3.8, 0.2), (3.65, 0.2))
    assert not _is_barred(stands, (3.95, 0.2), (3.75, 0.2))
    assert _is_barred(stands, (-1.7, 0.2), (-1.55, 0.2))


def test_a_step_onto_the_ground_before_a_coming_ego_is_barred() -> None:
    side_m = EGO_WIDTH_M / 2 + 0.6
    comes = EgoBody(START_M, YAW_RAD, 8.0)  # needs 8 m at 4 m/s2: to 3.7 + 8 m before the axle
    for x_m, is_barred in ((11.5, True), (11.9, False)):
        assert _is_barred(comes, (x_m, -side_m - 0.1), (x_m, -side_m + 0.05)) is is_barred
    # Who is in its way already walks on, out of it.
    assert not _is_barred(comes, (8.0, -0.5), (8.0, -0.35))
    assert not _is_barred(EgoBody(START_M, YAW_RAD, 0.0), (8.0, -1.6), (8.0, -1.45))


def test_place_on_a_route_is_the_nearest_within_2_m_and_60_degrees() -> None:
    route = _straight()

    def body(left_m: float, turned_rad: float) -> EgoBody:
        return EgoBody(START_M + 12.3 * AHEAD + left_m * LEFT, YAW_RAD + turned_rad, 1.0)

    place = find_place(route, body(-0.7, 0.2 + 2 * np.pi), 10.0)
    assert place is not None
    assert (place.at_m, place.off_m, place.off_rad) == pytest.approx((12.3, 0.7, 0.2))
    assert find_place(route, body(1.98, 1.04), 10.0)
    assert find_place(route, body(2.02, 0.0), 10.0) is None
    assert find_place(route, body(0.0, -1.06), 10.0) is None


def test_a_route_that_passes_twice_is_taken_where_the_ego_was_last() -> None:
    turn_rad = np.arange(0.0, 4 * np.pi, ROUTE_STEP_M / 10.0)
    circle_m = 10.0 * np.stack([np.sin(turn_rad), 1.0 - np.cos(turn_rad)], axis=1)
    route = _route(circle_m, turn_rad)
    body = EgoBody(np.array([10.0, 10.0]), np.pi / 2, 3.0)
    for near_m, at_m in ((12.0, 5 * np.pi), (70.0, 25 * np.pi)):
        place = find_place(route, body, near_m)
        assert place is not None
        assert place.at_m == pytest.approx(at_m, abs=0.01)
