"""Who may cross an intersection with whom: conflicting paths, parting siblings, lights."""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import shapely
from numpy.typing import NDArray

from shoot.world.town.curves import arc_lengths, normals, resample
from shoot.world.town.town import FloatArray, Town
from shoot.world.traffic.recording import AMBER, GREEN, RED

AMBER_S = 3.0
ALL_RED_S = 1.5
GREEN_S = (8.0, 11.0)
# The largest vehicle that drives here, about its rear axle, and air around it.
SWEPT_FRONT_M, SWEPT_REAR_M, SWEPT_HALF_M = 4.9, 1.6, 1.35
SIBLINGS_PART_M = 2.8


@dataclass(frozen=True)
class PathRules:
    """What one path across an intersection has to do with the others there.

    Attributes:
        conflicts: Paths whose swept area touches its own, those from the same lane aside.
        siblings: Other paths from the same lane, each with the arc length where they have parted.
    """

    conflicts: frozenset[int]
    siblings: tuple[tuple[int, float], ...]


@lru_cache(maxsize=1)
def path_rules(town: Town) -> dict[int, PathRules]:
    """Rules of each path across an intersection, by lane number; kept for a town's next scene."""
    by_crossing: dict[int, list[int]] = {}
    source: dict[int, int] = {}
    for lane in town.lanes:
        for path in lane.successors:
            if town.lanes[path].turn is not None:
                source[path] = lane.lane_id
        if lane.turn is not None and lane.intersection is not None:
            by_crossing.setdefault(lane.intersection, []).append(lane.lane_id)
    rules = {}
    for paths in by_crossing.values():
        swept = np.array([_swept_area(town.lanes[p].centreline_m) for p in paths])
        touches = shapely.intersects(swept[:, None], swept[None])
        for i, path in enumerate(paths):
            siblings = [q for q in paths if q != path and source[q] == source[path]]
            rules[path] = PathRules(
                frozenset(
                    q
                    for j, q in enumerate(paths)
                    if touches[i, j] and q != path and q not in siblings
                ),
                tuple(
                    (q, _part_at(town.lanes[path].centreline_m, town.lanes[q].centreline_m))
                    for q in siblings
                ),
            )
    return rules


def _swept_area(path_m: FloatArray) -> shapely.Geometry:
    """Area a large vehicle sweeps while its rear axle follows the path, its ends included."""
    first, last = path_m[1] - path_m[0], path_m[-1] - path_m[-2]
    lead_in = path_m[0] - first / np.hypot(*first) * SWEPT_FRONT_M
    lead_out = path_m[-1] + last / np.hypot(*last) * SWEPT_REAR_M
    points_m = resample(np.concatenate([[lead_in], path_m, [lead_out]]), 1.0)
    left = normals(points_m)
    ahead = np.stack([left[:, 1], -left[:, 0]], axis=1)
    corners = np.stack(
        [
            points_m + along * ahead + across * SWEPT_HALF_M * left
            for along, across in (
                (SWEPT_FRONT_M, -1), (SWEPT_FRONT_M, 1), (-SWEPT_REAR_M, 1), (-SWEPT_REAR_M, -1)
            )
        ],
        axis=1,
    )  # fmt: skip
    return shapely.union_all(shapely.polygons(corners))


def _part_at(path_m: FloatArray, other_m: FloatArray) -> float:
    """Arc length from which on two paths out of one lane are apart."""
    distance_m = np.array([np.hypot(*(other_m - p).T).min() for p in path_m])
    near = np.flatnonzero(distance_m < SIBLINGS_PART_M)
    return float(arc_lengths(path_m)[near[-1]])


@dataclass(frozen=True)
class SignalPlan:
    """When which light shows what in one scene.

    Attributes:
        green_s: [S] green time of each light's phase and of the other phase alike.
        shift_s: [S] time at which its own phase turns green, within one cycle.
    """

    green_s: FloatArray
    shift_s: FloatArray

    def cycle_s(self) -> FloatArray:
        """[S] length of the cycle: two phases, each green, amber, all red."""
        return np.asarray(2 * (self.green_s + AMBER_S + ALL_RED_S))

    def states(self, time_s: float | FloatArray) -> NDArray[np.int64]:
        """[..., S] RED, AMBER or GREEN at the given times."""
        into_s = (np.asarray(time_s)[..., None] - self.shift_s) % self.cycle_s()
        return np.where(
            into_s < self.green_s, GREEN, np.where(into_s < self.green_s + AMBER_S, AMBER, RED)
        ).astype(np.int64)

    def until_green_s(self, time_s: float) -> FloatArray:
        """[S] seconds until each turns green."""
        return np.asarray((self.shift_s - time_s) % self.cycle_s())


def plan_signals(town: Town, rng: np.random.Generator) -> SignalPlan:
    """Draw cycle and start of each intersection's lights; its two phases take turns."""
    crossing = np.zeros(len(town.signals), dtype=np.int64)
    for lane in town.lanes:
        if lane.signal is not None and lane.intersection is not None:
            crossing[lane.signal] = lane.intersection
    green_s = rng.uniform(*GREEN_S, size=len(town.intersections))[crossing]
    half_s = green_s + AMBER_S + ALL_RED_S
    start = rng.uniform(0.0, 1.0, size=len(town.intersections))[crossing] * 2 * half_s
    phase = np.array([signal.phase for signal in town.signals], dtype=np.float64)
    shift_s = np.asarray(start + phase * half_s, dtype=np.float64)
    return SignalPlan(green_s, shift_s)
