"""Cameras and lidar of a hand-made street: straight along x, one car, one light, one house."""

from dataclasses import replace

import numpy as np
import pytest
import shapely

from shoot.world.looks.ground import light_ground
from shoot.world.looks.light import light_of
from shoot.world.looks.movers import Movers
from shoot.world.looks.paint import crosswalk_stripes, paint_unlit
from shoot.world.looks.scenery import ego_pose
from shoot.world.sensing.casting import cast
from shoot.world.sensing.rig import Camera, make_rig, rotation_z
from shoot.world.sensing.sensors import CitySensors
from shoot.world.town.town import Building, Lane, Prop, RoadLine, Signal, Town
from shoot.world.traffic.recording import GREEN, RED, Agent, Look, Recording

DAY = Look("day", False, 2.0)
NIGHT = Look("night", False, 2.0)
RED_PAINT, WHITE_PAINT = 3, 0
CAR_M = np.array([4.4, 1.9, 1.5])


def street(signal_facing_rad: float | None = None, house: bool = False) -> Town:
    centre = np.stack([np.arange(0.0, 151.0), np.full(151, 50.0)], axis=1)
    signals: tuple[Signal, ...] = ()
    if signal_facing_rad is not None:
        signals = (
            Signal(
                np.array([[60.0, 52.0, 3.0]]),
                signal_facing_rad,
                np.array([[60.0, 52.0]]),
                0,
            ),
        )
    outline = np.array([[60.0, 60.0], [90.0, 60.0], [90.0, 75.0], [60.0, 75.0]])
    return Town(
        seed=1,
        size_m=150.0,
        lanes=(Lane(0, centre, 3.5, 9.0),),
        intersections=(),
        crosswalks=(),
        signals=signals,
        lines=(RoadLine(centre + np.array([0.0, 1.75]), "edge"),),
        road=shapely.MultiPolygon([shapely.box(0, 46, 150, 54)]),
        pavement=shapely.MultiPolygon([shapely.box(0, 54, 150, 57)]),
        parking=shapely.MultiPolygon([]),
        buildings=(Building(outline, 12.0, 2),) if house else (),
        props=(),
        parked_cars=(),
    )


def car(
    xy_m: tuple[float, float], yaw_rad: float, style: int = RED_PAINT, is_braking: bool = False
) -> Agent:
    steps = 41
    return Agent(
        "car",
        CAR_M,
        style,
        np.tile(np.array(xy_m), (steps, 1)),
        np.full(steps, yaw_rad),
        np.zeros(steps),
        np.full(steps, is_braking),
        np.ones(steps, bool),
    )


def recording(
    *agents: Agent, ego_speed_mps: float = 0.0, num_signals: int = 0, state: int = RED
) -> Recording:
    steps = 41
    x = 40.0 + ego_speed_mps * 0.05 * (np.arange(steps) - 20)
    return Recording(
        0.05,
        np.stack([x, np.full(steps, 50.0)], axis=1),
        np.zeros(steps),
        np.full(steps, ego_speed_mps),
        np.zeros(steps, np.int64),
        agents,
        np.full((steps, num_signals), state, np.int64),
    )


def sensors(town: Town, tracks: Recording, look: Look = DAY, scale: float = 0.25) -> CitySensors:
    return CitySensors(town, tracks, look, make_rig(5, scale, 256), 7, paint_unlit(town, 0.2))


def camera(city: CitySensors, channel: str = "CAM_FRONT") -> Camera:
    return next(c for c in city.rig.cameras if c.channel == channel)


def shot(city: CitySensors, channel: str = "CAM_FRONT") -> np.ndarray:
    return city.image(camera(city, channel), 1.0)


def redness(picture: np.ndarray) -> np.ndarray:
    """How much redder than anything else each pixel is."""
    values = picture.astype(int)
    return values[..., 0] - np.maximum(values[..., 1], values[..., 2])


def box_pixels(view: Camera, ego_m: np.ndarray, agent: Agent) -> np.ndarray:
    """Corners [8, 2] of an agent's box in the image, by the matrices alone (ego heads along x)."""
    length, width, height = agent.size_m
    corners = np.array([
        [sx * length / 2, sy * width / 2, z]
        for sx in (-1, 1) for sy in (-1, 1) for z in (0.0, height)
    ])  # fmt: skip
    town_m = corners @ rotation_z(float(agent.yaw_rad[0])).T + [*agent.xy_m[0], 0.0]
    ego = np.column_stack([town_m - [*ego_m, 0.0], np.ones(8)])
    seen = (ego @ np.linalg.inv(view.ego_from_camera).T)[:, :3] @ view.pixel_from_camera.T
    return seen[:, :2] / seen[:, 2:]


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


def town_points(city: CitySensors, time_s: float) -> tuple[np.ndarray, np.ndarray]:
    sweep = city.sweep(time_s)
    x, y, yaw = ego_pose(city.recording, time_s)
    lidar = city.rig.ego_from_lidar
    ego = sweep.points[:, :3] @ lidar[:3, :3].T + lidar[:3, 3]
    return ego @ rotation_z(yaw).T + [x, y, 0.0], sweep.object_ids


