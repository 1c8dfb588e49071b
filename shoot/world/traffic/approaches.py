"""Where the ego has a choice, and from when on anything that happens depends on its choice.

A recording cannot say whether what a camera saw gave the ego's way away. Running the same traffic
again with the ego on another way can: up to the moment where the two runs part, all images are the
same whichever way it takes.
"""

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from shoot.world.town.curves import arc_lengths, cut
from shoot.world.town.town import FloatArray, Town
from shoot.world.traffic.cars import Car, lights_brakes
from shoot.world.traffic.driver import follow_lanes
from shoot.world.traffic.junctions import SignalPlan
from shoot.world.traffic.scenario import BURN_IN_S, BURN_IN_STEPS, scenario_rng, simulate
from shoot.world.traffic.traffic import STEP_S, Traffic
from shoot.world.traffic.walkers import Pavements, Walker

NEAR_M = 80.0
# Runs that part do so by centimetres at once; what is below is rounding.
EGO_PARTS_M, OTHERS_PART_M = 0.01, 0.1
WAY_M = 80.0

Direction = Literal["left", "straight", "right"]
Brakes = NDArray[np.bool_]


@dataclass(frozen=True)
class Approach:
    """The ego on a lane before an intersection from which more than one way is open to it.

    All times are the recording's. The ego's way is known even if it does not reach it in time.

    Attributes:
        lane: Lane it comes on.
        ways: Paths across the intersection that its lane allows, index into `Town.lanes`.
        taken: Which of `ways` it takes.
        is_single_lane: Whether its road has one lane a side.
        start_s, end_s: When it is on `lane`, within the recording.
        others_part_s: From when on what others near it do depends on its way; `inf` if not before
            `end_s` (or if not asked for).
        ego_parts_s: From when on its own motion does; likewise.
    """

    lane: int
    ways: tuple[int, ...]
    taken: int
    is_single_lane: bool
    start_s: float
    end_s: float
    others_part_s: float = np.inf
    ego_parts_s: float = np.inf

    def directions(self, town: Town) -> tuple[Direction, ...]:
        """How each way crosses the intersection."""
        turns = [town.lanes[way].turn for way in self.ways]
        return tuple(turn for turn in turns if turn is not None)

    def stage(self, time_s: float, margin_s: float = 0.1) -> Literal["hidden", "others", "ego"]:
        """What can tell its way at a time: nothing, what others do, or its own motion.

        Args:
            time_s: When.
            margin_s: Cameras fire a little before or after a sample's own time.
        """
        if time_s + margin_s >= self.ego_parts_s:
            return "ego"
        return "others" if time_s + margin_s >= self.others_part_s else "hidden"


def find_approaches(
    town: Town,
    seed: int,
    times_s: FloatArray,
    ego_xy_m: FloatArray,
    with_replay: bool = True,
) -> tuple[Approach, ...]:
    """Every approach of a scene's ego to an intersection where it has a choice.

    Args:
        town: Where.
        seed: What `make_scenario` was given.
        times_s: [P] times of the ego's poses in the recording, the last one at its end.
        ego_xy_m: [P, 2] where it was, in the town's frame.
        with_replay: Run traffic again on all other ways to learn from when on the way matters.

    Raises:
        ValueError: If no car of this town and seed drove so: another version made the scene.
    """
    duration_s = float(times_s[-1])
    plan, cars, walkers = simulate(town, scenario_rng(seed), duration_s)
    ego = _find_ego(cars, times_s, ego_xy_m)
    places = np.array([row[3] for row in cars[ego].trace])[BURN_IN_STEPS:]
    route = cars[ego].route.lanes
    found = []
    for place in dict.fromkeys(places.tolist()):
        lane = town.lanes[route[place]]
        if place + 1 == len(route) or lane.turn is not None or len(lane.successors) < 2:
            continue
        on_it = np.flatnonzero(places == place) * STEP_S
        approach = Approach(
            lane=lane.lane_id,
            ways=lane.successors,
            taken=lane.successors.index(route[place + 1]),
            is_single_lane=lane.left_lane is None and lane.right_lane is None,
            start_s=float(on_it[0]),
            end_s=min(float(on_it[-1]) + STEP_S, duration_s),
        )
        if with_replay:
            replay = _Replay(town, plan, cars, walkers, ego)
            approach = replay.parting(approach, place)
        found.append(approach)
    return tuple(found)


def _find_ego(cars: list[Car], times_s: FloatArray, ego_xy_m: FloatArray) -> int:
    for number, car in enumerate(cars):
        at_m = np.array(car.trace)[BURN_IN_STEPS:, 0]
        xy_m, _ = car.route.pose(np.interp(times_s, np.arange(len(at_m)) * STEP_S, at_m))
        # Between steps a car accelerates; 2 cm is more than that bends its way in time.
        if np.hypot(*(xy_m - ego_xy_m).T).max() < 0.02:
            return number
    raise ValueError("no car of this town and seed drove as the ego did")


