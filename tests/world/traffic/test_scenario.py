from itertools import pairwise

import numpy as np
import pytest
import shapely
from world_fixture import result_beside

from shoot.world.town.roads import make_town
from shoot.world.town.town import FloatArray, Town
from shoot.world.traffic.recording import GREEN, RED, Recording
from shoot.world.traffic.scenario import describe, make_look, make_scenario

NUM_SCENES = 6
EGO_LENGTH_M, EGO_WIDTH_M, EGO_REAR_M = 4.1, 1.85, 1.0


@pytest.fixture(scope="module")
def scenes() -> list[tuple[Town, Recording]]:
    made: list[tuple[Town, Recording]] = result_beside(_make_scenes)
    return made


def _make_scenes() -> list[tuple[Town, Recording]]:
    towns = [make_town(seed) for seed in range(NUM_SCENES)]
    return [(town, make_scenario(town, seed)) for seed, town in enumerate(towns)]


def _ahead(yaw_rad: FloatArray) -> FloatArray:
    return np.stack([np.cos(yaw_rad), np.sin(yaw_rad)], axis=-1)


def _boxes(xy_m: FloatArray, yaw_rad: FloatArray, length_m: float, width_m: float) -> FloatArray:
    ahead = _ahead(yaw_rad) * length_m / 2
    left = np.stack([-ahead[:, 1], ahead[:, 0]], axis=1) * width_m / length_m
    corners = [xy_m + ahead + left, xy_m - ahead + left, xy_m - ahead - left, xy_m + ahead - left]
    return shapely.polygons(np.stack(corners, axis=1))  # type: ignore[no-any-return]


def _all_boxes(recording: Recording, every: int) -> list[tuple[str, FloatArray]]:
    middle_m = recording.ego_xy_m + _ahead(recording.ego_yaw_rad) * (EGO_LENGTH_M / 2 - EGO_REAR_M)
    ego = _boxes(middle_m[::every], recording.ego_yaw_rad[::every], EGO_LENGTH_M, EGO_WIDTH_M)
    return [("ego", ego)] + [
        (a.kind, _boxes(a.xy_m[::every], a.yaw_rad[::every], a.size_m[0], a.size_m[1]))
        for a in recording.agents
    ]


def test_same_seed_same_recording_other_seed_another() -> None:
    town = make_town(3)
    first, again, other = (make_scenario(town, seed, duration_s=3.0) for seed in (5, 5, 6))
    for a, b in (
        (first.ego_xy_m, again.ego_xy_m),
        (first.ego_yaw_rad, again.ego_yaw_rad),
        (first.signal_state, again.signal_state),
        *((p.xy_m, q.xy_m) for p, q in zip(first.agents, again.agents, strict=True)),
    ):
        assert a.tobytes() == b.tobytes()
    assert first.ego_xy_m.tobytes() != other.ego_xy_m.tobytes()


def test_tracks_have_one_entry_each_20th_of_a_second() -> None:
    town = make_town(3)
    recording = make_scenario(town, 1, duration_s=2.0)
    assert recording.dt_s == 0.05
    assert recording.ego_xy_m.shape == (41, 2)
    assert recording.ego_lane.shape == recording.ego_speed_mps.shape == (41,)
    assert recording.signal_state.shape == (41, len(town.signals))
    assert all(a.xy_m.shape == (41, 2) and a.is_braking.shape == (41,) for a in recording.agents)


def test_nobody_touches_anybody(scenes: list[tuple[Town, Recording]]) -> None:
    for town, recording in scenes:
        everybody = _all_boxes(recording, every=4)
        vehicles = [boxes for kind, boxes in everybody if kind != "pedestrian"]
        people = [boxes for kind, boxes in everybody if kind == "pedestrian"]
        parked = np.concatenate(
            [_boxes(c.xy_m[None], np.array([c.yaw_rad]), *c.size_m[:2]) for c in town.parked_cars]
        )
        for i, boxes in enumerate(vehicles):
            for others in (*vehicles[i + 1 :], *people):
                assert not shapely.intersects(boxes, others).any()
            assert not shapely.intersects(boxes[:, None], parked[None]).any()


def test_position_speed_and_heading_agree(scenes: list[tuple[Town, Recording]]) -> None:
    for _, recording in scenes:
        step_m = np.diff(recording.ego_xy_m, axis=0)
        middle_speed = (recording.ego_speed_mps[1:] + recording.ego_speed_mps[:-1]) / 2
        np.testing.assert_allclose(np.hypot(*step_m.T), middle_speed * 0.05, atol=0.01)
        moves = middle_speed > 0.5
        middle_yaw = (recording.ego_yaw_rad[1:] + recording.ego_yaw_rad[:-1]) / 2
        along = np.sum(step_m * _ahead(middle_yaw), axis=1)[moves]
        np.testing.assert_allclose(along, np.hypot(*step_m[moves].T), rtol=2e-3)
        assert np.abs(np.diff(recording.ego_yaw_rad)).max() < 0.06  # continuous: 1.2 rad/s
        accel = np.diff(recording.ego_speed_mps) / 0.05
        assert accel.max() < 2.6
        assert accel.min() > -5.0


