"""The ground of a hand-made street, with its paint and shadows."""

from dataclasses import replace

import numpy as np
import pytest
from street_scene import DAY, street

from shoot.world.looks.ground import light_ground
from shoot.world.looks.light import light_of
from shoot.world.looks.paint import crosswalk_stripes, paint_unlit
from shoot.world.town.town import Prop, RoadLine
from shoot.world.traffic.recording import Look


def test_crosswalk_stripes_by_hand():
    outline = np.array([[0.0, -2.0], [6.0, -2.0], [6.0, 2.0], [0.0, 2.0]])
    stripes = crosswalk_stripes(outline, np.array([[0.0, 0.0], [6.0, 0.0]]), 0.6, 0.6)
    # 5 bars of 0.6 m with 4 gaps fill 5.4 of 6 m: the first begins at 0.3.
    assert len(stripes) == 5
    assert stripes[0][:, 0].min() == pytest.approx(0.3)
    assert stripes[-1][:, 0].max() == pytest.approx(5.7)
    assert stripes[2][:, 1].tolist() == pytest.approx([-2, -2, 2, 2])


def test_ground_shows_paint_near_and_its_mean_far():
    town = replace(street(), lines=(RoadLine(np.array([[0.0, 50.0], [150.0, 50.0]]), "stop"),))
    light = light_of(DAY)
    ground = light_ground(paint_unlit(town, 0.1), town, light)
    down = np.array([[0.0], [0.0], [-1.0]], np.float32)

    def at(x_m: float, y_m: float, size_m: float) -> float:
        place = np.array([[x_m], [y_m]], np.float32)
        return float(ground.colours(place, down, np.array([size_m], np.float32)).mean())

    line, road, grass = at(70, 50, 0.05), at(70, 48, 0.05), at(70, 30, 0.05)
    assert line > 3 * road
    assert grass != pytest.approx(road, rel=0.05)
    # 0.55 m of white in a footprint of 3.2 m.
    share = (np.sqrt(at(70, 50, 3.2)) - np.sqrt(road)) / (np.sqrt(line) - np.sqrt(road))
    assert 0.05 < share < 0.35


def test_shadows_lie_away_from_the_sun():
    tree = Prop("tree", np.array([75.0, 50.0]), 8.0, 2.0)
    look = Look("day", False, 0.0)  # the sun stands in the east
    towns = [replace(street(), props=props) for props in ((), (tree,))]
    bare, shaded = (light_ground(paint_unlit(t, 0.2), t, light_of(look)) for t in towns)
    changed = np.flatnonzero(bare.texels[: bare.starts[1]] != shaded.texels[: bare.starts[1]])
    x_m = (changed % bare.widths[0]) * 0.2 + bare.origin_m[0]
    assert len(changed) > 50
    assert x_m.max() < 75.0
