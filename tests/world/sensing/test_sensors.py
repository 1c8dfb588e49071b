"""Cameras of a hand-made street: what is where in the picture, and on what pictures depend."""

from dataclasses import replace

import numpy as np
import pytest
import shapely
from street_scene import (
    DAY,
    NIGHT,
    WHITE_PAINT,
    box_pixels,
    camera,
    car,
    recording,
    sensors,
    shot,
    street,
)

from shoot.world.looks.paint import paint_unlit
from shoot.world.sensing.rig import make_rig
from shoot.world.sensing.sensors import CitySensors
from shoot.world.town.town import Building
from shoot.world.traffic.recording import GREEN, RED, Look


def redness(picture: np.ndarray) -> np.ndarray:
    """How much redder than anything else each pixel is."""
    values = picture.astype(int)
    return values[..., 0] - np.maximum(values[..., 1], values[..., 2])


@pytest.mark.parametrize(("xy_m", "yaw_rad"), [((58.0, 51.5), 0.4), ((66.0, 47.0), 2.0)])
def test_a_red_car_covers_the_pixels_of_its_projected_box(xy_m, yaw_rad):
    agent = car(xy_m, yaw_rad)
    city = sensors(street(), recording(agent))
    view = camera(city)
    corners = box_pixels(view, np.array([40.0, 50.0]), agent)
    rows, columns = np.nonzero(redness(shot(city)) > 40)
    assert len(rows) > 100
    hull = shapely.MultiPoint(corners).convex_hull
    inside = shapely.contains_xy(hull.buffer(1.5), columns, rows)
    assert inside.mean() > 0.99
    # Paint reaches the box's sides; wheels below and panes above are not red.
    low, high = corners.min(axis=0), corners.max(axis=0)
    assert abs(columns.min() - low[0]) < 3
    assert abs(columns.max() - high[0]) < 3
    assert low[1] - 1.5 < rows.min() < low[1] + 0.5 * (high[1] - low[1])


def test_a_car_behind_is_seen_by_the_back_camera_only():
    city = sensors(street(), recording(car((25.0, 50.0), 0.0)))
    seen = {c.channel: (redness(city.image(c, 1.0)) > 40).sum() for c in city.rig.cameras}
    assert seen["CAM_BACK"] > 50
    assert all(count == 0 for channel, count in seen.items() if channel != "CAM_BACK")


def test_left_is_left():
    ahead_left = sensors(street(), recording(car((52.0, 62.0), 0.0)))
    assert (redness(shot(ahead_left, "CAM_FRONT_LEFT")) > 40).sum() > 50
    assert (redness(shot(ahead_left, "CAM_FRONT_RIGHT")) > 40).sum() == 0


def test_lamps_shine_towards_the_front_only():
    towards, away = street(np.pi), street(0.0)
    for town, is_seen in ((towards, True), (away, False)):
        red = shot(sensors(town, recording(num_signals=1, state=RED)))
        assert ((redness(red) > 90).sum() > 4) == is_seen
    green = shot(sensors(towards, recording(num_signals=1, state=GREEN))).astype(int)
    assert ((green[..., 1] - green[..., 0]) > 90).sum() > 4
    assert (redness(green) > 90).sum() == 0


def test_a_hidden_lamp_does_not_glow():
    outline = np.array([[50.0, 45.0], [54.0, 45.0], [54.0, 56.0], [50.0, 56.0]])
    behind_a_house = replace(street(np.pi), buildings=(Building(outline, 12.0, 5),))
    hidden = shot(sensors(behind_a_house, recording(num_signals=1)))
    assert (redness(hidden) > 60).sum() == 0


def test_lamps_stay_visible_in_small_pictures():
    city = sensors(street(np.pi), recording(num_signals=1), scale=0.11)
    assert (redness(shot(city)) > 60).sum() >= 2


def test_brake_lights_light_when_braking_and_only_behind():
    for heading, is_seen in ((0.0, True), (np.pi, False)):
        dark = shot(sensors(street(), recording(car((52.0, 50.0), heading, WHITE_PAINT))))
        lit = shot(sensors(street(), recording(car((52.0, 50.0), heading, WHITE_PAINT, True))))
        gained = (redness(lit) > 110).sum() - (redness(dark) > 110).sum()
        assert (gained > 10) == is_seen


def test_absent_agents_are_not_drawn():
    gone = replace(car((55.0, 50.0), 0.0), is_present=np.zeros(41, bool))
    assert np.array_equal(
        shot(sensors(street(), recording(gone))), shot(sensors(street(), recording()))
    )


def test_nothing_of_the_speed_or_route_enters_an_image():
    agent = car((58.0, 51.5), 0.4)
    still = recording(agent, num_signals=1)
    fast = recording(agent, ego_speed_mps=9.0, num_signals=1)
    turning = replace(still, ego_yaw_rad=np.maximum(np.arange(41) - 20, 0) * 0.05)
    pictures = [shot(sensors(street(np.pi), tracks)) for tracks in (still, fast, turning)]
    assert np.array_equal(pictures[0], pictures[1])
    assert np.array_equal(pictures[0], pictures[2])


def test_pictures_depend_on_seed_and_time_only():
    town, tracks = street(), recording()
    rig = make_rig(5, 0.1, 64)
    first, again = (
        CitySensors(town, tracks, DAY, rig, 7, paint_unlit(town, 0.2)) for _ in range(2)
    )
    other = CitySensors(town, tracks, DAY, rig, 8, paint_unlit(town, 0.2))
    a, b, c = (city.image(rig.cameras[0], 1.0) for city in (first, again, other))
    assert np.array_equal(a, b)
    assert not np.array_equal(a, c)
    again.image(rig.cameras[3], 0.5)
    assert np.array_equal(a, again.image(rig.cameras[0], 1.0))


def test_night_is_dark_and_rain_is_grey():
    town, tracks = street(house=True), recording(car((58.0, 51.5), 0.4))
    day, night, rain = (
        shot(sensors(town, tracks, look)).astype(float)
        for look in (DAY, NIGHT, Look("day", True, 2.0))
    )
    assert night.mean() < 0.5 * day.mean()
    colourfulness = [np.abs(p[..., 0] - p[..., 2]).mean() for p in (day, rain)]
    assert colourfulness[1] < colourfulness[0]


def test_moving_shadow_darkens_the_ground_beside_a_car():
    look = Look("day", False, np.pi / 2)  # sun in the north (left): the shadow falls to the right
    agent = car((52.0, 51.0), 0.0, WHITE_PAINT)
    with_car = shot(sensors(street(), recording(agent), look)).astype(float)
    without = shot(sensors(street(), recording(), look)).astype(float)
    corners = box_pixels(make_rig(5, 0.25, 256).cameras[0], np.array([40.0, 50.0]), agent)
    bottom, right = int(corners[:, 1].max()) - 2, int(corners[:, 0].max()) + 3
    assert (
        with_car[bottom, right : right + 4].mean()
        < 0.85 * without[bottom, right : right + 4].mean()
    )
