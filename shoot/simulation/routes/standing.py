"""What stands in a town and can be hit: parked cars, houses, trees, posts."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from lss_core.geometry import FloatArray, direction_of
from shoot.metrics.driving_score.tracks import Kind
from shoot.world.town.town import Building, Town

# Of trees the trunk alone is in the way.
TRUNK_RADIUS_M, POLE_RADIUS_M = 0.17, 0.1


@dataclass(frozen=True)
class StandingThing:
    """A rectangle on the ground.

    Attributes:
        name: In words.
        kind: As scores name it.
        xy_m: [2] middle, in the town's frame.
        yaw_rad: Direction of its length.
        size_m: [2] length and width.
    """

    name: str
    kind: Kind
    xy_m: FloatArray
    yaw_rad: float
    size_m: FloatArray


def standing_things(town: Town) -> Iterator[StandingThing]:
    """All of a town, in an order that is always the same."""
    for car in town.parked_cars:
        yield StandingThing("parked car", "car", car.xy_m, car.yaw_rad, car.size_m[:2])
    for building in town.buildings:
        yield _house(building)
    for prop in town.props:
        radius_m = TRUNK_RADIUS_M if prop.kind == "tree" else prop.radius_m
        yield _round(prop.kind.replace("_", " "), prop.xy_m, radius_m)
    for signal in town.signals:
        for foot_m in signal.pole_feet_m:
            yield _round("traffic light", foot_m, POLE_RADIUS_M)


def _house(building: Building) -> StandingThing:
    corners_m = building.outline_m
    along_m, across_m = corners_m[1] - corners_m[0], corners_m[2] - corners_m[1]
    size_m = np.array([np.hypot(*along_m), np.hypot(*across_m)])
    yaw_rad = float(direction_of(along_m))
    return StandingThing("building", "object", corners_m.mean(axis=0), yaw_rad, size_m)


def _round(name: str, xy_m: FloatArray, radius_m: float) -> StandingThing:
    """The square around a circle."""
    return StandingThing(name, "object", xy_m, 0.0, np.full(2, 2.0 * radius_m))
