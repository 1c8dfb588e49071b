"""HC and EC: bounds from both sides, on drives whose derivatives are known."""

from dataclasses import replace

import numpy as np
import pytest
from straight_road import MIDDLE_M, drive

from shoot.metrics.driving_score import track_of_plan
from shoot.metrics.driving_score.smoothness import (
    extended_comfort,
    feel,
    history_comfort,
    plans_agree,
)
from shoot.metrics.driving_score.tracks import Track

T = 56
TIME_S = 0.1 * np.arange(T)


def straight(accel_mps2=0.0, jerk_mps3=0.0, start_mps=20.0, time_s=TIME_S):
    """Speeding up at an acceleration that itself changes."""
    speed_mps = start_mps + accel_mps2 * time_s + jerk_mps3 * time_s**2 / 2
    return drive(np.cumsum(speed_mps) * 0.1, speed_mps=speed_mps)


def turning(rate_radps=0.0, accel_radps2=0.0, speed_mps=1.0, time_s=TIME_S):
    """On the spot of the rear axle, as far as its positions go: they are not looked at."""
    yaw_rad = rate_radps * time_s + accel_radps2 * time_s**2 / 2
    return drive(np.zeros(len(time_s)), yaw_rad=yaw_rad, speed_mps=speed_mps)


def hc(track):
    return history_comfort(feel(track))


@pytest.mark.parametrize(
    ("accel_mps2", "score"), [(2.39, 1.0), (2.41, 0.0), (-4.04, 1.0), (-4.06, 0.0)]
)
def test_braking_and_speeding_up_have_bounds_of_their_own(accel_mps2, score) -> None:
    track = straight(accel_mps2, start_mps=30.0)
    assert feel(track).lon_accel_mps2 == pytest.approx(accel_mps2)
    assert hc(track) == score


@pytest.mark.parametrize(("lat_mps2", "score"), [(4.88, 1.0), (4.90, 0.0), (-4.90, 0.0)])
def test_a_circle_at_constant_speed(lat_mps2: float, score: float) -> None:
    track = turning(0.5 * np.sign(lat_mps2), speed_mps=abs(lat_mps2) / 0.5)
    felt = feel(track)
    assert felt.lat_accel_mps2 == pytest.approx(lat_mps2)
    # The middle goes round the axle, too: it is pulled back.
    assert felt.lon_accel_mps2 == pytest.approx(-(0.5**2) * MIDDLE_M)
    assert hc(track) == score


@pytest.mark.parametrize(("rate_radps", "score"), [(0.94, 1.0), (0.96, 0.0), (-0.96, 0.0)])
def test_yaw_rate(rate_radps: float, score: float) -> None:
    track = turning(rate_radps)
    assert feel(track).yaw_rate_radps == pytest.approx(rate_radps)
    assert hc(track) == score


@pytest.mark.parametrize(("accel_radps2", "score"), [(1.92, 1.0), (1.94, 0.0), (-1.94, 0.0)])
def test_yaw_acceleration(accel_radps2: float, score: float) -> None:
    track = turning(-accel_radps2 * 0.4, accel_radps2, time_s=TIME_S[:9])
    assert feel(track).yaw_accel_radps2 == pytest.approx(accel_radps2)
    assert hc(track) == score


def test_jerk_of_a_ramp() -> None:
    """In the middle; at the ends windows of even length stand half a step aside."""
    felt = feel(straight(-5.0, 4.0))
    assert felt.lon_jerk_mps3[15:-15] == pytest.approx(4.0)
    # The amount falls to 0 and rises again.
    assert feel(straight(-6.0, 1.0, 40.0)).jerk_mps3[15:-15] == pytest.approx(-1.0)


@pytest.mark.parametrize(
    ("name", "low", "high"),
    [
        ("lon_accel_mps2", -4.05, 2.40),
        ("lat_accel_mps2", -4.89, 4.89),
        ("jerk_mps3", -8.37, 8.37),
        ("lon_jerk_mps3", -4.13, 4.13),
        ("yaw_rate_radps", -0.95, 0.95),
        ("yaw_accel_radps2", -1.93, 1.93),
    ],
)
def test_one_step_out_of_one_bound_is_enough(name: str, low: float, high: float) -> None:
    calm = feel(straight())
    for value, score in (
        (low - 0.01, 0.0),
        (low + 0.01, 1.0),
        (high - 0.01, 1.0),
        (high + 0.01, 0.0),
    ):
        once = np.zeros(T)
        once[40] = value
        assert history_comfort(replace(calm, **{name: once})) == score


