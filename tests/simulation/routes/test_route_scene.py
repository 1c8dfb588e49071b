"""A driven route as scores see it: what counts as driving well, and what as each mistake."""

from dataclasses import replace

import numpy as np
import pytest
from world_fixture import result_beside

from shoot.metrics.driving_score.facts import collect_facts
from shoot.metrics.driving_score.score import DrivingScore, epdms
from shoot.metrics.driving_score.surroundings import Surroundings
from shoot.simulation.drivers.driver import drive
from shoot.simulation.drivers.simple import ConstantVelocityDriver
from shoot.simulation.route_log import RouteLog
from shoot.simulation.routes.orders import RouteOrder, route_orders
from shoot.simulation.routes.pictures import mishaps_of
from shoot.simulation.routes.result import result_of, score_rules
from shoot.simulation.routes.scene import FIRST_STEP, RouteScene, scene_of
from shoot.simulation.senses import SensorSettings
from shoot.simulation.simulator import Simulator
from shoot.simulation.vehicle import PHYSICS_S
from shoot.world.nuscenes.tiling import seed_of
from shoot.world.town.roads import make_town
from shoot.world.town.town import Town
from shoot.world.traffic.recording import RED

# The car waits at a light until the hand-over, then turns left behind it.
TOWN, SEED, DURATION_S = 5, 8, 9.0


def driven() -> tuple[RouteLog, RouteLog]:
    """The same route by the rules and straight on."""
    town = make_town(TOWN)
    by_rules = Simulator(town, SEED, "replay", duration_s=DURATION_S)
    by_rules.reset()
    straight = drive(
        ConstantVelocityDriver(), town, SEED, "replay", SensorSettings(), DURATION_S
    )  # fmt: skip
    return by_rules.finish_by_rules(), straight


@pytest.fixture(scope="module")
def town() -> Town:
    return make_town(TOWN)


@pytest.fixture(scope="module")
def logs() -> tuple[RouteLog, RouteLog]:
    found: tuple[RouteLog, RouteLog] = result_beside(driven)
    return found


@pytest.fixture(scope="module")
def ruled(logs: tuple[RouteLog, RouteLog]) -> RouteLog:
    return logs[0]


def score(scene: RouteScene, around: Surroundings | None = None) -> DrivingScore:
    return epdms(
        scene.ego,
        scene.others,
        around or scene.ground.lawful,
        reference_progress_m=30.0,
        history=scene.history,
        plans=scene.plans,
    )


def test_who_drives_by_the_rules_breaks_none(ruled: RouteLog, town: Town) -> None:
    scene = scene_of(ruled, town)
    found = score(scene)
    assert (found.nc, found.dac, found.ddc, found.tlc, found.lk) == (1.0,) * 5
    assert score(scene, scene.ground.strict).ddc == 1.0
    assert scene.ground.off_route_m(scene.ego) == 0.0
    way_m = np.hypot(*np.diff(ruled.ego.xy_m[FIRST_STEP:], axis=0).T).sum()
    assert found.progress_m == pytest.approx(way_m, abs=1.5)  # the middle swings out in a turn
    assert score_rules(ruled, town) == pytest.approx(found.progress_m)


def test_the_scene_begins_at_the_hand_over_and_keeps_what_came_before(
    ruled: RouteLog, town: Town
) -> None:
    scene = scene_of(ruled, town)
    assert len(scene.ego) == round((DURATION_S - 2.0) / PHYSICS_S) + 1
    assert len(scene.history) == 15
    together = np.concatenate([scene.history.xy_m, scene.ego.xy_m])
    np.testing.assert_array_equal(together, ruled.ego.xy_m[5:])
    num = len(ruled.cast.kinds)
    np.testing.assert_array_equal(scene.others.centre_m[:num], ruled.agents.xy_m[:, FIRST_STEP:])
    assert not scene.others.speed_mps[num:].any()
    assert {"building", "tree", "traffic light"} <= set(scene.names[num:])
    with pytest.raises(ValueError, match="of town 5"):
        scene_of(ruled, replace(town, seed=6))


def test_a_parked_car_in_the_way_is_hit_at_fault(ruled: RouteLog, town: Town) -> None:
    there = replace(town.parked_cars[0], xy_m=ruled.ego.xy_m[60], yaw_rad=0.0)
    facts = collect_facts(*_seen(scene_of(ruled, replace(town, parked_cars=(there,)))))
    (contact,) = facts.contacts
    assert (contact.kind, contact.cause, contact.is_at_fault) == ("car", "other stands", True)


