"""A road along x, made by hand: the ego's lane at y = 0, the oncoming one at y = 4."""

import numpy as np
import shapely

from shoot.footprint import EGO_LENGTH_M, EGO_REAR_M, turn
from shoot.metrics.driving_score import Lanes, Lights, Others, Surroundings, Track

LANE_M = 4.0
ROAD_M = 300.0
BUSY_STEPS = 41
# From the rear axle to the middle and to the front bumper.
MIDDLE_M = EGO_LENGTH_M / 2 - EGO_REAR_M
FRONT_M = EGO_LENGTH_M - EGO_REAR_M


def drive(x_m, y_m=0.0, yaw_rad=0.0, speed_mps=None, dt_s=0.1):
    """A track whose rear axle is at (x, y); its speed is the slope of x unless it is said."""
    x_m = np.asarray(x_m, float)
    y_m, yaw_rad = (np.broadcast_to(np.asarray(a, float), x_m.shape) for a in (y_m, yaw_rad))
    if speed_mps is None:
        speed_mps = np.gradient(x_m, dt_s) if len(x_m) > 1 else np.zeros(1)
    speed_mps = np.broadcast_to(np.asarray(speed_mps, float), x_m.shape)
    return Track(np.stack([x_m, y_m], axis=-1), yaw_rad.copy(), speed_mps.copy(), dt_s)


def at_speed(speed_mps, num_steps=41, start_m=10.0, **more):
    """Straight on, at one speed."""
    return drive(start_m + speed_mps * 0.1 * np.arange(num_steps), speed_mps=speed_mps, **more)


def other(x_m, y_m=0.0, yaw_rad=0.0, speed_mps=0.0, kind="car", size_m=(4.0, 2.0)):
    """One other, by the middle of its box at each step."""
    x_m = np.asarray(x_m, float)
    y_m, yaw_rad, speed_mps = (
        np.broadcast_to(np.asarray(a, float), x_m.shape)[None].copy()
        for a in (y_m, yaw_rad, speed_mps)
    )
    return Others(
        np.stack([x_m[None], y_m], axis=-1),
        yaw_rad,
        speed_mps,
        np.array([size_m], float),
        np.ones_like(yaw_rad, bool),
        (kind,),
    )


def together(*others):
    """All of these, in this order."""
    arrays = ("centre_m", "yaw_rad", "speed_mps", "size_m", "is_present")
    joined = (np.concatenate([getattr(one, name) for one in others]) for name in arrays)
    return Others(*joined, kinds=sum((one.kinds for one in others), ()))


def road(junction=None, red=None, num_steps=41):
    """The surroundings: drivable are the two lanes. One light, if `red` is said.

    Args:
        junction: From where to where an intersection reaches along x.
        red: [T] whether its light is red.
        num_steps: Of a light that is never red.
    """
    xs = np.arange(0.0, ROAD_M + 1.0)
    own = np.stack([xs, np.zeros_like(xs)], axis=-1)
    oncoming = np.stack([xs[::-1], np.full_like(xs, LANE_M)], axis=-1)
    crossing = () if junction is None else (shapely.box(junction[0], -2.0, junction[1], 6.0),)
    lights = Lights()
    if junction is not None:
        red = np.zeros(num_steps, bool) if red is None else np.asarray(red, bool)
        lights = Lights((shapely.box(junction[0], -2.0, junction[1], 2.0),), red[None])
    return Surroundings(
        drivable=shapely.box(0.0, -2.0, ROAD_M, 6.0),
        lanes=Lanes((own, oncoming), np.full(2, LANE_M), np.array([True, False])),
        route_m=own,
        intersections=crossing,
        lights=lights,
    )


def busy_scene(seed: int):
    """A wild drive among eight others, some hit; a light that changes."""
    rng = np.random.default_rng(seed)
    steps = np.arange(BUSY_STEPS)
    speed_mps = np.clip(
        rng.uniform(2.0, 14.0) + np.cumsum(rng.normal(0, 0.2, BUSY_STEPS)), 0.0, None
    )
    yaw_rad = 0.15 * np.sin(steps / 9.0 + rng.uniform(0, 6))
    x_m = 10.0 + np.cumsum(speed_mps * np.cos(yaw_rad)) * 0.1
    y_m = rng.uniform(-1.0, 2.0) + np.cumsum(speed_mps * np.sin(yaw_rad)) * 0.1
    cars = [
        other(
            rng.uniform(0.0, 60.0) + 0.1 * v * steps,
            rng.uniform(-3.0, 6.0) + 0.05 * rng.normal() * steps,
            rng.uniform(-3.0, 3.0),
            v,
            ("car", "object", "pedestrian", "truck")[k % 4],
            tuple(rng.uniform(0.5, 4.0, 2)),
        )
        for k, v in enumerate(rng.uniform(0.0, 9.0, 8))
    ]
    around = road(junction=(25.0, 45.0), red=rng.random(BUSY_STEPS) < 0.5)
    return drive(x_m, y_m, yaw_rad, speed_mps), together(*cars), around


def moved_scene(scene, angle_rad=1.4, shift_m=(5.0, -7.0)):
    """Ego, others and road in a frame turned to the left and moved."""
    ego, others, around = scene
    return (
        moved_track(ego, angle_rad, shift_m),
        moved_others(others, angle_rad, shift_m),
        moved_road(around, angle_rad, shift_m),
    )


def moved_track(track, angle_rad, shift_m):
    """The track in a frame turned to the left and moved."""
    xy_m = turn(track.xy_m, np.full(len(track), angle_rad)) + shift_m
    return Track(xy_m, track.yaw_rad + angle_rad, track.speed_mps, track.dt_s)


def moved_others(others, angle_rad, shift_m):
    """The same of all others."""
    centre_m = turn(others.centre_m, np.full(others.yaw_rad.shape, angle_rad)) + shift_m
    return Others(
        centre_m,
        others.yaw_rad + angle_rad,
        others.speed_mps,
        others.size_m,
        others.is_present,
        others.kinds,
    )


def moved_road(around, angle_rad, shift_m):
    """The same of all that stands."""

    def points(points_m):
        return turn(points_m, np.full(len(points_m), angle_rad)) + shift_m

    def ground(polygon):
        return shapely.transform(polygon, points)

    lanes = around.lanes
    lines = tuple(points(line) for line in lanes.centrelines_m)
    return Surroundings(
        drivable=ground(around.drivable),
        lanes=Lanes(lines, lanes.widths_m, lanes.is_on_route),
        route_m=points(around.route_m),
        intersections=tuple(ground(p) for p in around.intersections),
        lights=Lights(tuple(ground(p) for p in around.lights.connectors), around.lights.is_red),
    )
