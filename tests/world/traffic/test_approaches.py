import numpy as np
import pytest
from numpy.typing import NDArray
from world_fixture import result_beside

from shoot.world.town.curves import arc_lengths
from shoot.world.town.roads import make_town
from shoot.world.town.town import FloatArray, Lane, Town
from shoot.world.traffic.approaches import EGO_PARTS_M, Approach, find_approaches, way_ahead
from shoot.world.traffic.driver import BRAKE_MPS2, follow_lanes
from shoot.world.traffic.recording import GREEN, Recording
from shoot.world.traffic.scenario import BURN_IN_STEPS, make_scenario, simulate
from shoot.world.traffic.traffic import STEP_S

DURATION_S = 12.0
# Seed of town and scene, and what came of it.
Scene = tuple[int, Town, Recording, tuple[Approach, ...]]
# [ways, 4] what is to be seen on each arm, and which one was taken.
Arms = tuple[FloatArray, int]


@pytest.fixture(scope="module")
def scenes() -> list[Scene]:
    found: list[Scene] = result_beside(_first_scenes)
    return found


def _first_scenes() -> list[Scene]:
    """The first few scenes, as many as it takes to see the ego cross two intersections."""
    found = []
    num_driven = 0
    for seed in range(20):
        town = make_town(seed)
        recording = make_scenario(town, seed, DURATION_S)
        lanes = [town.lanes[lane] for lane in dict.fromkeys(recording.ego_lane.tolist())]
        if not any(len(lane.successors) > 1 and lane is not lanes[-1] for lane in lanes):
            continue
        times_s = np.arange(len(recording.ego_yaw_rad)) * recording.dt_s
        approaches = find_approaches(town, seed, times_s, recording.ego_xy_m)
        found.append((seed, town, recording, approaches))
        num_driven += sum(bool(_on_path(recording, a).any()) for a in approaches)
        if num_driven >= 2:
            break
    return found


def _on_path(recording: Recording, approach: Approach) -> NDArray[np.bool_]:
    return np.isin(recording.ego_lane, approach.ways)


def test_the_way_taken_is_the_one_the_ego_drives(
    scenes: list[Scene],
) -> None:
    num_driven = 0
    for _, town, recording, approaches in scenes:
        for approach in approaches:
            assert approach.ways == town.lanes[approach.lane].successors
            times_s = np.arange(len(recording.ego_lane)) * recording.dt_s
            on_lane_s = times_s[recording.ego_lane == approach.lane]
            assert on_lane_s[0] == pytest.approx(approach.start_s, abs=0.11)
            assert on_lane_s[-1] == pytest.approx(approach.end_s, abs=0.16)
            driven = recording.ego_lane[_on_path(recording, approach)]
            if len(driven):
                num_driven += 1
                assert set(driven) == {approach.ways[approach.taken]}
    assert num_driven >= 2


def test_what_the_ego_does_depends_on_its_way_before_it_is_on_it_and_not_for_long(
    scenes: list[Scene],
) -> None:
    for _, town, recording, approaches in scenes:
        for approach in approaches:
            if not _on_path(recording, approach).any():
                continue
            assert approach.ego_parts_s <= approach.end_s + 2 * STEP_S
            at = round(max(approach.ego_parts_s, 0.0) / recording.dt_s)
            speed_mps = recording.ego_speed_mps[at]
            _, rest_m = way_ahead(town, approach, approach.ways[0], recording.ego_xy_m[at])
            # Who brakes for a turn, or gives way at the line, needs no more than this.
            assert rest_m < speed_mps**2 / (2 * 0.8 * BRAKE_MPS2) + 14.0


def test_stages_follow_each_other() -> None:
    approach = Approach(0, (1, 2), 0, True, 0.0, 9.0, others_part_s=4.0, ego_parts_s=6.0)
    stages = [approach.stage(t, margin_s=0.0) for t in (0.0, 3.9, 4.0, 5.9, 6.0, 8.0)]
    assert stages == ["hidden", "hidden", "others", "others", "ego", "ego"]
    # A camera that fires a little later must not have seen it either.
    assert approach.stage(5.95, margin_s=0.1) == "ego"


def test_a_scene_of_another_seed_is_refused(
    scenes: list[Scene],
) -> None:
    seed, town, recording, _ = scenes[0]
    times_s = np.arange(len(recording.ego_yaw_rad)) * recording.dt_s
    with pytest.raises(ValueError, match="no car of this town and seed"):
        find_approaches(town, seed + 1, times_s[:21], recording.ego_xy_m[:21])


