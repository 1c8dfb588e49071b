"""A town while it is built: its lanes so far, and the roads they belong to."""

from dataclasses import dataclass, field, replace

from shoot.world.town.curves import arc_lengths, cut, parallel, resample
from shoot.world.town.network import Arm, PlannedRoad
from shoot.world.town.town import Crosswalk, FloatArray, Intersection, Lane, RoadLine, Signal

LANE_STEP_M = 0.5


@dataclass(frozen=True)
class Road:
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
class Draft:
    """What has been built so far."""

    lanes: list[Lane] = field(default_factory=list)
    crosswalks: list[Crosswalk] = field(default_factory=list)
    signals: list[Signal] = field(default_factory=list)
    lines: list[RoadLine] = field(default_factory=list)
    intersections: list[Intersection] = field(default_factory=list)

    def change(self, lane: int, **what: object) -> None:
        """Set attributes of a lane."""
        self.lanes[lane] = replace(self.lanes[lane], **what)  # type: ignore[arg-type]


def lay_lanes(draft: Draft, plan: PlannedRoad) -> Road:
    """Add a road's lanes, without successors yet.

    Args:
        draft: Grows.
        plan: The road.
    """
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
    return Road(plan, middle_m, directions[0], directions[1])