def test_the_ego_follows_the_middle_of_its_lane(scenes: list[tuple[Town, Recording]]) -> None:
    for town, recording in scenes:
        for lane, xy_m in zip(recording.ego_lane[::5], recording.ego_xy_m[::5], strict=True):
            line = shapely.LineString(town.lanes[lane].centreline_m)
            assert shapely.distance(line, shapely.Point(xy_m)) < 0.02
        order = list(dict.fromkeys(recording.ego_lane.tolist()))
        for before, after in pairwise(order):
            assert after in town.lanes[before].successors


def test_nobody_runs_a_red_light(scenes: list[tuple[Town, Recording]]) -> None:
    passed = 0
    for town, recording in scenes:
        tracks = [(recording.ego_xy_m, recording.ego_yaw_rad, EGO_LENGTH_M - EGO_REAR_M)]
        tracks += [
            (a.xy_m, a.yaw_rad, a.size_m[0] / 2) for a in recording.agents if a.kind != "pedestrian"
        ]
        for xy_m, yaw_rad, reach_m in tracks:
            bumper = xy_m + _ahead(yaw_rad) * reach_m
            for lane in town.lanes:
                if lane.signal is None or lane.stop_at_m is None:
                    continue
                # The last metres of a lane are straight: its stop line is a plane to cross.
                heading = lane.centreline_m[-1] - lane.centreline_m[-2]
                heading /= np.hypot(*heading)
                length_m = np.hypot(*np.diff(lane.centreline_m, axis=0).T).sum()
                line = lane.centreline_m[-1] - heading * (length_m - lane.stop_at_m)
                along = (bumper - line) @ heading
                aside = (bumper - line) @ np.array([-heading[1], heading[0]])
                crosses = (along[:-1] <= 0) & (along[1:] > 0) & (np.abs(aside[1:]) < 1.0)
                for i in np.flatnonzero(
                    crosses
                    & (np.cos(yaw_rad[1:]) * heading[0] + np.sin(yaw_rad[1:]) * heading[1] > 0.9)
                ):
                    assert recording.signal_state[i, lane.signal] != RED
                    passed += 1
    assert passed > 20


def test_some_lights_are_green_but_never_on_crossing_roads(
    scenes: list[tuple[Town, Recording]],
) -> None:
    for town, recording in scenes:
        for index, crossing in enumerate(town.intersections):
            if not crossing.is_signalled:
                continue
            lights = {
                lane.signal: town.signals[lane.signal].phase
                for lane in town.lanes
                if lane.intersection == index and lane.signal is not None
            }
            state = recording.signal_state
            moving = [
                (state[:, [s for s, p in lights.items() if p == phase]] != RED).any(axis=1)
                for phase in (0, 1)
            ]
            assert not (moving[0] & moving[1]).any()
            assert (moving[0] | moving[1]).any()
            for phase in (0, 1):
                own = state[:, [s for s, p in lights.items() if p == phase]]
                assert (own == own[:, :1]).all()
        assert (recording.signal_state == GREEN).any()


def test_ego_drives_about_as_real_ones_do(scenes: list[tuple[Town, Recording]]) -> None:
    """nuScenes-mini: 5.6 m/s on average, a quarter of the time at rest. All cars drive alike."""
    speeds = np.concatenate(
        [r.ego_speed_mps for _, r in scenes]
        + [a.speed_mps for _, r in scenes for a in r.agents if a.kind == "car"]
    )
    assert 4.4 < speeds.mean() < 7.0
    assert 0.15 < (speeds < 0.3).mean() < 0.35


def test_the_view_does_not_end_before_the_ego(scenes: list[tuple[Town, Recording]]) -> None:
    for town, recording in scenes:
        assert recording.ego_xy_m.min() > 25.0
        assert recording.ego_xy_m.max() < town.size_m - 25.0


def test_looks_are_drawn_in_the_intended_shares() -> None:
    looks = [make_look(seed) for seed in range(2000)]
    share = {d: np.mean([look.daylight == d for look in looks]) for d in ("day", "dusk", "night")}
    assert share["night"] == pytest.approx(0.15, abs=0.03)
    assert share["dusk"] == pytest.approx(0.13, abs=0.03)
    assert np.mean([look.is_raining for look in looks]) == pytest.approx(0.18, abs=0.03)
    assert any(look.is_raining and look.daylight == "night" for look in looks)
    assert make_look(7) == make_look(7)


def test_the_description_says_night_and_rain_exactly_when_so(
    scenes: list[tuple[Town, Recording]],
) -> None:
    town, recording = scenes[0]
    for seed in range(60):
        look = make_look(seed)
        text = describe(town, recording, look)
        assert ("Night" in text) == (look.daylight == "night")
        assert ("Rain" in text) == look.is_raining
        assert text
