import numpy as np
import pytest
from world_fixture import result_beside

from shoot.world.town.curves import arc_lengths
from shoot.world.town.roads import make_town
from shoot.world.town.town import Town
from shoot.world.traffic.cars import Car
from shoot.world.traffic.driver import (
    BRAKE_MPS2,
    ROUTE_STEP_M,
    follow_accel,
    follow_lanes,
    plan_route,
    stop_accel,
)
from shoot.world.traffic.junctions import PathRules, SignalPlan, path_rules
from shoot.world.traffic.recording import AMBER, GREEN, RED
from shoot.world.traffic.scenario import simulate
from shoot.world.traffic.traffic import STEP_S, Traffic
from shoot.world.traffic.walkers import Pavements


@pytest.fixture(scope="module")
def town() -> Town:
    return make_town(0)


@pytest.fixture(scope="module")
def runs() -> list[tuple[Town, list[Car]]]:
    driven: list[tuple[Town, list[Car]]] = result_beside(_drive)
    return driven


def _drive() -> list[tuple[Town, list[Car]]]:
    towns = [make_town(seed) for seed in (1, 2, 3)]
    return [
        (town, simulate(town, np.random.default_rng(seed), duration_s=25.0)[1])
        for seed, town in enumerate(towns)
    ]


def test_following_is_in_balance_at_the_wished_gap() -> None:
    wished_m = 2.5 + 1.3 * 8.0
    assert follow_accel(8.0, wished_m, 8.0) == pytest.approx(0.0)
    assert follow_accel(8.0, 2 * wished_m, 8.0) > 0.0
    assert follow_accel(8.0, wished_m / 2, 8.0) < -5.0
    assert follow_accel(8.0, wished_m, 6.0) < 0.0 < follow_accel(8.0, wished_m, 10.0) + 1e-9


@pytest.mark.parametrize("start_mps", [4.0, 9.5, 13.0])
def test_stopping_ends_at_the_line_and_place_tells_speed(start_mps: float) -> None:
    room_m, speed = 60.0, start_mps
    hardest = 0.0
    while speed > 0.02 and room_m > 0.0:
        accel = min(0.0, stop_accel(speed, room_m))
        if room_m > 0.3:
            hardest = min(hardest, accel)
        room_m -= speed * STEP_S + accel * STEP_S**2 / 2
        speed = max(0.0, speed + accel * STEP_S)
        if accel < 0.0 and room_m > 1.0:
            # All who brake for a line are on the same curve of speed over distance.
            assert speed**2 / (2 * room_m) == pytest.approx(0.93 * BRAKE_MPS2, rel=0.12)
    assert 0.0 <= room_m < 0.3
    assert hardest > -1.3 * BRAKE_MPS2


def test_routes_are_drivable_and_braking_is_always_enough(town: Town) -> None:
    route = plan_route(town, 0, 800.0, 1.0, np.random.default_rng(0))
    for before, after in zip(route.lanes[:-1], route.lanes[1:], strict=True):
        assert after in town.lanes[before].successors
    energy = route.cap_mps**2 / 2
    assert np.diff(energy).min() > -BRAKE_MPS2 * ROUTE_STEP_M - 1e-9
    limits = np.array([town.lanes[lane].limit_mps for lane in route.lanes])
    at_m = np.arange(len(route.cap_mps)) * ROUTE_STEP_M
    place = np.clip(np.searchsorted(route.starts_m, at_m, side="right") - 1, 0, len(limits) - 1)
    assert (route.cap_mps <= limits[place] + 1e-9).all()
    bend = np.abs(np.gradient(route.yaw_rad, ROUTE_STEP_M))
    assert (route.cap_mps**2 * bend).max() < 4.2  # with half-metre chords; 3 m/s^2 when smoothed


def test_every_way_on_is_taken_equally_often(town: Town) -> None:
    """On a road of one lane a side the lane tells nothing of the route."""
    rng = np.random.default_rng(1)
    lane = next(
        lane for lane in town.lanes
        if lane.turn is None and len(lane.successors) == 3 and lane.left_lane is None
        and lane.right_lane is None
    )  # fmt: skip
    taken = [plan_route(town, lane.lane_id, 120.0, 1.0, rng).lanes[1] for _ in range(600)]
    counts = [taken.count(path) for path in lane.successors]
    assert min(counts) > 150
    assert {town.lanes[path].turn for path in lane.successors} == {"left", "straight", "right"}


def test_before_the_braking_for_a_turn_nothing_tells_the_route(town: Town) -> None:
    """Whichever way is taken, speed and place on the lane are equal until braking must start."""
    rng = np.random.default_rng(2)
    lane = next(
        lane for lane in town.lanes
        if lane.turn is None and len(lane.successors) == 3 and lane.right_lane is None
        and lane.left_lane is None
    )  # fmt: skip
    length_m = arc_lengths(lane.centreline_m)[-1]
    free = int((length_m - (lane.limit_mps**2 - 4.0**2) / (2 * BRAKE_MPS2)) / ROUTE_STEP_M) - 2
    first: dict[int, tuple[bytes, bytes]] = {}
    for _ in range(30):
        route = plan_route(town, lane.lane_id, 200.0, 1.0, rng)
        look = route.xy_m[:free].tobytes(), route.cap_mps[:free].tobytes()
        assert first.setdefault(route.lanes[1], look) == look
    assert len(first) == 3
    assert len(set(first.values())) == 1


