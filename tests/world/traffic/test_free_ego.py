"""Others around an ego that goes where it wants."""

from collections.abc import Iterator
from dataclasses import replace
from itertools import islice
from typing import get_args

import numpy as np
import pytest
import shapely
from numpy.typing import NDArray
from world_fixture import result_beside

from shoot.footprint import EGO_LENGTH_M, EGO_WIDTH_M, footprint_centres, rectangles_overlap
from shoot.world.town.roads import make_town
from shoot.world.town.town import FloatArray, Town
from shoot.world.traffic.bodies import EgoBody
from shoot.world.traffic.live import LiveTraffic, Mode, stage
from shoot.world.traffic.walkers import Walker

STAY_S = 20.0
NUM_PLACES = 3


@pytest.fixture(scope="module")
def town() -> Town:
    return make_town(3)


def _hits(live: LiveTraffic) -> NDArray[np.int64]:
    """Who shares ground with the ego."""
    bodies, yaw_rad = live.bodies, np.array([live.ego.yaw_rad])
    middle_m = footprint_centres(live.ego.xy_m[None], yaw_rad)
    ego_size_m = np.array([[EGO_LENGTH_M, EGO_WIDTH_M]])
    overlap = rectangles_overlap(
        bodies.xy_m, bodies.yaw_rad, live.cast.sizes_m[:, :2], middle_m, yaw_rad, ego_size_m
    )
    return np.flatnonzero(overlap)


def _stand(live: LiveTraffic, ego: EgoBody, seconds: float = STAY_S) -> set[int]:
    """Who touched an ego that stood somewhere for a while."""
    hit: set[int] = set()
    for step in range(round(seconds / 0.1)):
        live.step(ego)
        if step % 4 == 0:
            hit |= set(_hits(live).tolist())
    return hit


def _stages_across(town: Town, mode: Mode) -> Iterator[tuple[LiveTraffic, EgoBody, int]]:
    """Traffic, an ego across a free piece of lane, and a car that comes there, 35 m before it."""
    num_cars = [len(stage(town, seed, STAY_S, mode)._traffic.others()[0]) for seed in (1, 2)]
    for seed, num in zip((1, 2), num_cars, strict=True):
        for number in range(6, num, 2):
            live = stage(town, seed, STAY_S, mode)
            car = live._traffic.others()[0][number]
            at_m = car.at_m + 35.0
            xy_m, yaw_rad = car.route.pose(np.array([at_m]))
            lane = car.route.lanes[int(np.searchsorted(car.route.starts_m, at_m, "right")) - 1]
            is_free = np.hypot(*(live.bodies.xy_m - xy_m).T).min() > 14.0
            if town.lanes[lane].turn is None and is_free:
                yield live, EgoBody(xy_m[0], float(yaw_rad[0]) + 1.4, 0.0), number


def _stops_across() -> list[tuple[set[int], float, float]]:
    """Who touched the ego; the speed of a car that came, at the end, and how far off it is."""
    found = []
    for live, ego, number in islice(_stages_across(make_town(3), "reactive"), NUM_PLACES):
        hit = _stand(live, ego, 12.0)
        bodies = live.bodies
        away_m = float(np.hypot(*(bodies.xy_m[number] - ego.xy_m)))
        found.append((hit, float(bodies.speed_mps[number]), away_m))
    return found


def test_cars_stop_before_an_ego_across_their_lane() -> None:
    found = result_beside(_stops_across)
    assert len(found) == NUM_PLACES
    for hit, speed_mps, away_m in found:
        assert not hit
        assert speed_mps < 0.05
        assert away_m < 36.0


def _replays_across() -> tuple[bool, bool]:
    """(whether the car that comes drives through the ego, whether others are as without it)."""
    town = make_town(3)
    live, ego, number = next(_stages_across(town, "replay"))
    left = stage(town, 1, STAY_S, "replay")
    for _ in range(round(STAY_S / 0.1)):
        left.step(None)
    return number in _stand(live, ego), _everything(left) == _everything(live)


def test_replay_is_blind_to_an_ego_across_a_lane() -> None:
    assert result_beside(_replays_across) == (True, True)


