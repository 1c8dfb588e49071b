"""The rule driver stops a little before the rules would, and else does what they would."""

import numpy as np
import pytest

from shoot.simulation.drivers.simple import STOP_SHORT_M, stop_short


def straight(way_m: np.ndarray) -> np.ndarray:
    return np.stack([0.6 * way_m, 0.8 * way_m], axis=1)


def test_a_stop_is_made_short_and_what_follows_it_too() -> None:
    """Brakes from 4 m/s to rest within 4 m, stands for 1 s, sets off again."""
    times_s = 0.1 * np.arange(51)
    braked_s, gone_s = np.minimum(times_s, 2.0), np.maximum(times_s - 3.0, 0.0)
    way_m = 4.0 * braked_s - braked_s**2 + gone_s**2
    speed_mps = 4.0 - 2.0 * braked_s + 2.0 * gone_s
    path_m = stop_short(straight(way_m), speed_mps[1:])
    made_m = path_m @ [0.6, 0.8]
    assert made_m[25] == pytest.approx(4.0 - STOP_SHORT_M)
    assert made_m[50] == pytest.approx(8.0 - STOP_SHORT_M)
    assert made_m[10] == pytest.approx(3.0 * (1.0 - STOP_SHORT_M / 4.0))
    np.testing.assert_allclose(path_m, straight(made_m), atol=1e-9)


def test_who_does_not_stop_or_has_stopped_is_left_alone() -> None:
    moving = straight(0.5 * np.arange(51))
    np.testing.assert_array_equal(stop_short(moving, np.full(50, 5.0)), moving)
    standing = np.zeros((51, 2))
    np.testing.assert_array_equal(stop_short(standing, np.zeros(50)), standing)


def test_the_last_centimetres_are_not_driven() -> None:
    way_m = np.minimum(0.02 * np.arange(51), 0.2)
    speed_mps = np.where(np.arange(1, 51) < 10, 0.2, 0.0)
    assert np.abs(stop_short(straight(way_m), speed_mps)).max() < 1e-9
