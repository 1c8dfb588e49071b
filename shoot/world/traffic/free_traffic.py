"""Traffic around an ego that goes where it wants."""

from copy import copy
from dataclasses import replace

import numpy as np

from shoot.world.town.town import Town
from shoot.world.traffic.bodies import EgoBody
from shoot.world.traffic.cars import Car
from shoot.world.traffic.driver import HARD_BRAKE_MPS2
from shoot.world.traffic.junctions import SignalPlan
from shoot.world.traffic.route_place import find_place
from shoot.world.traffic.traffic import STEP_S, Traffic
from shoot.world.traffic.walkers import Pavements, Walker


class FreeTraffic(Traffic):
    """Traffic in which one car, the ego, is moved from outside.

    While the ego keeps to its route it is one of the cars: it asks for its paths, and others see it
    as they see each other. Off its route it is none of them.

    Attributes:
        everybody: All cars, the ego among them; `cars` has those that keep to their routes.
        ego: The car that stands for it.
        body: Where it is.
    """

    def __init__(
        self, town: Town, plan: SignalPlan, pavements: Pavements, cars: list[Car], ego: Car
    ) -> None:
        super().__init__(town, plan, pavements, cars)
        self.everybody = list(cars)
        self.ego = ego
        self.body = _body_of(ego)

    def others(self) -> tuple[list[Car], list[Walker]]:
        """(all other cars, all people)."""
        return [car for car in self.everybody if car is not self.ego], self._pavements.walkers

    def copy(self) -> "FreeTraffic":
        """The same once more, without the past; whatever it does changes nothing here."""
        there = copy(self)
        twin = {car: _copy_of(car) for car in self.everybody}
        there.everybody = list(twin.values())
        there.cars = [twin[car] for car in self.cars]
        there.ego = twin[self.ego]
        there._holds = {
            intersection: [(twin[car], place) for car, place in holds]
            for intersection, holds in self._holds.items()
        }
        there._pavements = self._pavements.copy()
        return there

    def adopt(self, other: "FreeTraffic") -> None:
        """Put all but the ego to where another run of the same traffic has them."""
        own = dict(zip(other.everybody, self.everybody, strict=True))
        for theirs, car in own.items():
            if car is not self.ego:
                car.at_m, car.speed_mps, car.accel_mps2 = (
                    theirs.at_m, theirs.speed_mps, theirs.accel_mps2
                )  # fmt: skip
                car.place, car.granted, car.asked_s = theirs.place, theirs.granted, theirs.asked_s
                car.crossings = list(theirs.crossings)
        for intersection in {**self._holds, **other._holds}:
            kept = [hold for hold in self._holds.get(intersection, ()) if hold[0] is self.ego]
            others = [
                (own[car], place)
                for car, place in other._holds.get(intersection, ())
                if car is not other.ego
            ]
            self._holds[intersection] = others + kept
        self._pavements.adopt(other._pavements)

    def move_on(self, ego: EgoBody | None) -> None:
        """Move everybody on by `STEP_S`, as they have decided.

        Args:
            ego: Where the ego will then be; None: it drives as all do, or brakes where it is if
                it has left its route.
        """
        self.advance()
        if ego is not None:
            self._put(ego)
        elif self.ego in self.cars:
            self.body = _body_of(self.ego)
        else:
            self.body = _braked(self.body)

    def _put(self, body: EgoBody) -> None:
        self.body = body
        place = find_place(self.ego.route, body, self.ego.at_m)
        if place is None:
            self._take_out()
            return
        self.cars = self.everybody
        self.ego.at_m, self.ego.speed_mps = place.at_m, body.speed_mps
        starts_m = self.ego.route.starts_m
        self.ego.place = int(np.searchsorted(starts_m, place.at_m, side="right")) - 1

    def _take_out(self) -> None:
        self.cars = [car for car in self.everybody if car is not self.ego]
        self.ego.granted, self.ego.asked_s = -1, np.inf
        for intersection, holds in self._holds.items():
            self._holds[intersection] = [hold for hold in holds if hold[0] is not self.ego]


def _body_of(car: Car) -> EgoBody:
    """A car on its route as others see the ego."""
    xy_m, yaw_rad = car.route.pose(np.array([car.at_m]))
    return EgoBody(xy_m[0], float(yaw_rad[0]), car.speed_mps)


def _copy_of(car: Car) -> Car:
    twin = copy(car)
    twin.crossings, twin.trace = list(car.crossings), []
    return twin


def _braked(body: EgoBody) -> EgoBody:
    """A step later, braking hard in the direction it points."""
    after_mps = max(0.0, body.speed_mps - HARD_BRAKE_MPS2 * STEP_S)
    way_m = 0.5 * (body.speed_mps + after_mps) * STEP_S
    ahead = np.array([np.cos(body.yaw_rad), np.sin(body.yaw_rad)])
    return replace(body, xy_m=body.xy_m + way_m * ahead, speed_mps=after_mps)
