"""Which lanes a route allows: its own, and those beside them that lead the same way."""

from collections.abc import Iterable, Sequence
from typing import Literal

import shapely

from shoot.world.town.town import Lane, Town


def lanes_of_route(town: Town, route_lanes: Sequence[int], places: Iterable[int]) -> set[int]:
    """Lanes and paths at some places of a route, their neighbours in the same direction included.

    Beside a path across an intersection these are the paths that join the neighbours of the lanes
    before and after it.

    Args:
        town: Where.
        route_lanes: Lanes and paths of the route, in order.
        places: Which of them.
    """
    lanes: set[int] = set()
    for place in places:
        lane = town.lanes[route_lanes[place]]
        lanes |= beside(lane)
        if lane.turn is not None and 0 < place < len(route_lanes) - 1:
            onto = beside(town.lanes[route_lanes[place + 1]])
            for source in beside(town.lanes[route_lanes[place - 1]]):
                paths = town.lanes[source].successors
                lanes |= {path for path in paths if onto & set(town.lanes[path].successors)}
    return lanes


def beside(lane: Lane) -> set[int]:
    """A lane and its neighbours in the same direction."""
    return {i for i in (lane.lane_id, lane.left_lane, lane.right_lane) if i is not None}


def ground_of(
    town: Town, lanes: Iterable[int], ends: Literal["square", "flat"] = "square"
) -> shapely.Geometry:
    """The ground of some lanes, by their widths.

    Args:
        town: Where.
        lanes: Which.
        ends: How strips end, as shapely names it; `square` reaches half a width beyond.
    """
    return shapely.union_all([
        shapely.LineString(town.lanes[i].centreline_m).buffer(
            town.lanes[i].width_m / 2, cap_style=ends
        )
        for i in sorted(lanes)
    ])  # fmt: skip