def test_jerk_of_the_amount_is_bounded_by_itself() -> None:
    """Lateral acceleration that comes and goes: the longitudinal one does not change."""
    rate_radps = 0.15 * np.sin(2.0 * TIME_S)
    yaw_rad = np.cumsum(rate_radps) * 0.1
    calm, rough = (drive(np.zeros(T), yaw_rad=yaw_rad, speed_mps=v) for v in (20.0, 32.0))
    assert np.abs(feel(calm).jerk_mps3).max() < 8.37 < np.abs(feel(rough).jerk_mps3).max()
    assert np.abs(feel(rough).lat_accel_mps2).max() < 4.89
    assert np.abs(feel(rough).lon_jerk_mps3).max() < 1.0
    assert (hc(calm), hc(rough)) == (1.0, 0.0)


def test_yaw_may_pass_half_a_turn() -> None:
    track = turning(0.5)
    wrapped = Track(track.xy_m, (track.yaw_rad + 3.0) % (2 * np.pi) - np.pi, track.speed_mps)
    assert feel(wrapped).yaw_rate_radps == pytest.approx(feel(track).yaw_rate_radps)


def test_history_joins_on_without_a_seam_and_a_jump_at_the_seam_is_felt() -> None:
    whole = straight(1.0)
    past, ego = whole.part(0, 15), whole.part(15)
    joined = feel(ego.after(past))
    np.testing.assert_array_equal(joined.jerk_mps3, feel(whole).jerk_mps3)
    faster = Track(past.xy_m, past.yaw_rad, past.speed_mps - 2.0)
    assert (hc(ego), hc(ego.after(past)), hc(ego.after(faster))) == (1.0, 1.0, 0.0)
    with pytest.raises(ValueError, match="History has steps"):
        ego.after(Track(past.xy_m, past.yaw_rad, past.speed_mps, 0.5))


def test_three_steps_are_too_few() -> None:
    with pytest.raises(ValueError, match="4 steps or more"):
        feel(straight(time_s=TIME_S[:3]))
    assert hc(straight(time_s=TIME_S[:4])) == 1.0


@pytest.mark.parametrize(("apart_mps2", "score"), [(0.69, 1.0), (0.71, 0.0)])
def test_plans_that_speed_up_otherwise(apart_mps2: float, score: float) -> None:
    assert plans_agree(straight(0.5), straight(0.5 + apart_mps2)) == score


@pytest.mark.parametrize(("apart_radps", "score"), [(0.099, 1.0), (0.101, 0.0)])
def test_plans_that_turn_otherwise(apart_radps: float, score: float) -> None:
    assert plans_agree(turning(-0.3), turning(-0.3 + apart_radps)) == score


@pytest.mark.parametrize(("apart_radps2", "score"), [(0.099, 1.0), (0.101, 0.0)])
def test_plans_whose_turning_changes_otherwise(apart_radps2: float, score: float) -> None:
    """Over a short time, so that the rates themselves stay together: 0.5 s, in the middle equal."""
    time_s = TIME_S[:11]
    one, two = (
        turning(0.0, 0.0, time_s=time_s),
        turning(-apart_radps2 / 4, apart_radps2, time_s=time_s),
    )
    assert plans_agree(one, two) == score


@pytest.mark.parametrize(("apart_mps3", "score"), [(0.49, 1.0), (0.51, 0.0)])
def test_plans_whose_jerk_differs(apart_mps3: float, score: float) -> None:
    # At 1 m/s2 in the middle, so that amounts are never turned round.
    time_s = TIME_S[:26]
    one = straight(1.0, time_s=time_s)
    two = straight(1.0 - apart_mps3 * 1.0, apart_mps3, time_s=time_s)
    assert plans_agree(one, two) == score


def test_only_where_both_plan_is_compared() -> None:
    """The later plan goes on where the earlier one was cut off."""
    speed_mps = 10.0 + np.sin(np.arange(60) / 6.0)
    one, two = (drive(np.zeros(46), speed_mps=speed_mps[at : at + 46]) for at in (0, 5))
    assert plans_agree(one, two) == 1.0
    assert plans_agree(two, one) == 0.0


def test_share_of_plans_that_agree() -> None:
    calm, wild = straight(0.0), straight(2.0)
    assert extended_comfort([calm, calm, wild, wild, calm]) == 0.5
    assert extended_comfort([calm]) is None
    with pytest.raises(ValueError, match="same steps"):
        plans_agree(calm, straight(time_s=TIME_S[:20]))


def test_a_plan_of_points_is_a_track_from_where_it_was_made() -> None:
    """A circle of 20 m at 8 m/s, to the left."""
    angle_rad = 0.4 * 0.25 * np.arange(1, 21)
    points_m = 20.0 * np.stack([np.sin(angle_rad), 1.0 - np.cos(angle_rad)], axis=-1)
    track = track_of_plan(points_m, 0.25)
    assert (len(track), track.dt_s) == (21, 0.25)
    assert track.xy_m[0].tolist() == [0.0, 0.0]
    assert track.yaw_rad[:-1] == pytest.approx(np.concatenate([[0.0], angle_rad[:-1]]))
    assert track.speed_mps[1:-1] == pytest.approx(8.0, rel=0.01)
