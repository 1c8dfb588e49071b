"""The plan of a town: which places are joined by roads of which kind, and how each road runs."""

from dataclasses import dataclass, replace

import numpy as np

from shoot.world.town.curves import round_corners
from shoot.world.town.town import FloatArray

GRID_NODES = 4
GRID_GAP_M = (84.0, 104.0)
MAX_CHAIN = 4  # places on one road; longer ones would leave a town with few intersections
MARGIN_M = 42.0
JITTER_M = 6.0
# A stop line lies some 5 m before the mouth; the last 15 m before it are straight.
STRAIGHT_APPROACH_M = 16.0

Node = tuple[int, int]


@dataclass(frozen=True)
class RoadKind:
    """What a road looks like, and with it how fast one drives there.

    Attributes:
        lanes: Lanes in each direction.
        lane_m: Width of one.
        shoulder_m: Asphalt beyond the outer lane.
        limit_mps: Speed an unhindered driver takes.
    """

    name: str
    lanes: int
    lane_m: float
    shoulder_m: float
    limit_mps: float

    @property
    def half_m(self) -> float:
        """From the middle of the road to its kerb, parking aside."""
        return self.lanes * self.lane_m + self.shoulder_m


NARROW = RoadKind("narrow", 1, 2.9, 0.3, 6.5)
NORMAL = RoadKind("normal", 1, 3.8, 0.5, 9.5)
WIDE = RoadKind("wide", 2, 3.6, 0.5, 13.0)
# Within a kind, too, one drives as fast as the road is wide: speed is to be read off the road, and
# not only from which of three kinds it is.
LANE_SPREAD_M = 0.45
SPEED_PER_WIDTH_PER_S = 3.3


def draw_road_kind(kind: RoadKind, rng: np.random.Generator) -> RoadKind:
    """A road of this kind: lanes a little wider or narrower, and the speed that goes with them."""
    extra_m = float(rng.uniform(-LANE_SPREAD_M, LANE_SPREAD_M))
    return replace(
        kind,
        lane_m=kind.lane_m + extra_m,
        limit_mps=kind.limit_mps + SPEED_PER_WIDTH_PER_S * extra_m,
    )


@dataclass(frozen=True)
class Arm:
    """One mouth of a road at an intersection.

    Attributes:
        road: Index into `Plan.roads`.
        at_start: Whether it is the road's first or last point.
        outward: [2] unit direction away from the intersection.
        trim_m: From the intersection's middle to where the road's lanes begin or end.
        axis: Arms with equal axis lie opposite each other (0: west-east, 1: south-north).
    """

    road: int
    at_start: bool
    outward: FloatArray
    trim_m: float
    axis: int


@dataclass(frozen=True)
class PlannedRoad:
    """A road between two intersections.

    Attributes:
        kind: Its class.
        middle_m: [P, 2] from the middle of one intersection to that of the next.
        trims_m: Length at either end that belongs to the intersections.
    """

    kind: RoadKind
    middle_m: FloatArray
    trims_m: tuple[float, float]


@dataclass(frozen=True)
class Plan:
    """Roads, and per intersection its middle and its arms, counter-clockwise."""

    size_m: float
    roads: tuple[PlannedRoad, ...]
    middles_m: tuple[FloatArray, ...]
    arms: tuple[tuple[Arm, ...], ...]


def plan_town(rng: np.random.Generator) -> Plan:
    """A jittered grid without dead ends, some edges taken out; straight and bent roads."""
    while True:
        plan = _try_plan(rng)
        if plan is not None:
            return plan


