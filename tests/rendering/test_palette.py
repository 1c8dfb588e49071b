import itertools

import numpy as np
import pytest
from matplotlib.colors import to_rgb

from shoot.rendering import palette

# Machado, Oliveira and Fernandes 2009, full severity, on linear RGB.
DEFICIENCIES = {
    "none": np.eye(3),
    "protanopia": np.array(
        [
            [0.152286, 1.052583, -0.204868],
            [0.114503, 0.786281, 0.099216],
            [-0.003882, -0.048116, 1.051998],
        ]
    ),
    "deuteranopia": np.array(
        [
            [0.367322, 0.860646, -0.227968],
            [0.280085, 0.672501, 0.047413],
            [-0.011820, 0.042940, 0.968881],
        ]
    ),
    "grey": np.tile([0.2126, 0.7152, 0.0722], (3, 1)),
}


def lab(colour: object, deficiency: str) -> np.ndarray:
    srgb = np.array(to_rgb(colour))  # type: ignore[arg-type]
    linear = np.where(srgb <= 0.04045, srgb / 12.92, ((srgb + 0.055) / 1.055) ** 2.4)
    linear = np.clip(DEFICIENCIES[deficiency] @ linear, 0.0, 1.0)
    xyz_from_rgb = np.array(
        [[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]]
    )
    xyz = xyz_from_rgb @ linear / np.array([0.9505, 1.0, 1.089])
    f = np.where(xyz > 0.008856, np.cbrt(xyz), 7.787 * xyz + 16.0 / 116.0)
    return np.array([116.0 * f[1] - 16.0, 500.0 * (f[0] - f[1]), 200.0 * (f[1] - f[2])])


def test_the_simulation_confuses_what_colour_blind_people_confuse() -> None:
    red, green = "#d55e5e", "#7e8a00"
    plain = np.linalg.norm(lab(red, "none") - lab(green, "none"))
    assert np.linalg.norm(lab(red, "deuteranopia") - lab(green, "deuteranopia")) < 0.5 * plain


@pytest.mark.parametrize("deficiency", ["none", "protanopia", "deuteranopia"])
def test_kinds_of_things_differ_for_colour_blind_people(deficiency: str) -> None:
    kinds = [palette.PLANNED, palette.DRIVEN, palette.EGO, palette.PAPER]
    for one, other in itertools.combinations(kinds, 2):
        assert np.linalg.norm(lab(one, deficiency) - lab(other, deficiency)) > 25.0
    for strength in (0.0, 0.3, 0.6, 1.0):  # every shade of planned against driven
        gap = lab(palette.PROBABILITY(strength), deficiency) - lab(palette.DRIVEN, deficiency)
        assert np.linalg.norm(gap) > 25.0


@pytest.mark.parametrize("ramp", [palette.COST, palette.PROBABILITY, palette.COUNT, palette.DEPTH])
@pytest.mark.parametrize("deficiency", list(DEFICIENCIES))
def test_ramps_change_lightness_one_way(ramp: object, deficiency: str) -> None:
    lightness = [lab(ramp(value), deficiency)[0] for value in np.linspace(0, 1, 9)]  # type: ignore[operator]
    steps = np.diff(lightness)
    assert (steps > 1.0).all() or (steps < -1.0).all()


@pytest.mark.parametrize("deficiency", ["none", "protanopia", "deuteranopia"])
def test_classes_of_a_map_differ_for_colour_blind_people(deficiency: str) -> None:
    for one, other in itertools.combinations([*palette.CLASSES.values(), palette.PAPER], 2):
        assert np.linalg.norm(lab(one, deficiency) - lab(other, deficiency)) > 25.0
