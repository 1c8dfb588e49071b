"""What stands still around the ego: road, lanes, route and lights; and where in it the ego is."""

from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
import shapely
from jaxtyping import Bool, Float

from shoot.metrics.driving_score.tracks import Track

Array = np.ndarray[Any, np.dtype[Any]]


@dataclass(frozen=True, eq=False)
class Lanes:
    """Lanes, those that lead across intersections included.

    Attributes:
        centrelines_m: [P, 2] points each, in the direction of traffic.
        widths_m: One each.
        is_on_route: Those that the ego may use on its way, neighbours in the same direction
            included.
    """

    centrelines_m: tuple[Float[Array, "_ 2"], ...]
    widths_m: Float[Array, " L"]
    is_on_route: Bool[Array, " L"]

    def __post_init__(self) -> None:
        got = len(self.centrelines_m), len(self.widths_m), len(self.is_on_route)
        if len(set(got)) > 1:
            raise ValueError(
                f"Each lane must have a centre line, a width and a word on the route, got {got}."
            )

    @cached_property
    def lines(self) -> Array:
        """[L] centre lines as shapely has them."""
        lines = np.empty(len(self.centrelines_m), dtype=object)
        lines[:] = [shapely.LineString(line) for line in self.centrelines_m]
        return lines

    @cached_property
    def polygons(self) -> Array:
        """[L] the ground of each lane; it ends where its centre line does."""
        polygons: Array = shapely.buffer(self.lines, self.widths_m / 2, cap_style="flat")
        return polygons

    def direction(self, lane: Array, points_m: Float[Array, "N 2"]) -> Float[Array, "N 2"]:
        """Direction of traffic (not of unit length) of lane n beside point n."""
        lines = self.lines[lane]
        along_m = shapely.line_locate_point(lines, shapely.points(points_m))
        ends_m = [np.clip(along_m + step_m, 0.0, shapely.length(lines)) for step_m in (-0.5, 0.5)]
        before, after = (
            shapely.get_coordinates(shapely.line_interpolate_point(lines, end_m))
            for end_m in ends_m
        )
        direction: Array = after - before
        return direction


@dataclass(frozen=True, eq=False)
class Lights:
    """Lights that rule the route.

    Attributes:
        connectors: For each light, the ground of the lanes of the route that lie behind it and
            across the intersection (one geometry a light).
        is_red: At each step of the ego's track. Amber is not red.
    """

    connectors: tuple[shapely.Geometry, ...] = ()
    is_red: Bool[Array, "N T"] = field(default_factory=lambda: np.zeros((0, 0), dtype=bool))

    def __post_init__(self) -> None:
        if self.is_red.ndim != 2 or len(self.is_red) != len(self.connectors):
            raise ValueError(
                f"is_red must be [lights, steps] for {len(self.connectors)} connectors, got "
                f"{list(self.is_red.shape)}."
            )


@dataclass(frozen=True, eq=False)
class Surroundings:
    """All that stands still, in the frame of the ego's track.

    Attributes:
        drivable: Polygon, polygons, or a collection of them: where wheels may be.
        lanes: All around, also those of the other direction.
        route_m: Centre line of the lanes that the route leads along, in its direction. It begins
            at or before the ego's start, and reaches beyond where anyone could get.
        intersections: Grounds of intersections.
        lights: Those of the route.
    """

    drivable: shapely.Geometry
    lanes: Lanes
    route_m: Float[Array, "R 2"]
    intersections: tuple[shapely.Geometry, ...] = ()
    lights: Lights = field(default_factory=Lights)

    def __post_init__(self) -> None:
        if self.route_m.ndim != 2 or self.route_m.shape[1] != 2 or len(self.route_m) < 2:
            raise ValueError(
                f"The route must be two or more points [R, 2], got {list(self.route_m.shape)}."
            )

    @cached_property
    def route(self) -> shapely.LineString:
        """The route as shapely has it, prepared for many questions."""
        # Where lanes were joined a point may stand twice, and between the two is no direction.
        route = shapely.LineString(shapely.remove_repeated_points(shapely.LineString(self.route_m)))
        shapely.prepare(route)
        return route


@dataclass(frozen=True, eq=False)
class Whereabouts:
    """Where the ego is at each step.

    Attributes:
        off_road_m: How far its farthest corner is from drivable ground; 0 if all are on it.
        is_in_several_lanes: Two or more lanes have a corner, and none has all four.
        is_centre_in_lane: Lanes that the middle of the footprint is in.
        is_centre_in_intersection, is_axle_in_intersection: Middle of the footprint, rear axle.
    """

    off_road_m: Float[Array, " T"]
    is_in_several_lanes: Bool[Array, " T"]
    is_centre_in_lane: Bool[Array, "T L"]
    is_centre_in_intersection: Bool[Array, " T"]
    is_axle_in_intersection: Bool[Array, " T"]


def locate(ego: Track, around: Surroundings) -> Whereabouts:
    """Where the ego is at each step; what lies on an edge lies inside."""
    corners = shapely.points(ego.corners_m)
    shapely.prepare(around.drivable)
    lanes = around.lanes.polygons
    corner_in_lane = _within(ego.corners_m, lanes)
    num_corners = corner_in_lane.sum(axis=1)
    intersections = np.array(around.intersections, dtype=object)
    return Whereabouts(
        off_road_m=shapely.distance(around.drivable, corners).max(axis=1),
        is_in_several_lanes=((num_corners > 0).sum(axis=-1) > 1) & ~(num_corners == 4).any(axis=-1),
        is_centre_in_lane=_within(ego.centre_m, lanes),
        is_centre_in_intersection=_within(ego.centre_m, intersections).any(axis=-1),
        is_axle_in_intersection=_within(ego.xy_m, intersections).any(axis=-1),
    )


def _within(points_m: Float[Array, "*S 2"], polygons: Array) -> Bool[Array, "*S G"]:
    """Which of the polygons each point lies in or on the edge of."""
    points = np.asarray(shapely.points(points_m.reshape(-1, 2)))
    is_within = np.zeros((len(points), len(polygons)), dtype=np.bool_)
    pairs = shapely.STRtree(polygons).query(points, predicate="intersects")
    is_within[pairs[0], pairs[1]] = True
    return is_within.reshape(*points_m.shape[:-1], len(polygons))