@dataclass(frozen=True)
class _Replay:
    """The traffic of a scene as it was, to be run again with the ego on another way."""

    town: Town
    plan: SignalPlan
    cars: list[Car]
    walkers: list[Walker]
    ego: int

    def parting(self, approach: Approach, place: int) -> Approach:
        """The approach with the times from which on its way matters."""
        num_steps = BURN_IN_STEPS + round(approach.end_s / STEP_S) + 1
        ego_parts, others_part = num_steps, num_steps
        for way in approach.ways:
            if way == approach.ways[approach.taken]:
                continue
            cars, walkers = self._run(place, way, min(num_steps, ego_parts + 1))
            steps = len(cars[self.ego].trace)
            ego_parts = min(ego_parts, _first(self._ego_differs(cars[self.ego]), steps, num_steps))
            others = self._others_differ(cars, walkers)
            others_part = min(others_part, _first(others, steps, num_steps))

        def seconds(step: int) -> float:
            return np.inf if step >= num_steps else (step - BURN_IN_STEPS) * STEP_S

        return replace(approach, ego_parts_s=seconds(ego_parts), others_part_s=seconds(others_part))

    def _run(self, place: int, way: int, num_steps: int) -> tuple[list[Car], list[Walker]]:
        """The first steps again, the ego taking `way` as the lane after `place` of its route."""
        old = self.cars[self.ego].route
        lanes = [*old.lanes[: place + 1], way]
        length_m = old.starts_m[place + 1]
        # What comes later does not matter here, but traffic looks ahead along the whole route.
        while length_m < old.starts_m[-1]:
            lanes.append(self.town.lanes[lanes[-1]].successors[0])
            length_m += float(arc_lengths(self.town.lanes[lanes[-1]].centreline_m)[-1])
        route = follow_lanes([self.town.lanes[i] for i in lanes], old.pace)
        cars = [
            Car(
                route=route if number == self.ego else car.route,
                size_m=car.size_m,
                rear_m=car.rear_m,
                style=car.style,
                is_truck=car.is_truck,
                at_m=car.trace[0][0],
                speed_mps=car.trace[0][1],
            )
            for number, car in enumerate(self.cars)
        ]
        walkers = [
            replace(walker, at_m=walker.trace_m[0], is_walking=False, trace_m=[])
            for walker in self.walkers
        ]
        traffic = Traffic(self.town, self.plan, Pavements(self.town, self.plan, walkers), cars)
        for step in range(num_steps):
            traffic.step(-BURN_IN_S + step * STEP_S)
        return cars, walkers

    def _ego_differs(self, ego: Car) -> Brakes:
        steps = len(ego.trace)
        at_m, before_m = (np.array(c.trace[:steps])[:, 0] for c in (ego, self.cars[self.ego]))
        return np.asarray(np.abs(at_m - before_m) > EGO_PARTS_M)

    def _others_differ(self, cars: list[Car], walkers: list[Walker]) -> Brakes:
        """[steps] whether anybody near the ego is elsewhere or brakes otherwise."""
        steps = len(cars[0].trace)
        ego_m = self._positions(self.cars[self.ego], steps)
        differs = np.zeros(steps, dtype=np.bool_)
        for number, (car, old) in enumerate(zip(cars, self.cars, strict=True)):
            if number == self.ego:
                continue
            new_rows, old_rows = np.array(car.trace), np.array(old.trace[:steps])
            changed = np.abs(new_rows[:, 0] - old_rows[:, 0]) > OTHERS_PART_M
            brakes, braked = (lights_brakes(*rows[:, 1:3].T) for rows in (new_rows, old_rows))
            changed |= brakes != braked
            if changed.any():
                away_m = np.hypot(*(self._positions(old, steps) - ego_m).T)
                differs |= changed & (away_m < NEAR_M)
        for walker, other in zip(walkers, self.walkers, strict=True):
            gap_m = np.array(walker.trace_m) - np.array(other.trace_m[:steps])
            changed = np.abs(gap_m) > OTHERS_PART_M
            if changed.any():
                away_m = np.hypot(*(walker.path_m.mean(axis=0) - ego_m).T)
                differs |= changed & (away_m < NEAR_M)
        return differs

    def _positions(self, car: Car, steps: int) -> FloatArray:
        return car.route.pose(np.array([row[0] for row in car.trace[:steps]]))[0]


def _first(differs: Brakes, steps: int, never: int) -> int:
    """First step from the recording's begin on at which runs differ."""
    later = np.flatnonzero(differs[:steps])
    return int(later[0]) if len(later) else never


def way_ahead(
    town: Town, approach: Approach, way: int, xy_m: FloatArray
) -> tuple[FloatArray, float]:
    """([P, 2] the way from a place on the approach on, metres in it to the intersection).

    It follows the lane, the path and the road behind, straight on where there is more than one.

    Args:
        town: Where.
        approach: Which.
        way: One of its `ways`.
        xy_m: [2] where on its lane the ego is, in the town's frame.
    """
    lane_m = town.lanes[approach.lane].centreline_m
    s_m = arc_lengths(lane_m)
    at_m = float(s_m[int(np.argmin(np.hypot(*(lane_m - xy_m).T)))])
    rest_m = float(s_m[-1]) - at_m
    pieces = [cut(lane_m, at_m, float(s_m[-1])) if rest_m > 0.0 else lane_m[-1:]]
    length_m, number = rest_m, way
    while length_m < rest_m + WAY_M:
        centreline_m = town.lanes[number].centreline_m
        pieces.append(centreline_m[1:])
        length_m += float(arc_lengths(centreline_m)[-1])
        number = _straightest(town, number)
    return np.concatenate(pieces), rest_m


def _straightest(town: Town, number: int) -> int:
    onward = town.lanes[number].successors
    straight = [i for i in onward if town.lanes[i].turn in (None, "straight")]
    return (straight or list(onward))[0]
