"""People on foot: some cross at crosswalks when they may, some stroll along the pavement."""

from copy import copy
from dataclasses import dataclass, field

import numpy as np
import shapely

from lss_core.geometry import direction_of
from shoot.world.town.curves import arc_lengths, point_at
from shoot.world.town.town import FloatArray, Town
from shoot.world.traffic.bodies import EgoBody
from shoot.world.traffic.junctions import AMBER_S, SignalPlan
from shoot.world.traffic.obstacle import bars_way
from shoot.world.traffic.recording import RED

WALKER_M = 0.6
KERB_ROOM_M = 0.6
PAVEMENT_EDGE_M = 0.35
# Who is that near to the kerb and may walk is about to: drivers give way.
STEPPING_M = 1.4
# Past a lane's middle by half a car and some air, one is out of its way.
CLEAR_OF_LANE_M = 1.7
CROSSINGS_MIDWAY, CROSSINGS_UNSIGNALLED, CROSSINGS_PER_RED = 1.7, 0.9, 0.45
# Only so long after a road's lights turn red may one set out to cross it.
WALK_S = 6.0
# From farther off nobody looks out for the ego: it could not be there within some seconds.
EGO_MATTERS_M = 50.0


@dataclass(eq=False)
class Walker:
    """Somebody on foot.

    Attributes:
        path_m: [P, 2] the way to go, to its end.
        start_s: When to set off.
        speed_mps: Walking pace.
        crosswalk: Which one the path takes, if any.
        kerb_m: Arc length where the path steps onto the road.
        forward: Whether it takes the crosswalk from its path's first end.
        at_m: Arc length now.
        is_walking: Whether the walker moves now.
        trace_m: Arc length at each step so far.
    """

    path_m: FloatArray
    start_s: float
    speed_mps: float
    style: int
    height_m: float
    crosswalk: int | None = None
    kerb_m: float = 0.0
    road_m: float = 0.0
    forward: bool = True
    at_m: float = 0.0
    is_walking: bool = False
    trace_m: list[float] = field(default_factory=list)

    length_m: float = field(init=False)

    def __post_init__(self) -> None:
        self._s_m = arc_lengths(self.path_m)
        self._sides_m = np.diff(self.path_m, axis=0)
        self.length_m = float(self._s_m[-1])

    def size_m(self) -> FloatArray:
        """[3] length, width, height of the box."""
        return np.array([WALKER_M, WALKER_M, self.height_m])

    def pose(self, at_m: FloatArray) -> tuple[FloatArray, FloatArray]:
        """([T, 2] points, [T] headings) at [T] arc lengths, in the town's frame."""
        xy_m, along_m = self.points(at_m)
        return xy_m, direction_of(along_m)

    def points(self, at_m: FloatArray) -> tuple[FloatArray, FloatArray]:
        """([T, 2] points, [T, 2] the sides of the path that they lie on) at [T] arc lengths."""
        s_m = self._s_m
        xy_m = np.stack([np.interp(at_m, s_m, self.path_m[:, i]) for i in (0, 1)], axis=1)
        side = np.clip(np.searchsorted(s_m, at_m, side="right") - 1, 0, len(s_m) - 2)
        return xy_m, self._sides_m[side]


def crosswalk_signals(town: Town) -> dict[int, int]:
    """Which crosswalks lie behind which light's stop line."""
    return {
        crosswalk: lane.signal
        for lane in town.lanes
        if lane.signal is not None and lane.stop_at_m is not None
        for crosswalk, at_m in lane.crosswalks
        if at_m > lane.stop_at_m
    }


