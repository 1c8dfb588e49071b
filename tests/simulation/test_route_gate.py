"""The route masks what leaves it, and nothing else."""

from dataclasses import replace

import numpy as np
import pytest

from shoot.simulation.progress import next_place
from shoot.simulation.route_gate import on_route, pass_gate
from shoot.simulation.vehicle import VehicleState
from shoot.world.town.roads import make_town
from shoot.world.town.town import Lane, Town
from shoot.world.traffic.driver import Route, follow_lanes


@pytest.fixture(scope="module")
def town() -> Town:
    return make_town(5)


def fork(town: Town) -> tuple[Lane, list[Lane]]:
    """A lane without neighbours, and its paths: straight on and to the right at least."""
    for lane in town.lanes:
        paths = [town.lanes[i] for i in lane.successors]
        alone = lane.turn is None and lane.left_lane is None and lane.right_lane is None
        if alone and {"straight", "right"} <= {path.turn for path in paths}:
            return lane, paths
    raise AssertionError("no such lane")


def route_over(town: Town, lane: Lane, path: Lane) -> Route:
    (onto,) = path.successors
    return follow_lanes([lane, path, town.lanes[onto]], 1.0)


def before_the_end(lane: Lane) -> VehicleState:
    """8 m before the lane ends, on its middle."""
    (x, y), (ahead_x, ahead_y) = lane.centreline_m[-9], lane.centreline_m[-8]
    return VehicleState(float(x), float(y), float(np.arctan2(ahead_y - y, ahead_x - x)), 5.0)


def place_on(route: Route, state: VehicleState) -> float:
    """Before the end of its first lane."""
    return next_place(route, state, route.starts_m[1] - 8.0)


def along(town: Town, lane: Lane, path: Lane, state: VehicleState) -> np.ndarray:
    """[20, 2] a path in `ego` 1.2 m apart along lane and path and on."""
    route = route_over(town, lane, path)
    start_m = place_on(route, state)
    xy_m, _ = route.pose(start_m + 1.2 * np.arange(1, 21))
    away = xy_m - [state.x_m, state.y_m]
    cos, sin = np.cos(state.yaw_rad), np.sin(state.yaw_rad)
    return away @ np.array([[cos, -sin], [sin, cos]])


def test_templates_of_other_ways_are_masked(town: Town) -> None:
    lane, paths = fork(town)
    state = before_the_end(lane)
    ways = np.stack([along(town, lane, path, state) for path in paths])
    for i, path in enumerate(paths):
        route = route_over(town, lane, path)
        stays = on_route(ways, state, town, route, place_on(route, state))
        assert stays.tolist() == [j == i for j in range(len(paths))]


def test_how_far_off_a_lane_is_off(town: Town) -> None:
    """A path beside the middle stays on the lane up to half its width."""
    lane, (path, *_) = fork(town)
    state = before_the_end(lane)
    route = route_over(town, lane, path)
    ahead = np.stack([0.3 * np.arange(1, 21), np.zeros(20)], axis=1)
    half_m = lane.width_m / 2
    for side in (-1.0, 1.0):
        beside = np.stack([ahead + np.array([0.0, side * d]) for d in (half_m - 0.2, half_m + 0.2)])
        stays = on_route(beside, state, town, route, place_on(route, state))
        assert stays.tolist() == [True, False]


def test_a_neighbour_in_the_same_direction_is_allowed_and_the_other_direction_not(
    town: Town,
) -> None:
    lane = next(
        lane for lane in town.lanes if lane.turn is None and lane.left_lane and not lane.right_lane
    )
    path = town.lanes[lane.successors[0]]
    state = before_the_end(lane)
    route = route_over(town, lane, path)
    ahead = np.stack([0.3 * np.arange(1, 21), np.zeros(20)], axis=1)
    changes = np.stack([ahead + np.array([0.0, k * lane.width_m]) for k in (-1.0, 0.0, 1.0, 2.0)])
    stays = on_route(changes, state, town, route, place_on(route, state))
    assert stays.tolist() == [False, True, True, False]


def test_what_is_left_is_renormalised() -> None:
    log_prob = np.log([0.5, 0.3, 0.2])
    gated = pass_gate(log_prob, np.array([False, True, True]))
    assert gated is not None
    np.testing.assert_allclose(np.exp(gated), [0.0, 0.6, 0.4])
    assert pass_gate(log_prob, np.zeros(3, dtype=bool)) is None
    certain = np.array([0.0, -np.inf, -np.inf])
    assert pass_gate(certain, np.array([False, True, True])) is None


def test_where_a_route_comes_by_again_the_place_is_that_of_this_time(town: Town) -> None:
    """Once round a block: the same lane twice."""
    lane, _ = fork(town)
    lanes = [lane]
    while len(lanes) < 40 and (len(lanes) < 3 or lanes[-1] is not lane):
        onward = [town.lanes[i] for i in lanes[-1].successors]
        # Right turns alone lead round a block.
        lanes.append(next((path for path in onward if path.turn == "right"), onward[0]))
    assert lanes[-1] is lane
    route = follow_lanes(lanes, 1.0)
    state = before_the_end(lane)
    first_m = place_on(route, state)
    second_m = first_m + route.starts_m[-2]
    assert first_m < route.starts_m[1]
    assert next_place(route, state, first_m - 1.0) == first_m
    assert next_place(route, state, second_m - 1.0) == pytest.approx(second_m, abs=1.0)
    beside = replace(state, x_m=state.x_m + 1.0)
    assert next_place(route, beside, first_m) == pytest.approx(first_m, abs=1.5)
