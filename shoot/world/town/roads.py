"""Grows a town from a seed: roads, lanes, paths across intersections, paint, lights, kerbs."""

from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np
import shapely

from shoot.world.town.curves import arc_lengths, cut, parallel, point_at, resample, turn_between
from shoot.world.town.network import Arm, Plan, PlannedRoad, plan_town
from shoot.world.town.roadside import furnish, park_cars
from shoot.world.town.town import (
    Crosswalk,
    FloatArray,
    Intersection,
    Lane,
    RoadLine,
    Signal,
    Town,
)

LANE_STEP_M = 0.5
CROSSWALK_M = 3.0
MOUTH_TO_CROSSWALK_M = 1.0
CROSSWALK_TO_STOP_M = 1.2
PARKING_M = 2.2
PAVEMENT_M = 3.0
MIDWAY_SHARE = 0.3
KERB_RADIUS_M = 6.5
POLE_ROOM_M = 0.5
SIGNALLED_SHARE = {3: 0.8, 4: 1.0}
# Nobody has right of way there, so everybody slows down.
UNSIGNALLED_LIMIT_MPS = 7.0
TURN_LIMIT_MPS = {"left": 5.2, "right": 4.6}

Turn = Literal["straight", "left", "right"]


@dataclass(frozen=True)
class _Road:
    """A planned road cut down to what lies between its intersections.

    Attributes:
        middle_m: [P, 2] its middle line.
        forward, backward: Lane numbers, left to right.
    """

    plan: PlannedRoad
    middle_m: FloatArray
    forward: tuple[int, ...]
    backward: tuple[int, ...]

    def inbound(self, arm: Arm) -> tuple[int, ...]:
        """Lanes that lead to the intersection this arm belongs to, left to right."""
        return self.backward if arm.at_start else self.forward

    def outbound(self, arm: Arm) -> tuple[int, ...]:
        """Lanes that leave it, left to right."""
        return self.forward if arm.at_start else self.backward


@dataclass
class _Draft:
    """What has been built so far."""

    lanes: list[Lane] = field(default_factory=list)
    crosswalks: list[Crosswalk] = field(default_factory=list)
    signals: list[Signal] = field(default_factory=list)
    lines: list[RoadLine] = field(default_factory=list)
    intersections: list[Intersection] = field(default_factory=list)

    def change(self, lane: int, **what: object) -> None:
        self.lanes[lane] = replace(self.lanes[lane], **what)  # type: ignore[arg-type]


def make_town(seed: int) -> Town:
    """Grow a town; the same seed gives the same town.

    Args:
        seed: Any non-negative integer.
    """
    rng = np.random.default_rng([seed, 0x70])
    plan = plan_town(rng)
    draft = _Draft()
    roads = tuple(_lay_lanes(draft, road) for road in plan.roads)
    bodies = [_strip(r.plan.middle_m, r.plan.kind.half_m) for r in roads]
    road = shapely.union_all(bodies)
    road = road.buffer(KERB_RADIUS_M, quad_segs=6).buffer(-KERB_RADIUS_M, quad_segs=6)
    poles_off = road.buffer(POLE_ROOM_M)
    shapely.prepare(poles_off)
    for middle_m, arms in zip(plan.middles_m, plan.arms, strict=True):
        _build_intersection(draft, plan, roads, middle_m, arms, road, poles_off, rng)
    for r in roads:
        _paint_along(draft, r)
        _cross_midway(draft, r, rng)
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