def send_walkers(
    town: Town, plan: SignalPlan, start_s: float, end_s: float, rng: np.random.Generator
) -> list[Walker]:
    """Draw everybody who will be about between two times."""
    signal_of = crosswalk_signals(town)
    at_intersection = {
        c
        for lane in town.lanes
        for c, at_m in lane.crosswalks
        if lane.turn is None and at_m > arc_lengths(lane.centreline_m)[-1] - 8.0
    }
    inner = town.pavement.buffer(-PAVEMENT_EDGE_M, quad_segs=2)
    shapely.prepare(inner)
    walkers: list[Walker] = []
    for c in range(len(town.crosswalks)):
        arrivals: list[float] = []
        if c in signal_of:
            cycle_s = plan.cycle_s()[signal_of[c]]
            red_s = plan.shift_s[signal_of[c]] + plan.green_s[signal_of[c]] + AMBER_S
            red_s -= np.ceil((red_s - start_s) / cycle_s) * cycle_s
            for k in range(int((end_s - start_s) / cycle_s) + 2):
                if rng.random() < CROSSINGS_PER_RED:
                    arrivals.append(red_s + k * cycle_s + rng.uniform(-4.0, 2.5))
        else:
            rate = CROSSINGS_UNSIGNALLED if c in at_intersection else CROSSINGS_MIDWAY
            mean = rate * (end_s - start_s) / 40.0
            arrivals += list(rng.uniform(start_s, end_s, size=int(rng.poisson(mean))))
        for arrival_s in arrivals:
            forward = bool(rng.random() < 0.5)
            for _ in range(int(rng.choice([1, 1, 2, 3]))):
                walkers.append(_send_across(town, inner, c, float(arrival_s), forward, rng))
    walkers += _strollers(town, inner, start_s, end_s, rng)
    return walkers


def _send_across(
    town: Town,
    inner: shapely.Geometry,
    crosswalk: int,
    arrival_s: float,
    forward: bool,
    rng: np.random.Generator,
) -> Walker:
    near, far = town.crosswalks[crosswalk].path_m[:: 1 if forward else -1]
    across = (far - near) / np.hypot(*(far - near))
    along = np.array([-across[1], across[0]])
    aside = along * rng.uniform(-0.9, 0.9)
    ends = []
    for kerb, out in ((near, -across), (far, across)):
        corner = kerb + out * rng.uniform(0.9, 2.0) + aside
        away = [corner + along * rng.choice([-1, 1]) * rng.uniform(4.0, 14.0) for _ in range(6)]
        good = [p for p in away if shapely.contains(inner, shapely.LineString([corner, p]))]
        ends.append([corner, good[0] if good else corner + out * 0.3])
    path = np.stack([ends[0][1], ends[0][0], near + aside, far + aside, ends[1][0], ends[1][1]])
    lengths_m = arc_lengths(path)
    pace_mps = float(rng.uniform(1.3, 1.85))
    return Walker(
        path_m=path,
        start_s=arrival_s - (lengths_m[2] - KERB_ROOM_M) / pace_mps,
        speed_mps=pace_mps,
        style=int(rng.integers(1 << 16)),
        height_m=float(rng.uniform(1.6, 1.9)),
        crosswalk=crosswalk,
        kerb_m=float(lengths_m[2]),
        road_m=float(lengths_m[3] - lengths_m[2]),
        forward=forward,
    )


def _strollers(
    town: Town, inner: shapely.Geometry, start_s: float, end_s: float, rng: np.random.Generator
) -> list[Walker]:
    """A few people who walk beside the road and never step onto it."""
    walkers = []
    outer = [lane for lane in town.lanes if lane.turn is None and lane.right_lane is None]
    for lane in outer:
        for _ in range(int(rng.poisson(0.5))):
            length_m = arc_lengths(lane.centreline_m)[-1]
            pace_mps = float(rng.uniform(1.1, 1.6))
            span_m = min(pace_mps * (end_s - start_s), 0.7 * length_m)
            first_m = rng.uniform(0.1 * length_m, 0.95 * length_m - span_m)
            ticks_m = np.linspace(first_m, first_m + span_m, 12)
            extra_m = rng.uniform(0.0, 0.8)
            backward = bool(rng.random() < 0.5)
            style, height_m = int(rng.integers(1 << 16)), float(rng.uniform(1.6, 1.9))
            for offset_m in np.arange(lane.width_m / 2 + 1.4, lane.width_m / 2 + 5.0, 0.3):
                points = []
                for at_m in ticks_m:
                    point, along = point_at(lane.centreline_m, float(at_m))
                    right = np.array([along[1], -along[0]])
                    points.append(point + right * (offset_m + extra_m))
                path = np.stack(points)[:: -1 if backward else 1]
                if shapely.contains(inner, shapely.LineString(path)):
                    walkers.append(Walker(path, start_s, pace_mps, style, height_m))
                    break
    return walkers