def _try_plan(rng: np.random.Generator) -> Plan | None:
    gaps_m = rng.uniform(*GRID_GAP_M, size=(2, GRID_NODES - 1))
    ticks_m = np.concatenate([np.zeros((2, 1)), np.cumsum(gaps_m, axis=1)], axis=1)
    size_m = float(ticks_m.max()) + 2 * MARGIN_M
    ticks_m += (size_m - ticks_m[:, -1:]) / 2
    nodes = [(i, j) for i in range(GRID_NODES) for j in range(GRID_NODES)]
    place = {
        (i, j): np.array([ticks_m[0, i], ticks_m[1, j]]) + rng.uniform(-JITTER_M, JITTER_M, 2)
        for i, j in nodes
    }
    edges = [
        (a, b) for a in nodes for b in ((a[0] + 1, a[1]), (a[0], a[1] + 1)) if b in place
    ]  # fmt: skip
    wide = _wide_edges(edges, rng)
    edges = _remove_edges(edges, wide, rng)
    joined = {n: [b if a == n else a for a, b in edges if n in (a, b)] for n in nodes}
    crossings = [n for n in nodes if len(joined[n]) >= 3]

    chains: list[list[Node]] = []
    for first in crossings:
        for second in joined[first]:
            chain = [first, second]
            while len(joined[chain[-1]]) == 2:
                onward = [n for n in joined[chain[-1]] if n != chain[-2]]
                chain.append(onward[0])
            if chain[0] == chain[-1] or len(chain) > MAX_CHAIN:
                return None
            if chain[0] < chain[-1]:
                chains.append(chain)
    kinds = [
        draw_road_kind(
            WIDE
            if (min(c[:2]), max(c[:2])) in wide
            else (NARROW if rng.random() < 0.2 else NORMAL),
            rng,
        )
        for c in chains
    ]

    outward: dict[tuple[int, bool], FloatArray] = {}
    for r, (chain, kind) in enumerate(zip(chains, kinds, strict=True)):
        bend_rad = 0.0 if kind.lanes > 1 or rng.random() < 0.35 else np.deg2rad(rng.uniform(5, 11))
        sides = rng.choice([-1, 1], size=2)
        for at_start, line in ((True, chain[:2]), (False, chain[:-3:-1])):
            direct = place[line[1]] - place[line[0]]
            angle = np.arctan2(direct[1], direct[0]) + bend_rad * sides[int(at_start)]
            outward[r, at_start] = np.array([np.cos(angle), np.sin(angle)])

    arms: list[tuple[Arm, ...]] = []
    for node in crossings:
        mouths: list[tuple[float, int, bool, int]] = []
        for r, chain in enumerate(chains):
            for at_start, line in ((True, chain[:2]), (False, chain[:-3:-1])):
                if line[0] == node:
                    away = outward[r, at_start]
                    axis = 0 if line[1][1] == node[1] else 1
                    mouths.append((float(np.arctan2(away[1], away[0])), r, at_start, axis))
        mouths.sort()
        placed = []
        for k, (angle, r, at_start, axis) in enumerate(mouths):
            trim_m = 0.0
            for other_angle, other, _, _ in (mouths[k - 1], mouths[(k + 1) % len(mouths)]):
                between = abs((other_angle - angle + np.pi) % (2 * np.pi) - np.pi)
                if between < np.deg2rad(58):
                    return None
                if between < np.deg2rad(135):
                    reach_m = kinds[other].half_m + kinds[r].half_m * np.cos(between)
                    trim_m = max(trim_m, reach_m / np.sin(between) + 5.0)
            placed.append(Arm(r, at_start, outward[r, at_start], max(trim_m, 8.0), axis))
        arms.append(tuple(placed))

    trims = {(a.road, a.at_start): a.trim_m for placed_arms in arms for a in placed_arms}
    roads = []
    for r, (chain, kind) in enumerate(zip(chains, kinds, strict=True)):
        inner = [place[n] for n in chain[1:-1]]
        stubs = [
            place[n] + outward[r, at_start] * (trims[r, at_start] + STRAIGHT_APPROACH_M)
            for n, at_start in ((chain[0], True), (chain[-1], False))
        ]
        polygon = np.stack([place[chain[0]], stubs[0], *inner, stubs[1], place[chain[-1]]])
        forward = np.diff(polygon, axis=0)
        if np.any(np.sum(forward[1:] * forward[:-1], axis=1) < -1e-9) or np.any(
            np.hypot(*forward.T) < 6.0
        ):
            return None
        bends = rng.uniform(14.0, 32.0, size=len(inner)) + (8.0 if kind.lanes > 1 else 0.0)
        radii = np.concatenate([[90.0], bends, [90.0]])
        straight_m = STRAIGHT_APPROACH_M - 4.0
        keep_m = (trims[r, True] + straight_m, trims[r, False] + straight_m)
        middle = round_corners(polygon, radii, keep_m)
        roads.append(PlannedRoad(kind, middle, (trims[r, True], trims[r, False])))
    return Plan(size_m, tuple(roads), tuple(place[n] for n in crossings), tuple(arms))


def _wide_edges(edges: list[tuple[Node, Node]], rng: np.random.Generator) -> set[tuple[Node, Node]]:
    """One or two whole lines of the grid become wide roads."""
    lines = [(0, 1), (0, 2), (1, 1), (1, 2)]
    rng.shuffle(lines)
    chosen = lines[: 1 if rng.random() < 0.2 else 2]
    return {
        (a, b) for a, b in edges for axis, at in chosen if a[axis] == at and b[axis] == at
    }  # fmt: skip


def _remove_edges(
    edges: list[tuple[Node, Node]], keep: set[tuple[Node, Node]], rng: np.random.Generator
) -> list[tuple[Node, Node]]:
    """Take out a few inner edges; every place keeps two at least and all stay connected."""
    edges = list(edges)
    wanted = int(rng.integers(1, 4))
    rim = (0, GRID_NODES - 1)
    candidates = [
        (a, b)
        for a, b in edges
        if (a, b) not in keep and not any(a[i] == b[i] and a[i] in rim for i in (0, 1))
    ]
    for i in rng.permutation(len(candidates)):
        rest = [e for e in edges if e != candidates[i]]
        degree: dict[Node, int] = {}
        for a, b in rest:
            degree[a], degree[b] = degree.get(a, 0) + 1, degree.get(b, 0) + 1
        if min(degree.values()) >= 2 and _connected(rest):
            edges, wanted = rest, wanted - 1
        if wanted == 0:
            break
    return edges


def _connected(edges: list[tuple[Node, Node]]) -> bool:
    seen = {edges[0][0]}
    while True:
        more = {n for e in edges if seen & set(e) for n in e} - seen
        if not more:
            return len(seen) == len({n for e in edges for n in e})
        seen |= more
