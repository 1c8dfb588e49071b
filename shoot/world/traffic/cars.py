"""Cars and trucks on their ways, and where they start."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from shoot.footprint import EGO_LENGTH_M, EGO_REAR_M, EGO_WIDTH_M
from shoot.world.town.curves import arc_lengths
from shoot.world.town.town import FloatArray, Lane, Town
from shoot.world.traffic.driver import Route, plan_route


@dataclass(eq=False)
class Car:
    """A car or truck on its way; positions are those of its rear axle along its route.

    Attributes:
        size_m: [3] length, width, height.
        rear_m: From its rear axle back to its rear bumper.
        front_m: From its rear axle ahead to its front bumper.
        place: Which lane of the route it is on.
        granted: Place of the last path in its route that it was granted.
        asked_s: Since when it has been asking for the next one.
        accel_mps2: What it does now.
        crossings: Crosswalks ahead: (arc length of the near edge, crosswalk, lane).
        trace: Per step so far: arc length, speed, acceleration, place.
    """

    route: Route
    size_m: FloatArray
    rear_m: float
    style: int
    is_truck: bool
    at_m: float
    speed_mps: float
    place: int = 0
    granted: int = -1
    asked_s: float = np.inf
    accel_mps2: float = 0.0
    crossings: list[tuple[float, int, int]] = field(default_factory=list)
    trace: list[tuple[float, float, float, int]] = field(default_factory=list)

    front_m: float = field(init=False)

    def __post_init__(self) -> None:
        self.front_m = float(self.size_m[0]) - self.rear_m

    def box(self, at_m: FloatArray) -> tuple[FloatArray, FloatArray]:
        """([T, 2] centres of its box, [T] headings) at [T] arc lengths, in the town's frame."""
        axle_m, yaw_rad = self.route.pose(at_m)
        ahead = np.stack([np.cos(yaw_rad), np.sin(yaw_rad)], axis=1)
        return axle_m + ahead * (self.size_m[0] / 2 - self.rear_m), yaw_rad


def lights_brakes(speed_mps: FloatArray, accel_mps2: FloatArray) -> NDArray[np.bool_]:
    """[T] whether brake lights are lit: cars that brake, and those that stand in traffic."""
    return np.asarray((accel_mps2 < -0.7) | ((speed_mps < 0.3) & (accel_mps2 < 0.3)))


def place_cars(town: Town, wanted: int, route_m: float, rng: np.random.Generator) -> list[Car]:
    """Cars and a few trucks spread over the lanes, often one behind another.

    Args:
        town: Where.
        wanted: How many, at most.
        route_m: Length of each one's route.
        rng: Source of chance.
    """
    roads = [lane for lane in town.lanes if lane.turn is None]
    lengths_m = np.array([arc_lengths(lane.centreline_m)[-1] for lane in roads])
    taken: dict[int, list[float]] = {}
    cars: list[Car] = []
    while len(cars) < wanted:
        k = int(rng.choice(len(roads), p=lengths_m / lengths_m.sum()))
        spots_m = [float(rng.uniform(8.0, lengths_m[k] - 14.0))]
        if rng.random() < 0.4:
            spots_m.append(spots_m[0] - float(rng.uniform(11.0, 18.0)))
        for at_m in spots_m:
            near = any(abs(at_m - other) < 11.0 for other in taken.get(k, []))
            if at_m < 4.0 or near or len(cars) == wanted:
                continue
            taken.setdefault(k, []).append(at_m)
            cars.append(_new_car(town, roads[k], at_m, route_m, rng))
    return cars


def _new_car(town: Town, lane: Lane, at_m: float, route_m: float, rng: np.random.Generator) -> Car:
    is_truck = bool(rng.random() < 0.1)
    if is_truck:
        size_m = np.array([rng.uniform(6.0, 6.4), 2.2, rng.uniform(2.6, 3.1)])
    else:
        size_m = np.array([EGO_LENGTH_M, EGO_WIDTH_M, rng.uniform(1.45, 1.7)])
    pace = float(np.clip(rng.normal(1.0, 0.01), 0.97, 1.03))
    route = plan_route(town, lane.lane_id, route_m, pace, rng)
    return Car(
        route=route,
        size_m=size_m,
        rear_m=1.5 if is_truck else EGO_REAR_M,
        style=int(rng.integers(1 << 16)),
        is_truck=is_truck,
        at_m=at_m,
        speed_mps=0.0,
    )
