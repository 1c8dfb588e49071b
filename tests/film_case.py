"""A drive made by hand: a car goes straight on across an open place, one other stands there."""

import io
from dataclasses import replace

import numpy as np
import shapely
from PIL import Image

from lss_core.grid import BevGrid
from shoot.footprint import turn
from shoot.simulation.filming.film import Film
from shoot.simulation.filming.mishaps import Mishap
from shoot.simulation.observation import CameraView
from shoot.simulation.plan import CostMap, Plan
from shoot.simulation.route_log import AgentTracks, EgoTrack, RouteLog
from shoot.world.town.town import Lane, Town
from shoot.world.traffic.bodies import Cast

NUM_STEPS, SPEED_MPS = 13, 8.0
START_M, YAW_RAD = np.array([30.0, 20.0]), 0.5
# Of the one that stands, in `ego` at the start.
OTHER_M, OTHER_YAW_RAD = np.array([30.0, 4.0]), 0.25
TIMES_S = np.arange(1, 21) * 0.25
# Straight on, to the left, to the right, and nowhere.
TEMPLATES_M = np.stack(
    [np.stack([SPEED_MPS * TIMES_S, bend * TIMES_S**2], axis=1) for bend in (0.0, 0.8, -0.8)]
    + [np.zeros((20, 2))]
)
GREY = 120


def make_town() -> Town:
    """A square of road with one lane across."""
    lane = Lane(0, np.stack([START_M, START_M + turn(np.array([70.0, 0.0]), np.array(YAW_RAD))]),
                3.5, 12.0)  # fmt: skip
    nothing = shapely.MultiPolygon()
    road = shapely.MultiPolygon([shapely.box(0.0, 0.0, 200.0, 200.0)])
    return Town(1, 200.0, (lane,), (), (), (), (), road, nothing, nothing, (), (), ())


def make_log(num_steps: int = NUM_STEPS) -> RouteLog:
    """Two plans, at 0.4 s and 0.9 s: straight on, then to the left."""
    times_s = 0.1 * np.arange(num_steps)
    still = np.zeros(num_steps)
    way_m = np.stack([SPEED_MPS * times_s, still], axis=1)
    yaw = np.full(num_steps, YAW_RAD)
    ego = EgoTrack(
        START_M + turn(way_m, yaw), yaw, np.full(num_steps, SPEED_MPS), still, still, way_m[:, 0]
    )
    other_m = START_M + turn(OTHER_M, np.array(YAW_RAD))
    agents = AgentTracks(
        np.tile(other_m, (1, num_steps, 1)),
        np.full((1, num_steps), YAW_RAD + OTHER_YAW_RAD),
        still[None],
        np.zeros((1, num_steps), np.bool_),
    )
    return RouteLog(
        town_seed=1,
        seed=3,
        mode="replay",
        ego=ego,
        agents=agents,
        cast=Cast(("car",), np.array([[4.5, 1.9, 1.5]]), (0,)),
        signal_state=np.zeros((num_steps, 0), np.int64),
        plans=((0.4, make_plan(0)), (0.9, make_plan(1))),
        route_lanes=(0,),
    )


def make_plan(template_idx: int) -> Plan:
    """Of all templates the last is masked; to the left of the car it is dear."""
    with np.errstate(divide="ignore"):
        log_prob = np.log([0.5, 0.3, 0.2, 0.0])
    cost = np.zeros((40, 40))
    cost[:, 20:] = 1.0
    grid = BevGrid(-10.0, 10.0, -10.0, 10.0, 0.5)
    return Plan(TEMPLATES_M[template_idx], 0.25, template_idx, log_prob, False, TEMPLATES_M,
                CostMap(cost, grid))  # fmt: skip


def make_view(channel: str = "CAM_FRONT") -> CameraView:
    """A grey image, seen 1.5 m above the rear axle, straight ahead."""
    stream = io.BytesIO()
    Image.new("RGB", (160, 90), (GREY, GREY, GREY)).save(stream, "JPEG")
    ego_from_camera = np.eye(4)
    ego_from_camera[:3, :3] = [[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]]
    ego_from_camera[2, 3] = 1.5
    intrinsics = np.array([[120.0, 0.0, 79.5], [0.0, 120.0, 44.5], [0.0, 0.0, 1.0]])
    return CameraView(
        channel, stream.getvalue(), (90, 160), intrinsics, ego_from_camera, ego_from_camera
    )


def make_film(
    has_images: bool = True, mishaps: tuple[Mishap, ...] = (), num_steps: int = NUM_STEPS
) -> Film:
    views = ((make_view(),), (make_view(),)) if has_images else ()
    return Film(make_town(), make_log(num_steps), views, "by hand", mishaps)


def without_costs(film: Film) -> Film:
    """The same, planned without a cost map."""
    plans = tuple((time_s, replace(plan, cost_map=None)) for time_s, plan in film.log.plans)
    return replace(film, log=replace(film.log, plans=plans))
