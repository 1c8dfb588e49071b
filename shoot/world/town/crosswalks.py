"""Crosswalks, at intersections and between them, and the lanes that know of them."""

import numpy as np

from shoot.world.town.curves import arc_lengths, point_at
from shoot.world.town.draft import Draft, Road
from shoot.world.town.town import Crosswalk, FloatArray

CROSSWALK_M = 3.0
MIDWAY_SHARE = 0.3


def add_crosswalk(
    draft: Draft,
    road: Road,
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


def _note_crosswalk(draft: Draft, lane: int, crosswalk: int, at_m: float) -> None:
    known = (*draft.lanes[lane].crosswalks, (crosswalk, float(at_m)))
    draft.change(lane, crosswalks=tuple(sorted(known, key=lambda c: c[1])))


def cross_midway(draft: Draft, road: Road, rng: np.random.Generator) -> None:
    """Perhaps a crosswalk between intersections.

    Args:
        draft: Grows.
        road: The road it may cross.
        rng: Source of chance.
    """
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
