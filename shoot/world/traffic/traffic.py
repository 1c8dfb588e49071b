"""Moves everybody: cars that follow lanes, lights and each other and give way to people."""

import numpy as np
from numpy.typing import NDArray

from shoot.world.town.curves import arc_lengths
from shoot.world.town.town import Lane, Town
from shoot.world.traffic.cars import Car
from shoot.world.traffic.driver import (
    ACCEL_MPS2,
    BRAKE_MPS2,
    ROUTE_STEP_M,
    can_stop,
    follow_accel,
    stop_accel,
)
from shoot.world.traffic.junctions import PathRules, SignalPlan, path_rules
from shoot.world.traffic.recording import GREEN
from shoot.world.traffic.walkers import Pavements

STEP_S = 0.1
SIGHT_M = 60.0
LINE_ROOM_M = 0.3
CROSSWALK_ROOM_M = 1.0
CROSSWALK_DEPTH_M = 3.0
MIN_EMPTY_M = 2.5
# Who found no gap for a left turn in about one cycle of the lights goes first in the next.
PATIENCE_S = 25.0

StateArray = NDArray[np.int64]


class Traffic:
    """All cars of a scene, step by step.

    A car asks for its path across the next intersection when it comes near, and drives on only once
    it is granted: lights green, room behind the intersection, nobody on a conflicting path, nobody
    oncoming when it turns left. Who asked first is heard first. A grant lasts until its rear bumper
    has left the path, so no two cars that could touch are ever inside together.
    """

    def __init__(self, town: Town, plan: SignalPlan, pavements: Pavements, cars: list[Car]) -> None:
        self.cars = cars
        self._town = town
        self._plan = plan
        self._pavements = pavements
        self._rules: dict[int, PathRules] = path_rules(town)
        self._length_m = [float(arc_lengths(lane.centreline_m)[-1]) for lane in town.lanes]
        self._holds: dict[int, list[tuple[Car, int]]] = {}
        self._on_lane: dict[int, list[Car]] = {}
        self._line_m = [self._line_of(lane) for lane in town.lanes]
        for car in cars:
            car.crossings = sorted(
                (car.route.starts_m[k] + float(at_m), c, lane)
                for k, lane in enumerate(car.route.lanes)
                for c, at_m in town.lanes[lane].crosswalks
            )

    def _line_of(self, lane: Lane) -> float:
        """Arc length at which cars wait for their turn at the end of a lane."""
        if lane.stop_at_m is not None:
            return lane.stop_at_m
        end_m = self._length_m[lane.lane_id] - 1.0
        near = [at_m for _, at_m in lane.crosswalks if at_m > end_m - 6.0]
        return min([end_m, *(at_m - CROSSWALK_ROOM_M for at_m in near)])

    def step(self, time_s: float) -> None:
        """Let everybody act once and move on by `STEP_S`."""
        self.decide(time_s)
        self.advance()

    def decide(self, time_s: float) -> None:
        """Let everybody choose what to do until `STEP_S` later; people on foot are there at once.

        Args:
            time_s: Now.
        """
        self._on_lane = {}
        for car in self.cars:
            while car.at_m >= car.route.starts_m[car.place + 1]:
                car.place += 1
            self._on_lane.setdefault(car.route.lanes[car.place], []).append(car)
        states = self._plan.states(time_s)
        self._pavements.step(time_s, STEP_S, self._crosswalks_safe())
        self._give_up(states)
        self._grant(time_s, states)
        for car in self.cars:
            car.accel_mps2 = self._decide(car)

    def advance(self) -> None:
        """Move all cars on by `STEP_S`, as they have decided."""
        for car in self.cars:
            before = car.speed_mps
            after = max(0.0, before + car.accel_mps2 * STEP_S)
            if after < 0.05 and car.accel_mps2 < 0.3:
                after = 0.0
            car.trace.append((car.at_m, before, (after - before) / STEP_S, car.place))
            car.speed_mps = after
            car.at_m += 0.5 * (before + after) * STEP_S

    def _local_m(self, car: Car) -> float:
        return car.at_m - car.route.starts_m[car.place]

    def _gate(self, car: Car) -> tuple[int, float]:
        """(place of the next path in its route, room to the line before it)."""
        on_path = self._town.lanes[car.route.lanes[car.place]].turn is not None
        place = car.place + (2 if on_path else 1)
        line_m = car.route.starts_m[place - 1] + self._line_m[car.route.lanes[place - 1]]
        return place, float(line_m - car.at_m - car.front_m - LINE_ROOM_M)

    def _give_up(self, states: StateArray) -> None:
        """Return grants of paths that are left, and of those before which one can still stop."""
        for holds in self._holds.values():
            for car, place in list(holds):
                if car.at_m - car.rear_m > car.route.starts_m[place + 1]:
                    holds.remove((car, place))
                    continue
                signal = self._town.lanes[car.route.lanes[place - 1]].signal
                if signal is None or states[signal] == GREEN or car.place >= place:
                    continue
                _, room_m = self._gate(car)
                if can_stop(car.speed_mps, room_m, 1.25 * BRAKE_MPS2):
                    holds.remove((car, place))
                    car.granted = -1

    def _grant(self, time_s: float, states: StateArray) -> None:
        asking: list[tuple[bool, float, int, int]] = []
        for i, car in enumerate(self.cars):
            place, room_m = self._gate(car)
            if car.granted >= place:
                continue
            if not self._asks(car, room_m):
                car.asked_s = np.inf
                continue
            car.asked_s = min(car.asked_s, time_s)
            path = self._town.lanes[car.route.lanes[place]]
            yields = path.turn == "left" and time_s - car.asked_s < PATIENCE_S
            asking.append((yields, car.asked_s, i, place))
        for yields, _, i, place in sorted(asking):
            car = self.cars[i]
            lane = self._town.lanes[car.route.lanes[place - 1]]
            path = self._town.lanes[car.route.lanes[place]]
            if lane.signal is not None and states[lane.signal] != GREEN:
                continue
            holds = self._holds.setdefault(path.intersection or 0, [])
            conflicts = self._rules[path.lane_id].conflicts
            if self._is_taken(car, conflicts, holds):
                continue
            if not self._has_room_behind(car, place, holds):
                continue
            if yields and lane.signal is not None and self._has_oncoming(car, conflicts, states):
                continue
            holds.append((car, place))
            car.granted = place
            car.asked_s = np.inf

    def _asks(self, car: Car, room_m: float) -> bool:
        """Whether a car is near enough to the line before its next path to ask for it."""
        return room_m <= car.speed_mps**2 / (2 * 0.8 * BRAKE_MPS2) + 8.0

    def _is_taken(self, car: Car, conflicts: frozenset[int], holds: list[tuple[Car, int]]) -> bool:
        """Whether another than a car holds one of the paths that conflict with its own."""
        return any(other.route.lanes[at] in conflicts for other, at in holds)

    def _has_room_behind(self, car: Car, place: int, holds: list[tuple[Car, int]]) -> bool:
        """Whether all who are or will be on the lane behind the intersection could queue there."""
        target = car.route.lanes[place + 1]
        there = self._on_lane.get(target, [])
        coming = [
            other
            for other, at in holds
            if other.route.lanes[at + 1] == target and other.place <= at
        ]
        needed_m = sum(float(c.size_m[0]) + MIN_EMPTY_M for c in [*there, *coming, car])
        if needed_m > self._length_m[target] - 6.0:
            return False
        slow = [c for c in there if c.speed_mps < 2.0]
        free_m = min((self._local_m(c) - c.rear_m for c in slow), default=np.inf)
        return free_m > sum(float(c.size_m[0]) + MIN_EMPTY_M for c in [*coming, car]) + 1.0

    def _has_oncoming(self, car: Car, conflicts: frozenset[int], states: StateArray) -> bool:
        """Whether somebody comes soon, on green, who may go straight or right across our path.

        Nobody knows which way another will take: waiting for some and not for others would show it.
        """
        for other in self.cars:
            if other is car:
                continue
            place, room_m = self._gate(other)
            lane = self._town.lanes[other.route.lanes[place - 1]]
            if not any(
                path in conflicts and self._town.lanes[path].turn != "left"
                for path in lane.successors
            ):
                continue
            if lane.signal is None or states[lane.signal] != GREEN or room_m > 45.0:
                continue
            if other.speed_mps > 1.0 and room_m / other.speed_mps < 4.0:
                return True
        return False

    def _crosswalks_safe(self) -> dict[int, bool]:
        """Per crosswalk with cars near whether each of them can stop before it."""
        safe: dict[int, bool] = {}
        for car in self.cars:
            for near_m, c, _ in car.crossings:
                room_m = near_m - CROSSWALK_ROOM_M - car.at_m - car.front_m
                if room_m > SIGHT_M:
                    break
                if car.at_m - car.rear_m > near_m + CROSSWALK_DEPTH_M:
                    continue
                fine = can_stop(car.speed_mps, room_m, 2.6) or (
                    car.speed_mps < 0.1 and room_m > -CROSSWALK_ROOM_M + 0.1
                )
                safe[c] = safe.get(c, True) and fine
        return safe

    def _decide(self, car: Car) -> float:
        speed = car.speed_mps
        i = min(int((car.at_m + speed * STEP_S) / ROUTE_STEP_M), len(car.route.cap_mps) - 1)
        accel = min(ACCEL_MPS2, max(-4.0, (float(car.route.cap_mps[i]) - speed) / STEP_S))
        place, room_m = self._gate(car)
        if car.granted < place and room_m < SIGHT_M:
            accel = min(accel, stop_accel(speed, room_m))
        while car.crossings and car.at_m - car.rear_m > car.crossings[0][0] + CROSSWALK_DEPTH_M:
            car.crossings.pop(0)
        for near_m, c, lane in car.crossings:
            room_m = near_m - CROSSWALK_ROOM_M - car.at_m - car.front_m
            if room_m > SIGHT_M:
                break
            standing = speed < 0.1 and room_m > -CROSSWALK_ROOM_M + 0.1
            if (can_stop(speed, room_m, 3.2) or standing) and self._pavements.is_blocked(lane, c):
                accel = min(accel, stop_accel(speed, room_m))
        for gap_m, lead_mps in self._leads(car):
            accel = min(accel, follow_accel(speed, gap_m, lead_mps))
        return max(accel, -7.0)

    def _leads(self, car: Car) -> list[tuple[float, float]]:
        """The car ahead on its own route, and those about to part from it: (gap, speed)."""
        found: list[tuple[float, float]] = []
        lanes, starts_m = car.route.lanes, car.route.starts_m
        for place in range(car.place, len(lanes)):
            if starts_m[place] - car.at_m > SIGHT_M:
                break
            path = self._rules.get(lanes[place])
            if path is not None:
                for sibling, part_m in path.siblings:
                    for other in self._on_lane.get(sibling, ()):
                        local_m = self._local_m(other)
                        ahead_m = starts_m[place] + local_m - car.at_m
                        if ahead_m > 0.0 and local_m - other.rear_m < part_m:
                            gap_m = ahead_m - car.front_m - other.rear_m
                            found.append((gap_m, other.speed_mps))
            ahead = [
                (starts_m[place] + self._local_m(other) - car.at_m, other)
                for other in self._on_lane.get(lanes[place], ())
                if other is not car
            ]
            nearest = min((a for a in ahead if a[0] > 0.0), default=None, key=lambda a: a[0])
            if nearest is not None:
                gap_m = nearest[0] - car.front_m - nearest[1].rear_m
                found.append((gap_m, nearest[1].speed_mps))
                break
        return found