def test_way_ahead_begins_at_the_ego_and_leads_across(
    scenes: list[Scene],
) -> None:
    _, town, _, approaches = scenes[0]
    approach = approaches[0]
    lane_m = town.lanes[approach.lane].centreline_m
    here = lane_m[len(lane_m) // 2] + 0.1
    for way in approach.ways:
        points_m, rest_m = way_ahead(town, approach, way, here)
        assert np.hypot(*(points_m[0] - here)) < 0.6
        s_m = arc_lengths(points_m)
        assert s_m[-1] > rest_m + 80.0
        assert np.diff(s_m).max() < 1.01
        end = int(np.argmin(np.abs(s_m - rest_m)))
        assert np.hypot(*(points_m[end] - town.lanes[way].centreline_m[0])) < 0.3


def test_speed_before_a_turn_is_the_same_until_braking_for_it_begins() -> None:
    # On a lane of a one-lane road: the routes' caps agree, then part within the braking distance.
    town = make_town(3)
    for lane in town.lanes:
        if lane.turn is not None or lane.left_lane or lane.right_lane or len(lane.successors) < 2:
            continue
        routes = [
            follow_lanes([lane, town.lanes[w], town.lanes[town.lanes[w].successors[0]]], 1.0)
            for w in lane.successors
        ]
        length_m = routes[0].starts_m[1]
        at_m = np.arange(len(routes[0].cap_mps)) * 0.5
        early = at_m < length_m - lane.limit_mps**2 / (2 * BRAKE_MPS2) - 2.0
        for route in routes[1:]:
            same = np.abs(route.cap_mps[: early.sum()] - routes[0].cap_mps[: early.sum()])
            assert same.max(initial=0.0) < 1e-6
            before = int((length_m - 2.0) / 0.5)
            # On the lane itself the path does not depend on where it leads.
            np.testing.assert_allclose(route.xy_m[:before], routes[0].xy_m[:before], atol=1e-9)
            assert np.abs(route.yaw_rad[:before] - routes[0].yaw_rad[:before]).max() < 1e-9
    assert EGO_PARTS_M < 0.05


def _inbound_beside(town: Town, target: Lane, intersection: int | None) -> Lane | None:
    """The lane that comes in on the arm on which `target` goes out."""
    inbound = [x for x in town.lanes if x.turn is None and x.intersection == intersection]
    start = target.centreline_m[0]
    gaps_m = [float(np.hypot(*(x.centreline_m[-1] - start))) for x in inbound]
    return inbound[int(np.argmin(gaps_m))] if inbound else None


def _arms_and_taken(num_scenes: int) -> list[Arms]:
    """Every car stands in for the ego, which is one of them.

    That is: those that are too far from their intersection to have asked for their way yet.
    """
    rows: list[Arms] = []
    for number in range(num_scenes):
        town = make_town(100 + number // 3)
        plan, cars, walkers = simulate(town, np.random.default_rng(number), 0.5)
        states = plan.states(0.0)
        at_m = [car.trace[BURN_IN_STEPS][0] for car in cars]
        cars_xy = np.array(
            [c.route.pose(np.array([s]))[0][0] for c, s in zip(cars, at_m, strict=True)]
        )
        people_xy = np.array([_walker_xy(w.path_m, w.trace_m[BURN_IN_STEPS]) for w in walkers])
        for k, car in enumerate(cars):
            place = car.trace[BURN_IN_STEPS][3]
            if place + 1 == len(car.route.lanes):
                continue
            lane = town.lanes[car.route.lanes[place]]
            rest_m = car.route.starts_m[place + 1] - at_m[k]
            if lane.turn is not None or len(lane.successors) < 2 or rest_m < 45.0:
                continue
            others = np.delete(cars_xy, k, axis=0)
            values = []
            for way in lane.successors:
                target = town.lanes[town.lanes[way].successors[0]]
                beside = _inbound_beside(town, target, lane.intersection)
                signal = beside.signal if beside is not None else None
                heads = 0 if signal is None else len(town.signals[signal].heads_m)
                is_green = signal is not None and states[signal] == GREEN
                near = target.centreline_m[arc_lengths(target.centreline_m) < 45.0]
                values.append(
                    [heads, float(is_green), _count_near(others, near, 9.0),
                     _count_near(people_xy, near[:12], 12.0)]
                )  # fmt: skip
            rows.append((np.array(values), lane.successors.index(car.route.lanes[place + 1])))
    return rows


@pytest.mark.slow
@pytest.mark.parametrize("num_scenes", [12, pytest.param(30, marks=pytest.mark.full)])
def test_arms_look_alike_whichever_is_taken(num_scenes: int) -> None:
    """Lights, their colours, vehicles and people on an arm say nothing about who goes there.

    Which way they take is drawn anew to learn what chance does; a rule that favoured the way taken
    would lie outside.
    """
    rows: list[Arms] = result_beside(_arms_and_taken, num_scenes)
    assert len(rows) > 3 * num_scenes
    rng = np.random.default_rng(0)
    found = _excess([taken for _, taken in rows], rows)
    drawn = np.array(
        [_excess([int(rng.integers(len(v))) for v, _ in rows], rows) for _ in range(2000)]
    )
    p = (np.abs(drawn) >= np.abs(found)).mean(axis=0)
    assert (p > 0.01).all(), dict(zip(("heads", "green", "vehicles", "people"), p, strict=True))
    # The numbers do differ from arm to arm: the test could have failed.
    assert (drawn.std(axis=0)[1:] > 0.0).all()


def _excess(chosen: list[int], rows: list[Arms]) -> FloatArray:
    """[4] sum over approaches of what the chosen arm has more than the arms have on average."""
    return np.sum([v[i] - v.mean(axis=0) for i, (v, _) in zip(chosen, rows, strict=True)], axis=0)


def _count_near(points_m: FloatArray, line_m: FloatArray, reach_m: float) -> int:
    if not len(points_m):
        return 0
    away_m = np.hypot(*(points_m[:, None] - line_m).transpose(2, 0, 1)).min(axis=1)
    return int((away_m < reach_m).sum())


def _walker_xy(path_m: FloatArray, at_m: float) -> FloatArray:
    s_m = arc_lengths(path_m)
    return np.array([np.interp(at_m, s_m, path_m[:, i]) for i in (0, 1)])