def _lay_lanes(draft: _Draft, plan: PlannedRoad) -> _Road:
    """Add a road's lanes, without successors yet."""
    length_m = arc_lengths(plan.middle_m)[-1]
    middle_m = resample(
        cut(plan.middle_m, plan.trims_m[0], length_m - plan.trims_m[1]), LANE_STEP_M
    )
    kind = plan.kind
    directions = []
    for points_m in (middle_m, middle_m[::-1]):
        first = len(draft.lanes)
        numbers = tuple(range(first, first + kind.lanes))
        for i in numbers:
            draft.lanes.append(
                Lane(
                    lane_id=i,
                    centreline_m=resample(
                        parallel(points_m, -(i - first + 0.5) * kind.lane_m), LANE_STEP_M
                    ),
                    width_m=kind.lane_m,
                    limit_mps=kind.limit_mps,
                    left_lane=i - 1 if i > first else None,
                    right_lane=i + 1 if i < numbers[-1] else None,
                )
            )
        directions.append(numbers)
    return _Road(plan, middle_m, directions[0], directions[1])


def _build_intersection(
    draft: _Draft,
    plan: Plan,
    roads: tuple[_Road, ...],
    middle_m: FloatArray,
    arms: tuple[Arm, ...],
    road_area: shapely.Geometry,
    poles_off: shapely.Geometry,
    rng: np.random.Generator,
) -> None:
    """Add its paths, crosswalks, stop lines and lights; all arms get the same."""
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
            draft.signals.append(_place_lights(middle_m, arm, roads, poles_off))
        stop_back_m = MOUTH_TO_CROSSWALK_M + CROSSWALK_M + CROSSWALK_TO_STOP_M
        for lane in roads[arm.road].inbound(arm):
            stop_m = arc_lengths(draft.lanes[lane].centreline_m)[-1] - stop_back_m
            draft.change(
                lane,
                intersection=index,
                signal=signal,
                stop_at_m=stop_m if is_signalled else None,
            )
        if is_signalled:
            left = np.array([-arm.outward[1], arm.outward[0]])
            kind = roads[arm.road].plan.kind
            at = middle_m + arm.outward * (arm.trim_m + stop_back_m)
            points_m = np.stack([at + left * 0.15, at + left * kind.lanes * kind.lane_m])
            draft.lines.append(RoadLine(points_m, "stop"))
        if has_crosswalks:
            near = middle_m + arm.outward * (arm.trim_m + MOUTH_TO_CROSSWALK_M)
            _add_crosswalk(
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
    draft: _Draft,
    roads: tuple[_Road, ...],
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


def _add_crosswalk(
    draft: _Draft,
    road: _Road,
    near_m: FloatArray,
    along: FloatArray,
    inbound_back_m: float,
    inbound: tuple[int, ...],
    outbound: tuple[int, ...],
) -> None:
    """Paint a crosswalk from `near_m` on, `along` the road, and tell the lanes about it.

    Args:
        draft: Grows.
        road: The road it crosses.
        near_m: [2] middle of the edge that lies nearer to the intersection.
        along: [2] unit direction away from the intersection.
        inbound_back_m: How far before the end of inbound lanes its far edge lies.
        inbound: Lanes towards the intersection.
        outbound: Lanes away from it.
    """
    left = np.array([-along[1], along[0]])
    half_m = road.plan.kind.half_m
    outline = np.stack(
        [
            near_m - left * half_m,
            near_m + along * CROSSWALK_M - left * half_m,
            near_m + along * CROSSWALK_M + left * half_m,
            near_m + left * half_m,
        ]
    )
    centre = near_m + along * CROSSWALK_M / 2
    path = np.stack([centre - left * half_m, centre + left * half_m])
    index = len(draft.crosswalks)
    draft.crosswalks.append(Crosswalk(outline, path))
    for lane in inbound:
        length_m = arc_lengths(draft.lanes[lane].centreline_m)[-1]
        _note_crosswalk(draft, lane, index, length_m - inbound_back_m)
    for lane in outbound:
        _note_crosswalk(draft, lane, index, inbound_back_m - CROSSWALK_M)


def _note_crosswalk(draft: _Draft, lane: int, crosswalk: int, at_m: float) -> None:
    known = (*draft.lanes[lane].crosswalks, (crosswalk, float(at_m)))
    draft.change(lane, crosswalks=tuple(sorted(known, key=lambda c: c[1])))


def _cross_midway(draft: _Draft, road: _Road, rng: np.random.Generator) -> None:
    """Perhaps a crosswalk between intersections."""
    length_m = arc_lengths(road.middle_m)[-1]
    wanted = rng.random() < MIDWAY_SHARE
    if length_m < 48.0 or not wanted:
        return
    for share in rng.permutation([0.42, 0.5, 0.58]):
        centre, along = point_at(road.middle_m, length_m * share)
        around = [point_at(road.middle_m, length_m * share + d_m)[1] for d_m in (-8.0, 8.0)]
        if min(tangent @ along for tangent in around) > 0.995:
            break
    else:
        return  # nobody paints one in a bend
    left = np.array([-along[1], along[0]])
    half_m = road.plan.kind.half_m
    ends = [centre - along * CROSSWALK_M / 2, centre + along * CROSSWALK_M / 2]
    outline = np.stack(
        [ends[0] - left * half_m, ends[1] - left * half_m,
         ends[1] + left * half_m, ends[0] + left * half_m]
    )  # fmt: skip
    index = len(draft.crosswalks)
    draft.crosswalks.append(
        Crosswalk(outline, np.stack([centre - left * half_m, centre + left * half_m]))
    )
    for lane in (*road.forward, *road.backward):
        points_m = draft.lanes[lane].centreline_m
        nearest = int(np.argmin(np.hypot(*(points_m - centre).T)))
        near_m = arc_lengths(points_m)[nearest] - CROSSWALK_M / 2
        _note_crosswalk(draft, lane, index, near_m)


def _paint_along(draft: _Draft, road: _Road) -> None:
    """Edge, lane and centre lines; a narrow road has none but its kerbs."""
    kind = road.plan.kind
    length_m = arc_lengths(road.middle_m)[-1]
    clear_m = MOUTH_TO_CROSSWALK_M + CROSSWALK_M + CROSSWALK_TO_STOP_M
    inner_m = resample(cut(road.middle_m, clear_m, length_m - clear_m), LANE_STEP_M)
    if kind.name == "narrow":
        return
    draft.lines.append(RoadLine(inner_m, "centre"))
    for side in (-1.0, 1.0):
        edge_m = kind.lanes * kind.lane_m
        draft.lines.append(RoadLine(parallel(inner_m, side * edge_m), "edge"))
        if kind.lanes > 1:
            draft.lines.append(RoadLine(parallel(inner_m, side * kind.lane_m), "lane"))


def _place_lights(
    middle_m: FloatArray,
    arm: Arm,
    roads: tuple[_Road, ...],
    poles_off: shapely.Geometry,
) -> Signal:
    """Two heads: one on the near right corner, one beyond the intersection over the lane."""
    ahead = -arm.outward
    right = np.array([ahead[1], -ahead[0]])
    kind = roads[arm.road].plan.kind
    side_m = kind.half_m + 0.8
    more_m = np.arange(0.0, 8.0, 0.5)
    feet = []
    for ahead_m in (np.array([-arm.trim_m - 0.4]), np.arange(7.0, 24.0, 0.5)):
        sideways_m, forward_m = (g.ravel() for g in np.meshgrid(more_m, ahead_m, indexing="ij"))
        places_m = middle_m + np.outer(forward_m, ahead) + np.outer(sideways_m + side_m, right)
        is_clear = ~shapely.contains_xy(poles_off, *places_m.T)
        feet.append(places_m[int(np.argmax(is_clear))])
    over = middle_m + ahead * ((feet[1] - middle_m) @ ahead) + right * kind.lane_m * kind.lanes / 2
    heads = np.array([[*feet[0], 3.0], [*over, 5.2]])
    facing_rad = float(np.arctan2(arm.outward[1], arm.outward[0]))
    return Signal(heads, facing_rad, np.stack(feet), arm.axis)
