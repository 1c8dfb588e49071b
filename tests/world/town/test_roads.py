from dataclasses import fields

import numpy as np
import pytest
import shapely

from shoot.world.town.curves import arc_lengths, cut, parallel, round_corners, turn_between
from shoot.world.town.network import NARROW, NORMAL, SPEED_PER_WIDTH_PER_S, WIDE
from shoot.world.town.roads import make_town
from shoot.world.town.town import Town

SEEDS = range(6)


@pytest.fixture(scope="module")
def towns() -> list[Town]:
    return [make_town(seed) for seed in SEEDS]


def _flat(thing: object) -> list[bytes]:
    """Every number and word of a nested dataclass."""
    if hasattr(thing, "__dataclass_fields__"):
        return [b for f in fields(thing) for b in _flat(getattr(thing, f.name))]  # type: ignore[arg-type]
    if isinstance(thing, tuple):
        return [b for part in thing for b in _flat(part)]
    if isinstance(thing, np.ndarray):
        return [thing.tobytes()]
    if isinstance(thing, shapely.Geometry):
        return [shapely.to_wkb(thing)]
    return [repr(thing).encode()]


def _ends(points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    first, last = points[1] - points[0], points[-1] - points[-2]
    return first / np.hypot(*first), last / np.hypot(*last)


def test_a_quarter_turn_is_the_arc_worked_out_by_hand() -> None:
    path = turn_between(
        np.array([0.0, 0.0]), np.array([1.0, 0.0]), np.array([7.0, 7.0]), np.array([0.0, 1.0])
    )
    radius = np.hypot(*(path - np.array([0.0, 7.0])).T)
    np.testing.assert_allclose(radius, 7.0, atol=1e-9)
    assert arc_lengths(path)[-1] == pytest.approx(7.0 * np.pi / 2, rel=1e-3)


def test_a_parallel_to_the_left_lies_on_the_left() -> None:
    line = np.array([[2.0, 1.0], [2.0, 3.0], [2.0, 5.0]])  # northwards: left is west
    np.testing.assert_allclose(parallel(line, 1.5)[:, 0], 0.5)


def test_rounding_keeps_the_wished_radius_and_the_straight_ends() -> None:
    corner = np.array([[0.0, 0.0], [40.0, 0.0], [40.0, 40.0]])
    curve = round_corners(corner, np.array([10.0]), keep_m=(5.0, 5.0))
    inner = curve[(curve[:, 0] > 30.0) & (curve[:, 1] < 10.0)]
    np.testing.assert_allclose(np.hypot(*(inner - np.array([30.0, 10.0])).T), 10.0, atol=1e-9)
    tight = round_corners(corner, np.array([1000.0]), keep_m=(5.0, 5.0))
    np.testing.assert_allclose(tight[1], [5.0, 0.0], atol=1e-9)
    np.testing.assert_allclose(cut(corner, 30.0, 50.0), [[30, 0], [40, 0], [40, 10]])


def test_same_seed_same_town_other_seed_other_town(towns: list[Town]) -> None:
    assert _flat(make_town(0)) == _flat(towns[0])
    assert _flat(towns[1]) != _flat(towns[0])


def test_lanes_go_on_where_their_predecessor_ends(towns: list[Town]) -> None:
    for town in towns:
        for i, lane in enumerate(town.lanes):
            assert lane.lane_id == i
            assert np.hypot(*np.diff(lane.centreline_m, axis=0).T).max() <= 1.0
            _, heading = _ends(lane.centreline_m)
            for successor in lane.successors:
                onward = town.lanes[successor].centreline_m
                np.testing.assert_allclose(onward[0], lane.centreline_m[-1], atol=1e-6)
                # Half a chord of the tightest arc.
                assert _ends(onward)[0] @ heading > np.cos(0.06)


def test_nobody_reaches_a_dead_end_and_every_lane_is_reached(towns: list[Town]) -> None:
    for town in towns:
        reached = {s for lane in town.lanes for s in lane.successors}
        assert all(lane.successors for lane in town.lanes)
        assert reached == set(range(len(town.lanes)))


def test_traffic_keeps_to_the_right(towns: list[Town]) -> None:
    """The middle of the road lies to the left of every lane, half a lane away or further."""
    for town in towns:
        for lane in town.lanes:
            if lane.left_lane is not None:
                other = town.lanes[lane.left_lane].centreline_m
                left_m = parallel(lane.centreline_m, lane.width_m)
                half = len(left_m) // 2
                assert np.hypot(*(other - left_m[half]).T).min() < 0.6
                assert town.lanes[lane.left_lane].right_lane == lane.lane_id
    kerb_side = [
        (town, lane) for town in towns for lane in town.lanes
        if lane.right_lane is None and lane.turn is None
    ]  # fmt: skip
    assert len(kerb_side) > 50
    for town, lane in kerb_side:
        shapely.prepare(town.road)
        start = lane.centreline_m[:1], _ends(lane.centreline_m)[0]
        right = start[0] + np.array([start[1][1], -start[1][0]]) * (lane.width_m / 2 + 1.2)
        left = start[0] - np.array([start[1][1], -start[1][0]]) * (lane.width_m / 2 + 1.2)
        beyond = shapely.contains_xy(town.road, *(right + 6.0 * start[1]).T)
        within = shapely.contains_xy(town.road, *(left + 6.0 * start[1]).T)
        assert within.all()
        assert not beyond.any()


def test_left_turns_turn_left(towns: list[Town]) -> None:
    for town in towns:
        for lane in town.lanes:
            if lane.turn is None:
                continue
            before, after = _ends(lane.centreline_m)
            angle = np.arctan2(before[0] * after[1] - before[1] * after[0], before @ after)
            assert {"left": angle > 0.7, "right": angle < -0.7, "straight": abs(angle) < 0.85}[
                lane.turn
            ]


def test_approaches_are_straight(towns: list[Town]) -> None:
    for town in towns:
        for lane in town.lanes:
            if lane.turn is None:
                s_m = arc_lengths(lane.centreline_m)
                last = lane.centreline_m[s_m > s_m[-1] - 11.0]
                assert arc_lengths(last)[-1] - np.hypot(*(last[-1] - last[0])) < 1e-6


def test_all_roads_are_on_asphalt_and_nothing_stands_on_them(towns: list[Town]) -> None:
    for town in towns:
        driven = shapely.union_all(
            [shapely.LineString(lane.centreline_m).buffer(1.1) for lane in town.lanes]
        )
        assert shapely.difference(driven, town.road).area < 0.5
        assert shapely.intersection(town.pavement, town.road).area < 0.5
        houses = shapely.union_all([shapely.Polygon(b.outline_m) for b in town.buildings])
        assert not shapely.intersects(houses, town.road)
        assert not shapely.intersects(houses, town.pavement)
        props = np.array([prop.xy_m for prop in town.props])
        feet = np.concatenate([signal.pole_feet_m for signal in town.signals])
        for points in (props, feet):
            assert not shapely.contains_xy(town.road, *points.T).any()
        cars = np.array([car.xy_m for car in town.parked_cars])
        assert shapely.contains_xy(town.parking.buffer(0.05), *cars.T).all()
        reach = np.concatenate([b.outline_m for b in town.buildings])
        assert reach.min() > 0.0
        assert reach.max() < town.size_m


def test_arms_of_an_intersection_are_alike(towns: list[Town]) -> None:
    """Lights, stop lines and crosswalks on all approaches or on none: the route leaves no trace."""
    signalled = 0
    for town in towns:
        for index, crossing in enumerate(town.intersections):
            inbound = [
                lane for lane in town.lanes if lane.turn is None and lane.intersection == index
            ]
            lights = {lane.signal for lane in inbound}
            assert (None in lights) != crossing.is_signalled
            assert not crossing.is_signalled or len(lights) == crossing.num_arms
            heads = {len(town.signals[i].heads_m) for i in lights if i is not None}
            assert len(heads) <= 1
            near = {
                sum(at > arc_lengths(lane.centreline_m)[-1] - 8.0 for _, at in lane.crosswalks)
                for lane in inbound
            }
            assert len(near) == 1
            signalled += crossing.is_signalled
    assert signalled > 10


def test_lights_of_crossing_roads_differ_and_face_their_drivers(towns: list[Town]) -> None:
    for town in towns:
        for lane in town.lanes:
            if lane.signal is None:
                continue
            signal = town.signals[lane.signal]
            heading = _ends(lane.centreline_m)[1]
            facing = np.array([np.cos(signal.facing_rad), np.sin(signal.facing_rad)])
            assert heading @ facing < -0.999
            assert lane.stop_at_m is not None
            stop = lane.centreline_m[-1] - heading * (
                arc_lengths(lane.centreline_m)[-1] - lane.stop_at_m
            )
            ahead_m = (signal.heads_m[:, :2] - stop) @ heading
            assert ahead_m.min() > 3.0
            assert ahead_m.max() < 60.0
        for index, crossing in enumerate(town.intersections):
            if crossing.is_signalled:
                phases = {
                    town.signals[lane.signal].phase
                    for lane in town.lanes
                    if lane.intersection == index and lane.signal is not None
                }
                assert phases == {0, 1}


def test_the_look_of_a_road_tells_its_speed(towns: list[Town]) -> None:
    by_width = {}
    for town in towns:
        for lane in town.lanes:
            if lane.turn is None:
                by_width.setdefault(lane.width_m, set()).add(lane.limit_mps)
    kinds = (NARROW, NORMAL, WIDE)
    for width_m, limits_mps in by_width.items():
        (limit_mps,) = limits_mps  # no two roads as wide as each other allow different speeds
        expected = [k.limit_mps + SPEED_PER_WIDTH_PER_S * (width_m - k.lane_m) for k in kinds]
        assert min(abs(limit_mps - e) for e in expected) < 1e-9
    for town in towns:
        lines = shapely.union_all(
            [shapely.LineString(li.points_m) for li in town.lines if li.kind == "centre"]
        )
        for lane in town.lanes:
            if lane.turn is None:
                middle = shapely.Point(lane.centreline_m[len(lane.centreline_m) // 2])
                has_centre = shapely.distance(lines, middle) < 1.6 * lane.width_m
                extra_m = lane.width_m - NARROW.lane_m
                narrow_mps = NARROW.limit_mps + SPEED_PER_WIDTH_PER_S * extra_m
                assert has_centre == (abs(lane.limit_mps - narrow_mps) > 1e-9)


def test_crosswalks_are_where_the_lanes_say(towns: list[Town]) -> None:
    for town in towns:
        crossed = 0
        for lane in town.lanes:
            s_m = arc_lengths(lane.centreline_m)
            for index, at_m in lane.crosswalks:
                outline = shapely.Polygon(town.crosswalks[index].outline_m)
                at = [
                    np.array([np.interp(at_m + d, s_m, lane.centreline_m[:, i]) for i in (0, 1)])
                    for d in (-0.4, 0.4, 2.6, 3.4)
                ]
                inside = shapely.contains_xy(outline, *np.array(at).T)
                assert inside.tolist() == [False, True, True, False]
                crossed += 1
        assert crossed > 10