class Pavements:
    """All walkers of a scene, step by step."""

    def __init__(self, town: Town, plan: SignalPlan, walkers: list[Walker]) -> None:
        self.walkers = walkers
        self._plan = plan
        self._signal_of = crosswalk_signals(town)
        self._by_crosswalk: dict[int, list[Walker]] = {}
        for walker in walkers:
            if walker.crosswalk is not None:
                self._by_crosswalk.setdefault(walker.crosswalk, []).append(walker)
        self._lane_at: dict[tuple[int, int], float] = {}
        for lane in town.lanes:
            for c, at_m in lane.crosswalks:
                start, end = town.crosswalks[c].path_m
                across = (end - start) / np.hypot(*(end - start))
                point, _ = point_at(lane.centreline_m, at_m + 1.5)
                self._lane_at[lane.lane_id, c] = float((point - start) @ across)
        self._may_walk: dict[int, bool] = {}
        # Cars wait for people; an ego that goes where it wants may not: they look out for it.
        self.ego: EgoBody | None = None

    def copy(self) -> "Pavements":
        """The same people once more, without their past."""
        there = copy(self)
        twin = {walker: copy(walker) for walker in self.walkers}
        for walker in twin.values():
            walker.trace_m = walker.trace_m[-1:]
        there.walkers = list(twin.values())
        there._by_crosswalk = {c: [twin[w] for w in on] for c, on in self._by_crosswalk.items()}
        there._may_walk = dict(self._may_walk)
        return there

    def adopt(self, other: "Pavements") -> None:
        """Put everybody to where they are in another run."""
        for walker, theirs in zip(self.walkers, other.walkers, strict=True):
            walker.at_m, walker.is_walking = theirs.at_m, theirs.is_walking

    def is_blocked(self, lane: int, crosswalk: int) -> bool:
        """Whether somebody on (or about to step onto) a crosswalk has yet to clear a lane."""
        for walker in self._by_crosswalk.get(crosswalk, ()):
            u_m = walker.at_m - walker.kerb_m
            if u_m < -KERB_ROOM_M - STEPPING_M or (u_m < 0.0 and not self._may_walk[crosswalk]):
                continue
            if u_m < -KERB_ROOM_M - 0.1 and not walker.is_walking:
                continue
            lane_m = self._lane_at[lane, crosswalk]
            if not walker.forward:
                lane_m = walker.road_m - lane_m
            if u_m < lane_m + CLEAR_OF_LANE_M:
                return True
        return False

    def step(self, time_s: float, dt_s: float, is_safe: dict[int, bool]) -> None:
        """Walk on for one step.

        Args:
            time_s: Now.
            dt_s: Length of the step.
            is_safe: Per crosswalk with cars near whether all of them will stop.
        """
        states = self._plan.states(time_s)
        red_s = self._plan.cycle_s() - self._plan.green_s - AMBER_S
        into_red_s = red_s - self._plan.until_green_s(time_s)
        for c in self._by_crosswalk:
            light = self._signal_of.get(c)
            self._may_walk[c] = light is None or bool(
                states[light] == RED and into_red_s[light] < WALK_S
            )
        for walker in self.walkers:
            walker.trace_m.append(walker.at_m)
            walker.is_walking = False
            if time_s < walker.start_s or walker.at_m >= walker.length_m:
                continue
            own = walker.crosswalk
            waits_m = walker.kerb_m - KERB_ROOM_M
            at_m = walker.at_m
            if own is not None and waits_m - 1e-6 <= at_m < walker.kerb_m:
                if not (self._may_walk[own] and is_safe.get(own, True)):
                    continue
                at_m = walker.kerb_m  # one lively first step, then no way back
            ahead_m = at_m + walker.speed_mps * dt_s
            stop_m = walker.length_m
            if own is not None and at_m < waits_m - 1e-6:
                stop_m = waits_m
            to_m = min(ahead_m, stop_m)
            if self.ego is not None and _is_barred(walker, to_m, self.ego):
                continue
            walker.is_walking = True
            walker.at_m = to_m


def _is_barred(walker: Walker, to_m: float, ego: EgoBody) -> bool:
    if np.hypot(*(walker.path_m[0] - ego.xy_m)) > walker.length_m + EGO_MATTERS_M:
        return False
    (before_m, after_m), _ = walker.points(np.array([walker.at_m, to_m]))
    return bars_way(ego, before_m, after_m)
