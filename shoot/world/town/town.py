"""What stands still: lanes, crosswalks, signals, buildings and everything else of a town.

All coordinates are metres in the town's own frame (x east, y north, z up, origin at its lower left
corner); `writer` shifts them to where the town lies on its nuScenes map. Traffic drives on the
right.
"""

from dataclasses import dataclass
from typing import Literal

import numpy as np
import shapely
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class Lane:
    """One driving lane, or one path across an intersection (then `turn` says which way).

    Attributes:
        lane_id: Its place in `Town.lanes`.
        centreline_m: [P, 2] points in driving direction, at most 1 m apart.
        width_m: Lane width.
        limit_mps: Speed an unhindered driver takes on it; what tells it apart is visible (width,
            lines).
        successors: Lanes that begin where this one ends.
        left_lane, right_lane: Neighbours in the same direction, if any.
        turn: `None` on a road; else how the path crosses its intersection.
        intersection: Which of `Town.intersections` it crosses (paths) or leads to (lanes).
        signal: Index into `Town.signals` of the lights at its end, if any.
        stop_at_m: Arc length of the stop line near its end, if it has one (lights, stop sign).
        crosswalks: (index into `Town.crosswalks`, arc length of its near edge on this lane).
    """

    lane_id: int
    centreline_m: FloatArray
    width_m: float
    limit_mps: float
    successors: tuple[int, ...] = ()
    left_lane: int | None = None
    right_lane: int | None = None
    turn: Literal["straight", "left", "right"] | None = None
    intersection: int | None = None
    signal: int | None = None
    stop_at_m: float | None = None
    crosswalks: tuple[tuple[int, float], ...] = ()


@dataclass(frozen=True)
class Crosswalk:
    """Painted crossing; people walk along `path_m`.

    Attributes:
        outline_m: [4, 2] corners.
        path_m: [2, 2] kerb to kerb.
    """

    outline_m: FloatArray
    path_m: FloatArray


@dataclass(frozen=True)
class Signal:
    """Traffic lights of one approach: one or more heads that always show the same colour.

    Attributes:
        heads_m: [H, 3] centres of the middle (amber) lamp; red hangs above it, green below.
        facing_rad: Direction the lamps shine, towards the drivers they are for.
        pole_feet_m: [H, 2] where each head's pole stands.
        phase: Lights of one intersection with equal phase are green together.
    """

    heads_m: FloatArray
    facing_rad: float
    pole_feet_m: FloatArray
    phase: int


@dataclass(frozen=True)
class Intersection:
    """Where roads meet.

    Attributes:
        outline_m: [P, 2] polygon of its surface.
        num_arms: 3 or 4.
        is_signalled: Whether lights rule it.
    """

    outline_m: FloatArray
    num_arms: int
    is_signalled: bool


@dataclass(frozen=True)
class RoadLine:
    """Paint along a road.

    Attributes:
        points_m: [P, 2].
        kind: `edge` (solid white), `lane` (dashed white, same direction), `centre` (yellow,
            opposite directions, solid double where two lanes a side, else dashed), `stop` (thick
            white bar).
    """

    points_m: FloatArray
    kind: Literal["edge", "lane", "centre", "stop"]


@dataclass(frozen=True)
class Building:
    """A box with windows.

    Attributes:
        outline_m: [4, 2] corners, counter-clockwise.
        height_m: Roof height.
        style: Any integer; picks colour and windows.
    """

    outline_m: FloatArray
    height_m: float
    style: int


@dataclass(frozen=True)
class Prop:
    """Something upright beside the road.

    Attributes:
        kind: What it is.
        xy_m: [2] where it stands.
        height_m: Its top.
        radius_m: Of the crown (tree) or the whole (others).
        style: Any integer; picks the colour.
    """

    kind: Literal["tree", "lamp_post", "bin", "bush"]
    xy_m: FloatArray
    height_m: float
    radius_m: float
    style: int = 0


@dataclass(frozen=True)
class ParkedCar:
    """A car that never moves.

    Attributes:
        xy_m: [2] centre of its box.
        yaw_rad: Heading.
        size_m: [3] length, width, height.
        style: Any integer; picks the colour.
    """

    xy_m: FloatArray
    yaw_rad: float
    size_m: FloatArray
    style: int


@dataclass(frozen=True, eq=False)  # compared by identity, so that what follows from it can be kept
class Town:
    """Everything that does not move.

    Attributes:
        seed: What it was grown from.
        size_m: Side of the square it lies in.
        road: Carriageway, intersections included.
        pavement: Raised walkways beside it (disjoint from `road`).
        parking: Strips of the carriageway where cars park (part of `road`).
    """

    seed: int
    size_m: float
    lanes: tuple[Lane, ...]
    intersections: tuple[Intersection, ...]
    crosswalks: tuple[Crosswalk, ...]
    signals: tuple[Signal, ...]
    lines: tuple[RoadLine, ...]
    road: shapely.MultiPolygon
    pavement: shapely.MultiPolygon
    parking: shapely.MultiPolygon
    buildings: tuple[Building, ...]
    props: tuple[Prop, ...]
    parked_cars: tuple[ParkedCar, ...]
