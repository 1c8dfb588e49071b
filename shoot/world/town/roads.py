"""Grows a town from a seed: roads, lanes, paths across intersections, paint, lights, kerbs."""

import numpy as np
import shapely

from shoot.world.town.crosswalks import cross_midway
from shoot.world.town.curves import arc_lengths, cut, parallel, resample
from shoot.world.town.draft import LANE_STEP_M, Draft, Road, lay_lanes
from shoot.world.town.intersections import STOP_BACK_M, build_intersection
from shoot.world.town.network import plan_town
from shoot.world.town.roadside import furnish, park_cars
from shoot.world.town.town import FloatArray, RoadLine, Town

PARKING_M = 2.2
PAVEMENT_M = 3.0
KERB_RADIUS_M = 6.5
POLE_ROOM_M = 0.5


def make_town(seed: int) -> Town:
    """Grow a town; the same seed gives the same town.

    Args:
        seed: Any non-negative integer.
    """
    rng = np.random.default_rng([seed, 0x70])
    plan = plan_town(rng)
    draft = Draft()
    roads = tuple(lay_lanes(draft, road) for road in plan.roads)
    bodies = [_strip(r.plan.middle_m, r.plan.kind.half_m) for r in roads]
    road = shapely.union_all(bodies)
    road = road.buffer(KERB_RADIUS_M, quad_segs=6).buffer(-KERB_RADIUS_M, quad_segs=6)
    poles_off = road.buffer(POLE_ROOM_M)
    shapely.prepare(poles_off)
    for middle_m, arms in zip(plan.middles_m, plan.arms, strict=True):
        build_intersection(draft, roads, middle_m, arms, road, poles_off, rng)
    for r in roads:
        _paint_along(draft, r)
        cross_midway(draft, r, rng)
    parking, parked = park_cars(
        [(r.middle_m, r.plan.kind) for r in roads], draft.crosswalks, PARKING_M, rng
    )
    road = shapely.union_all([road, *parking])
    pavement = road.buffer(PAVEMENT_M, quad_segs=4).difference(road)
    buildings, props = furnish(
        plan.size_m, road, pavement, [(r.middle_m, r.plan.kind) for r in roads], draft.signals, rng
    )
    return Town(
        seed=seed,
        size_m=plan.size_m,
        lanes=tuple(draft.lanes),
        intersections=tuple(draft.intersections),
        crosswalks=tuple(draft.crosswalks),
        signals=tuple(draft.signals),
        lines=tuple(draft.lines),
        road=_many(road),
        pavement=_many(pavement),
        parking=_many(shapely.union_all(parking)),
        buildings=buildings,
        props=props,
        parked_cars=parked,
    )


def _many(shape: shapely.Geometry) -> shapely.MultiPolygon:
    parts = [g for g in shapely.get_parts(shape) if g.geom_type == "Polygon"]
    return shapely.MultiPolygon(parts)


def _strip(points_m: FloatArray, half_m: float) -> shapely.Geometry:
    return shapely.LineString(points_m).buffer(half_m, cap_style="flat")


def _paint_along(draft: Draft, road: Road) -> None:
    """Edge, lane and centre lines; a narrow road has none but its kerbs."""
    kind = road.plan.kind
    length_m = arc_lengths(road.middle_m)[-1]
    inner_m = resample(cut(road.middle_m, STOP_BACK_M, length_m - STOP_BACK_M), LANE_STEP_M)
    if kind.name == "narrow":
        return
    draft.lines.append(RoadLine(inner_m, "centre"))
    for side in (-1.0, 1.0):
        edge_m = kind.lanes * kind.lane_m
        draft.lines.append(RoadLine(parallel(inner_m, side * edge_m), "edge"))
        if kind.lanes > 1:
            draft.lines.append(RoadLine(parallel(inner_m, side * kind.lane_m), "lane"))
