"""NC: who touched whom, and whose fault it was."""

import numpy as np
import pytest
from straight_road import FRONT_M, MIDDLE_M, at_speed, drive, moved_scene, other, road, together

from shoot.footprint import EGO_WIDTH_M
from shoot.metrics.driving_score import no_others
from shoot.metrics.driving_score.collisions import find_contacts, no_collision
from shoot.metrics.driving_score.surroundings import locate

T = 41
STEPS = np.arange(T)


def contacts(ego, others, around=None):
    """In two frames, which must not matter but for steps at which two just touch."""
    scene = (ego, others, around or road())
    here, there = (find_contacts(e, o, locate(e, a)) for e, o, a in (scene, moved_scene(scene)))
    assert [(c.other, c.cause, c.is_at_fault) for c in here] == [
        (c.other, c.cause, c.is_at_fault) for c in there
    ]
    return here


def only(ego, others, around=None):
    (contact,) = contacts(ego, others, around)
    return contact.cause, contact.is_at_fault


def test_nobody_there() -> None:
    assert contacts(at_speed(8.0), no_others(T)) == ()
    assert no_collision(()) == 1.0


def test_a_standing_car_is_hit_when_the_bumper_gets_there() -> None:
    ego = at_speed(5.0)  # the bumper is at 10 + 3.1 + t / 2
    (contact,) = contacts(ego, other(np.full(T, 22.05)))
    # Its rear bumper stands at 20.05.
    assert ego.xy_m[contact.step, 0] + FRONT_M > 20.05 > ego.xy_m[contact.step - 1, 0] + FRONT_M
    assert contact.time_s == pytest.approx(0.1 * contact.step)
    assert (contact.cause, contact.is_at_fault) == ("other stands", True)
    assert no_collision((contact,)) == 0.0


def test_touching_is_not_overlapping() -> None:
    ego = at_speed(5.0, y_m=-(EGO_WIDTH_M / 2))
    assert contacts(ego, other(np.full(T, 22.0), y_m=1.0 + 1e-6)) == ()
    assert len(contacts(ego, other(np.full(T, 22.0), y_m=1.0 - 1e-6))) == 1


@pytest.mark.parametrize(("kind", "score"), [("object", 0.5), ("pedestrian", 0.0), ("truck", 0.0)])
def test_things_cost_half(kind: str, score: float) -> None:
    assert no_collision(contacts(at_speed(5.0), other(np.full(T, 22.0), kind=kind))) == score


def test_an_agent_beside_a_thing_costs_all() -> None:
    both = together(other(np.full(T, 18.0), kind="object"), other(np.full(T, 24.0)))
    found = contacts(at_speed(5.0), both)
    assert [c.kind for c in found] == ["object", "car"]
    assert no_collision(found) == 0.0


def test_a_rear_end_by_the_other_is_not_at_fault() -> None:
    ego = at_speed(4.0, start_m=30.0)
    assert only(ego, other(20.0 + 0.9 * STEPS, speed_mps=9.0)) == ("from behind", False)


@pytest.mark.parametrize(("speed_mps", "cause"), [(0.05, "ego stands"), (0.06, "front")])
def test_who_stands_is_hit(speed_mps: float, cause: str) -> None:
    ego = drive(np.full(T, 30.0), speed_mps=speed_mps)
    head_on = other(60.0 - 1.0 * STEPS, yaw_rad=np.pi, speed_mps=10.0)
    assert only(ego, head_on) == (cause, cause == "front")


@pytest.mark.parametrize(("speed_mps", "cause"), [(0.05, "other stands"), (0.06, "from behind")])
def test_backing_into_one_that_stands(speed_mps: float, cause: str) -> None:
    ego = drive(30.0 - 0.2 * STEPS)
    assert only(ego, other(np.full(T, 24.0), speed_mps=speed_mps)) == (
        cause,
        cause != "from behind",
    )


def test_a_cut_in_that_is_run_into_is_at_fault_by_the_front() -> None:
    ego = at_speed(10.0)
    slower = other(24.0 + 0.4 * STEPS, np.maximum(4.0 - 0.2 * STEPS, 0.0), speed_mps=4.0)
    assert only(ego, slower) == ("front", True)


def test_a_cut_in_into_the_side_is_not() -> None:
    ego = at_speed(10.0)
    beside = other(
        10.0 + MIDDLE_M + 1.0 * STEPS, np.maximum(4.0 - 0.2 * STEPS, 1.0), speed_mps=10.0
    )
    assert only(ego, beside) == ("side", False)


@pytest.mark.parametrize(
    ("y_m", "is_at_fault"), [(1.0, False), (1.2, True), (-1.0, False), (-1.2, True)]
)
def test_a_side_hit_is_at_fault_in_two_lanes_or_off_the_road(y_m: float, is_at_fault: bool) -> None:
    """The lane ends 2 m to either side, and the car is 1.85 m wide: at 1.075 m it leaves it."""
    ego = at_speed(10.0, y_m=y_m)
    side = np.where(y_m > 0.0, 1.0, -1.0)
    beside = other(
        10.0 + MIDDLE_M + 1.0 * STEPS, y_m + side * np.maximum(4.0 - 0.2 * STEPS, 1.0), speed_mps=10
    )
    assert only(ego, beside) == ("side", is_at_fault)


@pytest.mark.parametrize(("angle_deg", "cause"), [(149.0, "side"), (151.0, "from behind")])
def test_behind_begins_at_150_degrees(angle_deg: float, cause: str) -> None:
    """Seen from the rear axle: someone who steps against the car's rear."""
    ego = at_speed(1.0, num_steps=5)
    away_m = 1.05 * np.array([np.cos(np.deg2rad(angle_deg)), np.sin(np.deg2rad(angle_deg))])
    x_m, y_m = ego.xy_m[2] + away_m
    walker = other(
        np.full(5, x_m), np.where(np.arange(5) < 2, 5.0, y_m), 0.0, 1.0, "pedestrian", (0.4, 0.4)
    )
    assert only(ego, walker) == (cause, False)


def test_what_touches_at_the_start_is_never_looked_at() -> None:
    assert only(at_speed(5.0), other(np.full(T, 13.0))) == ("before the start", False)


def test_the_first_contact_decides() -> None:
    """Hit from behind, then run into: still the other's."""
    ego = at_speed(4.0, start_m=30.0)
    x_m = np.where(STEPS < 30, 24.0 + 0.9 * STEPS, 46.0)
    assert only(ego, other(x_m, speed_mps=9.0)) == ("from behind", False)


def test_who_is_not_present_is_not_hit() -> None:
    standing = other(np.full(T, 22.0))
    standing.is_present[:] = False
    assert contacts(at_speed(5.0), standing) == ()


def test_contacts_come_in_the_order_of_time() -> None:
    found = contacts(at_speed(5.0), together(other(np.full(T, 26.0)), other(np.full(T, 20.0))))
    assert [c.other for c in found] == [1, 0]
