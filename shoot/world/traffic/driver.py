"""How everybody drives: a route, the speed it allows, and what makes one slow down.

The law is the same for all and a function of what can be seen from the car: the kind of road, bends
and turns ahead, the distance to a line to stop at, the gap to the car in front.
"""

from dataclasses import dataclass

import numpy as np

from lss_core.geometry import direction_of
from shoot.world.town.curves import arc_lengths
from shoot.world.town.town import FloatArray, Lane, Town

ROUTE_STEP_M = 0.5
ACCEL_MPS2 = 2.4
BRAKE_MPS2 = 2.4
HARD_BRAKE_MPS2 = 3.0
LATERAL_MPS2 = 2.0
TURN_LATERAL_MPS2 = 2.6
TIME_GAP_S = 1.3
STANDING_GAP_M = 2.5


@dataclass(frozen=True)
class Route:
    """A path through the town, as long as anybody could need.

    Attributes:
        lanes: Lanes and paths in order.
        starts_m: Arc length where each begins, and where the last one ends.
        xy_m: [Q, 2] every `ROUTE_STEP_M`.
        yaw_rad: [Q] heading, continuous.
        cap_mps: [Q] speed that limits and bends allow, with room to brake for what comes.
        pace: Factor on all speeds, near 1.
    """

    lanes: tuple[int, ...]
    starts_m: tuple[float, ...]
    xy_m: FloatArray
    yaw_rad: FloatArray
    cap_mps: FloatArray
    pace: float

    def pose(self, at_m: FloatArray) -> tuple[FloatArray, FloatArray]:
        """([T, 2] points, [T] headings) at [T] arc lengths."""
        s_m = np.arange(len(self.xy_m)) * ROUTE_STEP_M
        xy_m = np.stack([np.interp(at_m, s_m, self.xy_m[:, i]) for i in (0, 1)], axis=-1)
        return xy_m, np.interp(at_m, s_m, self.yaw_rad)


def plan_route(
    town: Town, first_lane: int, length_m: float, pace: float, rng: np.random.Generator
) -> Route:
    """Drive off along `first_lane` and take any way on at each intersection, all equally likely.

    Args:
        town: Where.
        first_lane: Index into `town.lanes`.
        length_m: The route is at least so long.
        pace: Factor on all speeds, near 1.
        rng: Source of chance.
    """
    lanes = [first_lane]
    so_far_m = float(arc_lengths(town.lanes[first_lane].centreline_m)[-1])
    while so_far_m < length_m:
        onward = town.lanes[lanes[-1]].successors
        lanes.append(int(onward[rng.integers(len(onward))]))
        so_far_m += float(arc_lengths(town.lanes[lanes[-1]].centreline_m)[-1])
    return follow_lanes([town.lanes[i] for i in lanes], pace)


def follow_lanes(lanes: list[Lane], pace: float) -> Route:
    """The route along lanes that lead from one into the next.

    Args:
        lanes: In order.
        pace: Factor on all speeds, near 1.
    """
    lengths_m = np.array([float(arc_lengths(lane.centreline_m)[-1]) for lane in lanes])
    joined = np.concatenate(
        [lane.centreline_m[min(i, 1) :] for i, lane in enumerate(lanes)]
    )  # fmt: skip
    s_m = arc_lengths(joined)
    starts_m = np.concatenate([[0.0], np.cumsum(lengths_m)])
    at_m = np.arange(0.0, s_m[-1], ROUTE_STEP_M)
    xy_m = np.stack([np.interp(at_m, s_m, joined[:, i]) for i in (0, 1)], axis=1)
    tangents = np.gradient(xy_m, axis=0)
    yaw_rad = np.unwrap(direction_of(tangents))
    # Half-metre chords make curvature ragged; 2 m is what a driver feels.
    box = np.ones(5) / 5
    curvature = np.abs(np.convolve(np.gradient(yaw_rad, ROUTE_STEP_M), box, mode="same"))
    which = np.clip(np.searchsorted(starts_m, at_m, side="right") - 1, 0, len(lanes) - 1)
    limit_mps = np.array([lane.limit_mps for lane in lanes])[which]
    is_turn = np.array([lane.turn is not None for lane in lanes])[which]
    lateral_mps2 = np.where(is_turn, TURN_LATERAL_MPS2, LATERAL_MPS2)
    cap_mps = pace * np.minimum(limit_mps, np.sqrt(lateral_mps2 / np.maximum(curvature, 1e-3)))
    # v^2 + 2 b s may nowhere exceed its value further on: braking at b is always enough.
    energy = cap_mps**2 + 2 * BRAKE_MPS2 * at_m
    reachable = np.minimum.accumulate(energy[::-1])[::-1] - 2 * BRAKE_MPS2 * at_m
    return Route(
        tuple(lane.lane_id for lane in lanes),
        tuple(starts_m.tolist()),
        xy_m,
        yaw_rad,
        np.sqrt(np.maximum(reachable, 0.25)),
        pace,
    )


def follow_accel(speed_mps: float, gap_m: float, lead_mps: float) -> float:
    """Acceleration behind a car: the interaction term of the intelligent driver model.

    Args:
        speed_mps: Own speed.
        gap_m: Bumper to bumper.
        lead_mps: Speed of the car in front.

    Returns:
        In m/s^2; `ACCEL_MPS2` with nobody near.
    """
    closing = speed_mps * (speed_mps - lead_mps) / (2 * (ACCEL_MPS2 * BRAKE_MPS2) ** 0.5)
    wished_m = STANDING_GAP_M + max(0.0, TIME_GAP_S * speed_mps + closing)
    return float(ACCEL_MPS2 * (1.0 - (wished_m / max(gap_m, 0.1)) ** 2))


def stop_accel(speed_mps: float, room_m: float) -> float:
    """Acceleration before a line to stop at: none until braking at `BRAKE_MPS2` just suffices.

    Args:
        speed_mps: Own speed.
        room_m: From the front bumper to the line.

    Returns:
        In m/s^2, infinite while the line is no concern.
    """
    if room_m <= 0.05:
        return -max(speed_mps, 1.0) * 10.0
    needed = speed_mps**2 / (2 * room_m)
    if needed >= 0.9 * BRAKE_MPS2:
        return -needed
    # Creep up to the line from close by rather than leap at it.
    return float((2 * 0.8 * BRAKE_MPS2 * room_m) ** 0.5 - speed_mps) / 0.4


def can_stop(speed_mps: float, room_m: float, brake_mps2: float = HARD_BRAKE_MPS2) -> bool:
    """Whether one comes to rest within `room_m` at `brake_mps2`."""
    return bool(room_m > 0.0 and speed_mps**2 <= 2 * brake_mps2 * room_m)