def test_a_red_light_of_the_route_counts_also_for_who_turns_off_it(
    ruled: RouteLog, town: Town
) -> None:
    red = replace(ruled, signal_state=np.full_like(ruled.signal_state, RED))
    assert score(scene_of(red, town)).tlc == 0.0
    # Its route goes straight on here: another path behind the same light.
    lane = town.lanes[ruled.route_lanes[0]]
    others = [i for i in lane.successors if i != ruled.route_lanes[1]]
    elsewhere = (lane.lane_id, others[0], town.lanes[others[0]].successors[0])
    assert score(scene_of(replace(red, route_lanes=elsewhere), town)).tlc == 0.0
    amber = replace(ruled, signal_state=np.full_like(ruled.signal_state, RED + 1))
    assert score(scene_of(amber, town)).tlc == 1.0


def test_leaving_the_route_is_no_driving_against_traffic_unless_strict(
    ruled: RouteLog, town: Town
) -> None:
    lane = town.lanes[ruled.route_lanes[0]]
    others = [i for i in lane.successors if i != ruled.route_lanes[1]]
    elsewhere = (lane.lane_id, others[0], town.lanes[others[0]].successors[0])
    scene = scene_of(replace(ruled, route_lanes=elsewhere), town)
    assert score(scene).ddc == 1.0
    assert score(scene, scene.ground.strict).ddc < 1.0
    assert scene.ground.off_route_m(scene.ego) > 3.0


def test_driving_a_lane_from_its_end_is_against_traffic(ruled: RouteLog, town: Town) -> None:
    """The film run backward: from the road behind the turn to the light."""
    ego = ruled.ego
    back = replace(ego, xy_m=ego.xy_m[::-1], yaw_rad=ego.yaw_rad[::-1] + np.pi)
    assert score(scene_of(replace(ruled, ego=back), town)).ddc < 1.0


def test_a_plan_that_is_followed_is_the_way_that_was_driven(
    logs: tuple[RouteLog, RouteLog], town: Town
) -> None:
    straight = logs[1]
    scene = scene_of(straight, town)
    assert len(scene.plans) == len(straight.plans) == 14
    for k, plan in enumerate(scene.plans):
        first = FIRST_STEP + 5 * k
        assert len(plan) == 41
        np.testing.assert_allclose(plan.xy_m[:6], straight.ego.xy_m[first : first + 6], atol=1e-9)
    assert score(scene).ec is not None


def test_a_result_says_what_happened(logs: tuple[RouteLog, RouteLog], town: Town) -> None:
    order = RouteOrder(3, 1, TOWN, SEED)
    reference_m = score_rules(logs[0], town)
    scene = scene_of(logs[1], town)
    row = result_of(order, logs[1], scene, mishaps_of(scene), reference_m)
    expected = epdms(
        *_seen(scene), reference_progress_m=reference_m, history=scene.history, plans=scene.plans
    )
    assert row["scores"]["driving_score"] == expected.total
    assert row["scores"]["ep"] == expected.ep
    assert row["facts"]["progress_m"] == pytest.approx(expected.progress_m, abs=1e-3)
    assert (row["route"], row["town"], row["mode"], row["error"]) == (3, 1, "replay", None)
    assert len(row["ego"]["xy_m"]) == round(DURATION_S / PHYSICS_S) + 1
    of_rules = result_of(order, logs[0], scene_of(logs[0], town), (), reference_m)
    assert of_rules["scores"]["ep"] == 1.0
    assert of_rules["bench2drive"] == {"score": 1.0, "success": 1.0}
    assert of_rules["scores"]["ec"] is None  # it was told no plans


def test_routes_are_in_towns_of_their_own_and_more_begin_with_the_same() -> None:
    few, many = list(route_orders(5, 7)), list(route_orders(9, 7))
    assert many[:5] == few
    assert [order.town for order in few] == [0, 0, 1, 1, 2]
    assert len({order.town_seed for order in many}) == 5
    assert len({order.seed for order in many}) == 9
    of_data_sets = {
        seed_of(7, split, "town", i) for split in ("train", "val") for i in range(200)
    }  # fmt: skip
    assert of_data_sets.isdisjoint(order.town_seed for order in many)
    assert next(route_orders(1, 8)).town_seed != few[0].town_seed


def _seen(scene: RouteScene) -> tuple:  # type: ignore[type-arg]
    return scene.ego, scene.others, scene.ground.lawful
