"""Intersections: stop lines, lights, crosswalks and the paths of those who cross."""

from typing import Literal

import numpy as np
import shapely

from shoot.world.town.crosswalks import CROSSWALK_M, add_crosswalk
from shoot.world.town.curves import arc_lengths, resample, turn_between
from shoot.world.town.draft import LANE_STEP_M, Draft, Road
from shoot.world.town.network import Arm
from shoot.world.town.signals import place_lights
from shoot.world.town.town import FloatArray, Intersection, Lane, RoadLine

MOUTH_TO_CROSSWALK_M = 1.0
CROSSWALK_TO_STOP_M = 1.2
# From the mouth of an intersection back to its stop lines, before which paint begins.
STOP_BACK_M = MOUTH_TO_CROSSWALK_M + CROSSWALK_M + CROSSWALK_TO_STOP_M
SIGNALLED_SHARE = {3: 0.8, 4: 1.0}
# Nobody has right of way there, so everybody slows down.
UNSIGNALLED_LIMIT_MPS = 7.0
TURN_LIMIT_MPS = {"left": 5.2, "right": 4.6}

Turn = Literal["straight", "left", "right"]


def build_intersection(
    draft: Draft,
    roads: tuple[Road, ...],
    middle_m: FloatArray,
    arms: tuple[Arm, ...],
    road_area: shapely.Geometry,
    poles_off: shapely.Geometry,
    rng: np.random.Generator,
) -> None:
    """Add its paths, crosswalks, stop lines and lights; all arms get the same.

    Args:
        draft: Grows.
        roads: All of the town.
        middle_m: [2] its middle.
        arms: Of the roads that meet there.
        road_area: Where the town is road.
        poles_off: Where no pole may stand.
        rng: Source of chance.
    """
    index = len(draft.intersections)
    is_signalled = bool(rng.random() < SIGNALLED_SHARE[len(arms)])
    has_crosswalks = is_signalled or bool(rng.random() < 0.6)
    corners = []
    for arm in arms:
        left = np.array([-arm.outward[1], arm.outward[0]])
        half_m = roads[arm.road].plan.kind.half_m
        mouth = middle_m + arm.outward * arm.trim_m
        corners += [mouth - left * half_m, mouth + left * half_m]
    hull = shapely.Polygon(corners).buffer(0.01).intersection(road_area)
    outline = max(shapely.get_parts(hull), key=lambda g: g.area)
    draft.intersections.append(
        Intersection(np.array(outline.exterior.coords)[:-1], len(arms), is_signalled)
    )
    for arm in arms:
        signal = None
        if is_signalled:
            signal = len(draft.signals)
            draft.signals.append(place_lights(middle_m, arm, roads, poles_off))
        for lane in roads[arm.road].inbound(arm):
            stop_m = arc_lengths(draft.lanes[lane].centreline_m)[-1] - STOP_BACK_M
            draft.change(
                lane,
                intersection=index,
                signal=signal,
                stop_at_m=stop_m if is_signalled else None,
            )
        if is_signalled:
            left = np.array([-arm.outward[1], arm.outward[0]])
            kind = roads[arm.road].plan.kind
            at = middle_m + arm.outward * (arm.trim_m + STOP_BACK_M)
            points_m = np.stack([at + left * 0.15, at + left * kind.lanes * kind.lane_m])
            draft.lines.append(RoadLine(points_m, "stop"))
        if has_crosswalks:
            near = middle_m + arm.outward * (arm.trim_m + MOUTH_TO_CROSSWALK_M)
            add_crosswalk(
                draft, roads[arm.road], near, arm.outward,
                inbound_back_m=MOUTH_TO_CROSSWALK_M + CROSSWALK_M,
                inbound=roads[arm.road].inbound(arm), outbound=roads[arm.road].outbound(arm),
            )  # fmt: skip
        for other in arms:
            if other is not arm:
                _connect(draft, roads, arm, other, index, is_signalled)
    for arm in arms:
        for lane in roads[arm.road].inbound(arm):
            if not draft.lanes[lane].successors:
                raise RuntimeError(f"lane {lane} leads nowhere")


def _turn(arm: Arm, other: Arm) -> Turn:
    inward = -arm.outward
    cross = inward[0] * other.outward[1] - inward[1] * other.outward[0]
    angle_rad = np.arctan2(cross, inward @ other.outward)
    if abs(angle_rad) < np.deg2rad(45):
        return "straight"
    return "left" if angle_rad > 0 else "right"


def _connect(
    draft: Draft,
    roads: tuple[Road, ...],
    arm: Arm,
    other: Arm,
    intersection: int,
    is_signalled: bool,
) -> None:
    """Add the paths from one arm to another: left from the left lane, right from the right."""
    turn = _turn(arm, other)
    sources = roads[arm.road].inbound(arm)
    targets = roads[other.road].outbound(other)
    if turn == "left":
        pairs = [(sources[0], targets[0])]
    elif turn == "right":
        pairs = [(sources[-1], targets[-1])]
    elif len(sources) == len(targets):
        pairs = list(zip(sources, targets, strict=True))
    else:
        pairs = [(source, targets[-1]) for source in sources]
    for source, target in pairs:
        start, end = draft.lanes[source], draft.lanes[target]
        curve = turn_between(
            start.centreline_m[-1], -arm.outward, end.centreline_m[0], other.outward
        )
        limit = min(start.limit_mps, end.limit_mps)
        if turn != "straight":
            limit = min(limit, TURN_LIMIT_MPS[turn])
        elif not is_signalled:
            limit = min(limit, UNSIGNALLED_LIMIT_MPS)
        path = Lane(
            lane_id=len(draft.lanes),
            centreline_m=resample(curve, LANE_STEP_M),
            width_m=min(start.width_m, end.width_m),
            limit_mps=limit,
            successors=(target,),
            turn=turn,
            intersection=intersection,
        )
        draft.lanes.append(path)
        draft.change(source, successors=(*start.successors, path.lane_id))