def test_lights_follow_their_plan() -> None:
    plan = SignalPlan(np.array([10.0, 10.0]), np.array([2.0, 16.5]))
    assert plan.cycle_s().tolist() == [29.0, 29.0]
    times_s = np.array([2.0, 11.9, 12.1, 14.9, 15.1, 16.6, 26.6, 29.6, 31.1])
    own, other = plan.states(times_s).T.tolist()
    assert own == [GREEN, GREEN, AMBER, AMBER, RED, RED, RED, RED, GREEN]
    assert other == [RED, RED, RED, RED, RED, GREEN, AMBER, RED, RED]
    assert plan.until_green_s(14.0).tolist() == [17.0, 2.5]


def test_paths_that_cross_conflict_and_neighbours_do_not(town: Town) -> None:
    rules = path_rules(town)
    source = {path: lane for lane in town.lanes for path in lane.successors}
    crossed = passed = 0
    for path, rule in rules.items():
        assert all(path in rules[other].conflicts for other in rule.conflicts)
        siblings = {q for q, _ in rule.siblings}
        assert siblings == set(source[path].successors) - {path}
        assert not siblings & rule.conflicts
        lane = town.lanes[path]
        for other in rules:
            if town.lanes[other].intersection != lane.intersection or other == path:
                continue
            gap_m = np.hypot(
                *(lane.centreline_m[:, None] - town.lanes[other].centreline_m).transpose(2, 0, 1)
            ).min()
            if other in siblings:
                continue
            if gap_m < 1.0:
                assert other in rule.conflicts
                crossed += 1
            # Half a truck, half a truck, and how far a tight turn swings out.
            elif gap_m > 6.5:
                assert other not in rule.conflicts
                passed += 1
    assert crossed > 50
    assert passed > 20


def test_oncoming_traffic_going_straight_passes() -> None:
    met = 0
    for town in (make_town(seed) for seed in (0, 1)):
        rules: dict[int, PathRules] = path_rules(town)
        straight = [p for p in rules if town.lanes[p].turn == "straight"]
        for p in straight:
            for q in straight:
                a, b = (town.lanes[i].centreline_m for i in (p, q))
                if town.lanes[p].intersection != town.lanes[q].intersection:
                    continue
                if (a[-1] - a[0]) @ (b[-1] - b[0]) < -0.8 * np.hypot(*(a[-1] - a[0])) * np.hypot(
                    *(b[-1] - b[0])
                ):
                    met += 1
                    assert q not in rules[p].conflicts
    assert met > 10


def test_left_turners_do_not_know_where_oncoming_cars_will_go(town: Town) -> None:
    rng = np.random.default_rng(3)
    plan, cars, walkers = simulate(town, rng, duration_s=1.0)
    traffic = Traffic(town, plan, Pavements(town, plan, walkers), cars)
    all_green = np.full(len(town.signals), GREEN)
    rules = path_rules(town)
    answers = {}
    for car in cars:
        # As it stands after the last step, a little before its next intersection or on one.
        place, _ = traffic._gate(car)
        source = car.route.lanes[place - 1]
        if len(town.lanes[source].successors) < 2:
            continue
        before = [town.lanes[i] for i in car.route.lanes[:place]]
        for path in town.lanes[source].successors:
            ahead = [town.lanes[path], town.lanes[town.lanes[path].successors[0]]]
            car.route = follow_lanes([*before, *ahead], car.route.pace)
            for asker in cars:
                if asker is not car:
                    ask_place, _ = traffic._gate(asker)
                    conflicts = rules[asker.route.lanes[ask_place]].conflicts
                    answer = traffic._has_oncoming(asker, conflicts, all_green)
                    # The same whichever way this one will take.
                    assert answers.setdefault((id(car), id(asker)), answer) == answer
    assert len(answers) > 100
    assert 0 < sum(answers.values()) < len(answers)


def test_nobody_waits_for_ever(runs: list[tuple[Town, list[Car]]]) -> None:
    """Two cycles of the lights are the most; the next starts with those who found no gap."""
    for _, cars in runs:
        for car in cars:
            at_m = np.array([row[0] for row in car.trace])
            assert at_m[-1] - at_m[0] > 15.0
            assert np.diff(at_m).min() >= 0.0


def test_cars_turn_both_ways_and_go_straight(runs: list[tuple[Town, list[Car]]]) -> None:
    turns = [
        town.lanes[car.route.lanes[place]].turn
        for town, cars in runs
        for car in cars
        for place in {int(row[3]) for row in car.trace}
    ]
    taken = [turn for turn in turns if turn is not None]
    for turn in ("left", "straight", "right"):
        assert 0.15 < taken.count(turn) / len(taken) < 0.6


def test_traffic_beyond_an_intersection_does_not_tell_the_route(
    runs: list[tuple[Town, list[Car]]],
) -> None:
    """2 s before each path taken, cars on the lane behind it are as many as behind the others."""
    excess = []
    for town, cars in runs:
        places = {id(car): [car.route.lanes[int(row[3])] for row in car.trace] for car in cars}
        for car in cars:
            lanes = places[id(car)]
            for step in range(200, len(lanes) - 1):
                choices = town.lanes[lanes[step]].successors
                if lanes[step + 1] == lanes[step] or len(choices) < 2:
                    continue
                counts = {
                    choice: sum(
                        other is not car
                        and places[id(other)][step - 20] == town.lanes[choice].successors[0]
                        for other in cars
                    )
                    for choice in choices
                }
                rest = [n for choice, n in counts.items() if choice != lanes[step + 1]]
                excess.append(counts[lanes[step + 1]] - float(np.mean(rest)))
    assert len(excess) > 40
    assert abs(np.mean(excess)) < 3.5 * np.std(excess) / np.sqrt(len(excess))
