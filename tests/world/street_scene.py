"""A hand-made street with its sensors: straight along x, one car, one light, one house."""

import numpy as np
import shapely

from shoot.world.looks.paint import paint_unlit
from shoot.world.sensing.rig import Camera, make_rig, rotation_z
from shoot.world.sensing.sensors import CitySensors
from shoot.world.town.town import Building, Lane, RoadLine, Signal, Town
from shoot.world.traffic.recording import RED, Agent, Look, Recording

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