def _in_the_middle() -> list[tuple[set[int], int]]:
    """Who touched an ego in the middle of an intersection, and how many cars are in it at last."""
    town, found = make_town(3), []
    for intersection in town.intersections:
        outline = shapely.Polygon(intersection.outline_m)
        middle_m = np.array(outline.centroid.coords[0])
        live = stage(town, 1, STAY_S, "reactive")
        num_cars = live.cast.kinds.index("pedestrian")
        away_m = np.hypot(*(live.bodies.xy_m - middle_m).T)
        if away_m[:num_cars].min() < 20.0 or away_m[num_cars:].min() < 5.0:
            continue
        hit = _stand(live, EgoBody(middle_m, 0.4, 0.0))
        inside = shapely.contains_xy(outline, *live.bodies.xy_m[:num_cars].T)
        found.append((hit, int(inside.sum())))
    return found


def test_nobody_enters_an_intersection_with_the_ego_in_its_middle() -> None:
    found = result_beside(_in_the_middle)
    assert len(found) >= NUM_PLACES
    assert found == [(set(), 0)] * len(found)


def _long_stand() -> tuple[bool, bool, FloatArray, FloatArray]:
    """What an ego holds that stood 7.5 s and 9.5 s, and what it then foresees: (way, speeds)."""
    live = _before_a_granted_path(make_town(3))
    stands = replace(live.ego, speed_mps=0.0)
    holds = []
    for num_steps in (75, 20):
        for _ in range(num_steps):
            live.step(stands)
        holds.append(bool(live._traffic._holds_of_ego()))
    xy_m, _, speed_mps = live.foresee(25.0)
    return holds[0], holds[1], xy_m - stands.xy_m, speed_mps


def test_an_ego_that_stands_for_long_returns_what_it_was_granted() -> None:
    held, holds, way_m, speed_mps = result_beside(_long_stand)
    assert held
    assert not holds
    # Left to the rules it asks again, and drives on.
    assert speed_mps.max() > 2.0
    assert np.hypot(*way_m[-1]) > 10.0


def _before_a_granted_path(town: Town) -> LiveTraffic:
    """An ego on a lane without lights that was granted the path behind it."""
    for seed in range(30):
        live = stage(town, seed, STAY_S, "reactive")
        ego = live._traffic.ego
        for _ in range(100):
            live.step(None)
            holds = live._traffic._holds_of_ego()
            lane = town.lanes[ego.route.lanes[ego.place]]
            if holds == [ego.place + 1] and lane.signal is None and lane.turn is None:
                return live
    raise AssertionError("no ego was granted a path")


def _someone_crosses() -> tuple[bool, float, float, bool]:
    """An ego for 8 s across the way of somebody who crosses a road; then it is gone.

    Returns:
        Whether they touched; pace and distance of who waits; whether the road was crossed at last.
    """
    town = make_town(3)
    for seed in range(12):
        live = stage(town, seed, STAY_S, "reactive")
        for _ in range(30):
            live.step(None)
        for number, walker in enumerate(live._traffic.others()[1]):
            if walker.crosswalk is None or not 0.3 < walker.at_m - walker.kerb_m < 3.0:
                continue
            ego = _across(walker, 3.2)
            if np.hypot(*(live.ego.xy_m - ego.xy_m)) < 40.0:
                continue
            pedestrian = live.cast.kinds.index("pedestrian") + number
            is_hit = pedestrian in _stand(live, ego, 8.0)
            away_m = float(np.hypot(*(live.bodies.xy_m[pedestrian] - ego.xy_m)))
            pace_mps = float(live.bodies.speed_mps[pedestrian])
            _stand(live, EgoBody(np.array([-500.0, -500.0]), 0.0, 0.0), 12.0)
            return is_hit, pace_mps, away_m, walker.at_m > walker.kerb_m + walker.road_m
    raise AssertionError("nobody was crossing")


