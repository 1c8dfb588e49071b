import math

import numpy as np
import pytest

from shoot.metrics.manoeuvres import classify_manoeuvres, heading_changes

TIME_S = 0.25 * np.arange(1, 21)


def _arc(speed_mps, yaw_rate_radps):
    """Driving a circle from the origin, heading along x."""
    radius_m = speed_mps / yaw_rate_radps
    turn_rad = yaw_rate_radps * TIME_S
    return np.stack([radius_m * np.sin(turn_rad), radius_m * (1 - np.cos(turn_rad))], axis=-1)


def _line(speed_mps):
    return np.stack([speed_mps * TIME_S, np.zeros(20)], axis=-1)


def _name(path):
    return str(classify_manoeuvres(path[None])[0])


@pytest.mark.parametrize(
    ("path", "name"),
    [
        (np.zeros((20, 2)), "standing"),
        (_line(0.19), "standing"),  # 0.95 m
        (_line(0.20), "straight"),  # 1.00 m
        (_line(12.0), "straight"),
        (_line(-1.0), "straight"),  # backwards
        (_arc(8.0, 0.3), "left"),
        (_arc(8.0, -0.3), "right"),
        (_arc(8.0, math.radians(3.0)), "straight"),  # 15 degrees
        (_arc(8.0, math.radians(5.0)), "left"),  # 25 degrees
        (_arc(6.0, math.radians(50.0)), "left"),  # U-turn, 250 degrees: stays a left turn
    ],
)
def test_by_hand(path, name):
    assert _name(path) == name


def test_lane_change_is_straight():
    shift_m = 1.75 * (1 - np.cos(np.pi * TIME_S / 5.0))  # 3.5 m to the left within 50 m
    assert _name(np.stack([10.0 * TIME_S, shift_m], axis=-1)) == "straight"


def test_heading_change_is_that_of_the_arc():
    paths = np.stack([_arc(8.0, rate) for rate in (-0.6, -0.2, 0.1, 0.4)])
    change_rad, is_moving = heading_changes(paths)
    assert is_moving.all()
    # The last chord's direction is that of its middle, half a time step before the end.
    np.testing.assert_allclose(change_rad, np.array([-0.6, -0.2, 0.1, 0.4]) * 4.875, atol=1e-9)


def test_mirrored_paths_turn_the_other_way():
    generator = np.random.default_rng(0)
    paths = np.stack(
        [_arc(speed, rate) for speed, rate in generator.uniform((0.0, -0.5), (12.0, 0.5), (50, 2))]
    )
    swap = {"left": "right", "right": "left"}
    expected = [swap.get(name, name) for name in classify_manoeuvres(paths).tolist()]
    assert classify_manoeuvres(paths * [1.0, -1.0]).tolist() == expected
    assert {"left", "right"} <= set(expected)


def test_noise_of_centimetres_does_not_turn_a_standing_or_creeping_car():
    generator = np.random.default_rng(1)
    noise_m = generator.normal(0.0, 0.03, (200, 20, 2))
    assert set(classify_manoeuvres(noise_m)) == {"standing"}
    assert set(classify_manoeuvres(_line(0.5) + noise_m)) == {"straight"}


def test_one_by_one_equals_all_at_once_and_none_is_fine():
    paths = np.stack([_arc(5.0, 0.3), _line(3.0), np.zeros((20, 2)), _arc(5.0, -0.3)])
    assert classify_manoeuvres(paths).tolist() == [_name(path) for path in paths]
    assert classify_manoeuvres(np.zeros((0, 20, 2))).tolist() == []
