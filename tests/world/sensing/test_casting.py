"""Rays of a hand-made street: what the lidar meets, and what can be seen from the car."""

from dataclasses import replace

import numpy as np
import pytest
from street_scene import CAR_M, car, recording, sensors, street

from shoot.world.looks.scenery import ego_pose
from shoot.world.sensing.casting import cast
from shoot.world.sensing.rig import rotation_z
from shoot.world.sensing.sensors import CitySensors
from shoot.world.town.town import RoadLine


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
