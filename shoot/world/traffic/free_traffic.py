"""Traffic around an ego that goes where it wants."""

from bisect import bisect_right
from copy import copy
from dataclasses import replace

import numpy as np

from shoot.world.town.town import Town
from shoot.world.traffic.bodies import EgoBody
from shoot.world.traffic.cars import Car
from shoot.world.traffic.driver import HARD_BRAKE_MPS2, can_stop
from shoot.world.traffic.junctions import SignalPlan
from shoot.world.traffic.obstacle import gap_ahead, occupied_paths, threatened_crosswalks
from shoot.world.traffic.route_place import RoutePlace, find_place
from shoot.world.traffic.traffic import (
    CROSSWALK_ROOM_M,
    SIGHT_M,
    STEP_S,
    StateArray,
    Traffic,
)
from shoot.world.traffic.walkers import Pavements, Walker

# So far off the middle of its lane, or turned so far, the ego may reach into another's way.
ASIDE_M, ASIDE_RAD = 0.4, 0.15
OVER_LINE_M = 0.2
STANDS_MPS, STANDS_LONG_S = 0.1, 8.0
# As hard as the rules ever brake.
FULL_BRAKE_MPS2 = 7.0


class FreeTraffic(Traffic):
    """Traffic in which one car, the ego, is moved from outside.

    While the ego keeps to its route it is one of the cars: it asks for its paths, and others see it
    as they see each other. Off its route it is none of them. Off the middle of its lane, or on a
    path that it was not granted, it is an obstacle too: whoever would touch it treats it as a car
    ahead, and nobody is granted a path that conflicts with those it stands on.

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
        self._place: RoutePlace | None = RoutePlace(ego.at_m, 0.0, 0.0)
        self._stood_s = 0.0
        self._is_driven = False
        self._obstacle: EgoBody | None = None
        self._occupied: frozenset[int] = frozenset()

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
        self._pavements.ego = ego
        self._is_driven |= ego is not None
        if ego is not None:
            self._put(ego)
        elif self._place is not None:
            self.body = _body_of(self.ego)
            self._place = RoutePlace(self.ego.at_m, 0.0, 0.0)
        else:
            self.body = _braked(self.body)
        stands = ego is not None and ego.speed_mps < STANDS_MPS
        waits = self._has_returned() or len(self._holds_of_ego()) > 0
        self._stood_s = self._stood_s + STEP_S if stands and waits else 0.0

    def decide(self, time_s: float) -> None:
        """As all do, with the ego where it is now.

        Args:
            time_s: Now.
        """
        self._obstacle = self.body if self._is_obstacle() else None
        self._occupied = occupied_paths(self.body, self._town) if self._obstacle else frozenset()
        super().decide(time_s)

    def _put(self, body: EgoBody) -> None:
        self.body = body
        self._place = find_place(self.ego.route, body, self.ego.at_m)
        if self._place is None:
            self.cars = [car for car in self.everybody if car is not self.ego]
            self._return_grants()
            return
        self.cars = self.everybody
        self.ego.at_m, self.ego.speed_mps = self._place.at_m, body.speed_mps
        self.ego.place = bisect_right(self.ego.route.starts_m, self._place.at_m) - 1

    def _is_obstacle(self) -> bool:
        """Whether others have to look at where the ego is rather than at its place on its route."""
        if self._place is None or self._place.off_m > ASIDE_M or self._place.off_rad > ASIDE_RAD:
            return True
        route, front_m = self.ego.route, self.ego.at_m + self.ego.front_m
        return any(
            self._town.lanes[route.lanes[place]].turn is not None
            and self.ego.at_m < route.starts_m[place + 1]
            and front_m > route.starts_m[place] + OVER_LINE_M
            and place not in self._holds_of_ego()
            for place in (self.ego.place, self.ego.place + 1)
        )

    def _holds_of_ego(self) -> list[int]:
        """Places of the paths in its route that the ego was granted."""
        return [p for holds in self._holds.values() for car, p in holds if car is self.ego]

    def _return_grants(self) -> None:
        self.ego.granted, self.ego.asked_s = -1, np.inf
        for intersection, holds in self._holds.items():
            self._holds[intersection] = [hold for hold in holds if hold[0] is not self.ego]

    def _has_returned(self) -> bool:
        """Whether the ego stood for so long that others may go first until it moves."""
        return self._stood_s > STANDS_LONG_S

    def _give_up(self, states: StateArray) -> None:
        super()._give_up(states)
        if self._has_returned():
            self._return_grants()

    def _asks(self, car: Car, room_m: float) -> bool:
        if car is self.ego and self._has_returned():
            return False
        return super()._asks(car, room_m)

    def _is_taken(self, car: Car, conflicts: frozenset[int], holds: list[tuple[Car, int]]) -> bool:
        if car is not self.ego and not conflicts.isdisjoint(self._occupied):
            return True
        return super()._is_taken(car, conflicts, holds)

    def _crosswalks_safe(self) -> dict[int, bool]:
        safe = super()._crosswalks_safe()
        if self._obstacle is not None:
            safe |= dict.fromkeys(threatened_crosswalks(self._obstacle, self._town), False)
        return safe

    def _decide(self, car: Car) -> float:
        accel = super()._decide(car)
        if car is self.ego and self._is_driven:
            return min(accel, self._stop_late(car))
        return accel

    def _stop_late(self, car: Car) -> float:
        """Acceleration before people for whom the rules no longer stop, but brakes still can.

        By the rules cars stop at a line before a crosswalk, or drive on if they cannot. Their own
        way of braking always can; a car that was driven otherwise may come a little too far.
        """
        for near_m, crosswalk, lane in car.crossings:
            line_m = near_m - CROSSWALK_ROOM_M - car.at_m - car.front_m
            room_m = line_m + CROSSWALK_ROOM_M / 2
            if room_m > SIGHT_M:
                break
            is_late = not can_stop(car.speed_mps, line_m, HARD_BRAKE_MPS2)
            if (
                is_late
                and can_stop(car.speed_mps, room_m, FULL_BRAKE_MPS2)
                and self._pavements.is_blocked(lane, crosswalk)
            ):
                return -(car.speed_mps**2) / (2 * room_m)
        return np.inf

    def _leads(self, car: Car) -> list[tuple[float, float]]:
        leads = super()._leads(car)
        if self._obstacle is not None and car is not self.ego:
            lead = gap_ahead(self._obstacle, car, SIGHT_M)
            if lead is not None:
                leads.append(lead)
        return leads


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