def test_lidar_points_lie_on_surfaces():
    agent = car((52.0, 53.0), 0.7)
    city = sensors(street(house=True), recording(agent))
    points, ids = town_points(city, 1.0)
    local = (points - [*agent.xy_m[0], 0.0]) @ rotation_z(0.7)
    on_car = np.all(np.abs(local[:, :2]) < CAR_M[:2] / 2 + 0.08, axis=1) & (local[:, 2] < 1.6)
    assert (ids == 0).sum() > 50
    assert np.all(on_car[ids == 0])
    rest = points[ids < 0]
    on_ground = np.abs(rest[:, 2]) < 0.08
    on_wall = (np.abs(rest[:, 1] - 60) < 0.08) | (np.abs(rest[:, 0] - 60) < 0.08)
    assert np.all(on_ground | on_wall)
    assert on_wall.sum() > 100
    assert np.all(np.hypot(points[:, 0] - 40.95, points[:, 1] - 50.0) < 91.0)


def test_lidar_frame_is_x_right_y_forward():
    city = sensors(street(house=True), recording())
    sweep = city.sweep(1.0)
    wall = sweep.points[(sweep.points[:, 2] > 0.5)]
    # The house stands ahead on the left.
    assert np.all(wall[:, 1] > 10)
    assert np.all(wall[:, 0] < -5)
    assert set(np.unique(sweep.points[:, 4])) <= set(range(32))


def test_lidar_sees_paint_by_its_brightness():
    line = RoadLine(np.array([[0.0, 50.0], [150.0, 50.0]]), "stop")
    city = sensors(replace(street(), lines=(line,)), recording())
    points, _ = town_points(city, 1.0)
    sweep = city.sweep(1.0)
    ground = np.abs(points[:, 2]) < 0.1
    offset = np.abs(points[:, 1] - 50.0)
    paint, asphalt = ground & (offset < 0.15), ground & (offset > 0.6) & (offset < 3.0)
    assert paint.sum() > 10
    assert sweep.points[paint, 3].mean() > 2.5 * sweep.points[asphalt, 3].mean()


def test_turns_of_the_lidar_see_between_each_others_beams():
    city = sensors(street(house=True), recording())
    azimuths = [
        np.unique(np.arctan2(*sweep.points[sweep.points[:, 4] == 0, :2].T).round(5))
        for sweep in (city.sweep(1.0), city.sweep(1.05))
    ]
    step_rad = 2.0 * np.pi / city.rig.lidar_azimuths
    for own in azimuths:
        # Each turn by itself: beams a whole number of steps apart.
        steps = (own - own[0]) / step_rad
        assert np.abs(steps - steps.round()).max() < 0.02
    shift = (azimuths[1][0] - azimuths[0][0]) / step_rad
    assert abs(shift - round(shift)) > 0.02


def test_visible_share_of_hidden_and_free_cars():
    near = replace(car((48.0, 50.0), 0.0), size_m=np.array([8.0, 3.0, 4.0]))
    hidden, free = car((62.0, 50.0), 0.0), car((50.0, 62.0), 0.0)
    city = sensors(street(), recording(near, hidden, free))
    inside = np.array([[[x, y, 0.7] for x in (-1.0, 1.0) for y in (-0.5, 0.5)]])
    places = np.concatenate([inside + np.array(place) for place in ([62, 50, 0], [50, 62, 0])])
    share = city.visible_share(places, 1.0, np.array([1, 2], np.int32))
    assert share[0] == 0.0
    assert share[1] == 1.0
    assert city.visible_share(np.zeros((0, 4, 3)), 1.0, np.zeros(0, np.int32)).shape == (0,)


def test_poses_between_steps():
    tracks = replace(recording(ego_speed_mps=8.0), ego_yaw_rad=np.linspace(0.0, 1.0, 41))
    x, y, yaw = ego_pose(tracks, 1.025)
    assert (x, y, yaw) == pytest.approx((40.0 + 8 * 0.025, 50.0, 0.5125))
    # An agent that turns through +-pi takes the short way.
    turning = replace(car((0.0, 0.0), 0.0), yaw_rad=np.where(np.arange(41) < 21, 3.1, -3.1))
    moment = Movers(replace(tracks, agents=(turning,))).at(1.025)
    assert abs(moment.yaw_rad[0]) == pytest.approx(np.pi, abs=1e-6)


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


def test_rays_stop_at_the_nearest_thing():
    city = sensors(street(house=True), recording(car((52.0, 50.0), 0.0)))
    moving = city.movers.solid(city.movers.at(1.0), city.light, 0)
    eye = np.array([40.0, 50.0, 0.5])
    rays = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 0.0, 1.0]], np.float32)
    standing = city._standing
    hits = cast(eye, rays, standing, moving)
    assert hits.moving[0] >= 0
    assert hits.distance_m[0] == pytest.approx(12 - CAR_M[0] / 2, abs=0.05)
    assert hits.is_ground.tolist() == [False, True, False]
    assert hits.distance_m[1] == pytest.approx(0.5, abs=1e-5)
    assert hits.distance_m[2] > 300
    masked = cast(eye, rays, standing, moving, np.array([1, 2], np.int32))
    assert masked.moving[0] == -1
