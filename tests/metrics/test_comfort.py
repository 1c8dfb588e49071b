import numpy as np
import pytest

from shoot.metrics.comfort import measure_comfort

TIME_S = 0.25 * np.arange(1, 21)
NAMES = ("lon_accel_mps2", "lat_accel_mps2", "jerk_mps3", "comfort")


def _comfort(*paths, dt_s=0.25):
    found = measure_comfort(np.stack(paths), dt_s)
    assert tuple(found) == NAMES
    return [tuple(float(found[name][row]) for name in NAMES) for row in range(len(paths))]


def _along(distance_m, angle_rad=0.0):
    return distance_m[:, None] * [np.cos(angle_rad), np.sin(angle_rad)]


def _circle(radius_m, speed_mps, time_s=TIME_S):
    angle = speed_mps * time_s / radius_m
    return radius_m * np.stack([np.sin(angle), 1.0 - np.cos(angle)], axis=-1)


@pytest.mark.parametrize("angle_rad", [0.0, 0.7, -2.0])
def test_constant_acceleration_in_any_direction(angle_rad):
    path = _along(3.0 * TIME_S + 0.5 * 2.0 * TIME_S**2, angle_rad)
    assert _comfort(path)[0] == pytest.approx((2.0, 0.0, 0.0, 100.0), abs=1e-9)


def test_braking_and_speeding_up_have_bounds_of_their_own():
    def at(accel_mps2):
        return _along(25.0 * TIME_S + 0.5 * accel_mps2 * TIME_S**2)

    found = _comfort(at(-3.0), at(3.0), at(-4.1), at(2.3))
    assert [row[0] for row in found] == pytest.approx([3.0, 3.0, 4.1, 2.3])
    assert [row[3] for row in found] == [100.0, 0.0, 0.0, 100.0]


def test_a_circle_at_constant_speed_by_hand():
    """Chords of 2 r sin(w/2), w = v dt / r, turn by w at each point."""
    turn = 8.0 * 0.25 / 20.0
    lat = 4.0 * 20.0 * np.sin(turn / 2) ** 2 / 0.25**2
    jerk = 8.0 * 20.0 * np.sin(turn / 2) ** 3 / 0.25**3
    left, right = _circle(20.0, 8.0), _circle(20.0, 8.0) * [1.0, -1.0]
    for found in _comfort(left, right):
        assert found == pytest.approx((0.0, lat, jerk, 100.0), abs=1e-9)
    # And close to what a continuous circle has.
    assert (lat, jerk) == pytest.approx((8.0**2 / 20.0, 8.0**3 / 20.0**2), rel=2e-3)


def test_a_sharp_circle_is_too_much_aside():
    (found,) = _comfort(_circle(12.0, 8.0))
    assert found[1] > 4.89
    assert found[0] == pytest.approx(0.0, abs=1e-9)
    assert found[3] == 0.0


def test_jerk_of_a_cubic():
    bearable, too_much = (_along(10.0 * TIME_S + jerk * TIME_S**3 / 6.0) for jerk in (0.4, 9.0))
    found = _comfort(bearable, too_much)
    assert [row[2] for row in found] == pytest.approx([0.4, 9.0])
    assert [row[3] for row in found] == [100.0, 0.0]


def test_standing_still_gives_zeros():
    assert _comfort(np.zeros((20, 2)))[0] == (0.0, 0.0, 0.0, 100.0)


def test_stopping_is_all_ahead():
    stop = _along(np.minimum(0.5 * np.arange(1, 21), 2.0), 0.4)  # 2 m/s for 1 s, then 0
    assert _comfort(stop)[0][:3] == pytest.approx((8.0, 0.0, 32.0), abs=1e-9)


def test_driving_backwards_is_driving():
    path = 3.0 * TIME_S + 0.5 * TIME_S**2
    assert _comfort(_along(-path))[0] == pytest.approx(_comfort(_along(path))[0], abs=1e-9)


def test_turning_on_its_heel_is_braking():
    there_and_back = _along(np.array([1.0, 2.0, 1.0, 0.0]), 1.1)
    found = _comfort(there_and_back)[0]
    assert found[:2] == pytest.approx((8.0 / 0.25, 0.0), abs=1e-9)
    assert found[3] == 0.0


def test_the_first_step_starts_at_the_origin():
    """From rest at the origin the first point is half the second's distance from it."""
    late = _along(np.array([0.0, 0.0, 0.0, 0.1, 0.2]))
    early = _along(np.array([0.1, 0.2, 0.3, 0.4, 0.5]))
    assert [row[0] for row in _comfort(late, early)] == pytest.approx([1.6, 0.0], abs=1e-9)


def test_a_path_by_itself_equals_one_among_many():
    paths = np.random.default_rng(0).normal(size=(6, 20, 2)).cumsum(axis=1)
    assert _comfort(*paths) == [_comfort(path)[0] for path in paths]


def test_a_shorter_step_is_a_harder_ride():
    path = _circle(20.0, 4.0)
    (slow,), (fast,) = _comfort(path), _comfort(path, dt_s=0.125)
    assert (fast[1] / slow[1], fast[2] / slow[2]) == pytest.approx((4.0, 8.0))


def test_two_points_have_no_jerk_and_thus_nothing():
    assert np.isnan(list(measure_comfort(np.ones((3, 2, 2))).values())).all()