def test_people_stop_short_of_an_ego_across_their_way_and_go_on_after_it() -> None:
    is_hit, pace_mps, away_m, is_across = result_beside(_someone_crosses)
    assert not is_hit
    assert pace_mps == 0.0
    assert away_m < 4.5
    assert is_across


def _across(walker: Walker, ahead_m: float) -> EgoBody:
    """An ego on a crosswalk, its side to somebody who comes."""
    (point_m,), (yaw_rad,) = walker.pose(np.array([walker.at_m + ahead_m]))
    along = np.array([-np.sin(yaw_rad), np.cos(yaw_rad)])
    return EgoBody(point_m - 1.05 * along, float(yaw_rad) + np.pi / 2, 0.0)


def _wild(live: LiveTraffic, num_steps: int) -> Iterator[LiveTraffic]:
    """An ego that swerves off its route, by chance, stops at times, and comes to stand."""
    rng, ego = np.random.default_rng(7), live.ego
    for step in range(num_steps):
        speed_mps = 5.0 if step < 0.7 * num_steps and step % 40 < 30 else 0.0
        yaw_rad = ego.yaw_rad + 0.06 * float(rng.normal())
        ahead = np.array([np.cos(yaw_rad), np.sin(yaw_rad)])
        ego = EgoBody(ego.xy_m + 0.1 * speed_mps * ahead, yaw_rad, speed_mps)
        live.step(ego)
        yield live


def _everything(live: LiveTraffic) -> bytes:
    bodies = live.bodies
    parts = (bodies.xy_m, bodies.yaw_rad, bodies.speed_mps, bodies.is_braking)
    return b"".join(part.tobytes() for part in parts)


def _runs_twice(mode: Mode) -> list[tuple[bytes, bytes]]:
    """Everybody now and then, in two runs of one seed; in the second the ego looks ahead."""
    town = make_town(3)
    plain, looked = (stage(town, 1, STAY_S, mode) for _ in range(2))
    found = []
    for step, (one, other) in enumerate(zip(_wild(plain, 80), _wild(looked, 80), strict=True)):
        if step % 20 == 0:
            other.foresee(2.0)
        if step % 20 == 19:
            found.append((_everything(one), _everything(other)))
    return found


@pytest.mark.parametrize("mode", get_args(Mode))
def test_same_seed_same_bytes_and_a_look_ahead_changes_nothing(mode: Mode) -> None:
    found = result_beside(_runs_twice, mode)
    assert all(one == other for one, other in found)
    assert len({one for one, _ in found}) == len(found)


def test_an_ego_aside_of_its_route_foresees_the_route_and_one_off_it_a_stop(town: Town) -> None:
    live = stage(town, 4, STAY_S, "reactive")
    for _ in range(10):
        live.step(None)
    here = live.ego
    ahead, left = _axes(here.yaw_rad)
    live.step(EgoBody(here.xy_m + 0.5 * ahead + 1.5 * left, here.yaw_rad + 0.2, 5.0))
    xy_m, _, speed_mps = live.foresee(3.0)
    route = shapely.LineString(live.route.xy_m)
    assert shapely.distance(route, shapely.points(xy_m)).max() < 0.01
    assert np.hypot(*(xy_m[0] - here.xy_m - 0.5 * ahead)) < 5.0 * 0.1 + 0.1
    assert len(xy_m) == len(speed_mps) == 30

    yaw_rad = here.yaw_rad + 1.3
    live.step(EgoBody(here.xy_m, yaw_rad, 6.0))
    xy_m, yaws_rad, speed_mps = live.foresee(3.0)
    own, side = _axes(yaw_rad)
    assert (xy_m[-1] - here.xy_m) @ own == pytest.approx(6.0**2 / (2 * 3.0))
    assert np.abs((xy_m - here.xy_m) @ side).max() < 1e-9
    assert set(yaws_rad) == {yaw_rad}
    assert speed_mps[0] == pytest.approx(5.7)
    assert speed_mps[-1] == 0.0


def _axes(yaw_rad: float) -> tuple[FloatArray, FloatArray]:
    ahead = np.array([np.cos(yaw_rad), np.sin(yaw_rad)])
    return ahead, np.array([-ahead[1], ahead[0]])
