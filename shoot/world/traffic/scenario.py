"""One 20 s scene: traffic settled in a town, one of its cars chosen as ego, light and weather."""

import numpy as np

from shoot.world.town.town import FloatArray, Town
from shoot.world.traffic.cars import Car, lights_brakes, place_cars
from shoot.world.traffic.junctions import SignalPlan, plan_signals
from shoot.world.traffic.recording import AGENT_SIGHT_M, Agent, Look, Recording
from shoot.world.traffic.traffic import STEP_S, Traffic
from shoot.world.traffic.walkers import Pavements, Walker, send_walkers

DT_S = 0.05
BURN_IN_S = 20.0
BURN_IN_STEPS = round(BURN_IN_S / STEP_S)
NUM_CARS = (15, 31)
MAX_SPEED_MPS = 13.5
ROUTE_TO_SPARE_M = 320.0
# Cameras stand a little off the ego's origin, and fire between steps.
KEEP_WITHIN_M = AGENT_SIGHT_M + 10.0


def make_scenario(town: Town, seed: int, duration_s: float = 20.0) -> Recording:
    """Let traffic settle, then record it as one randomly chosen car drives through it.

    The ego is one of the cars and drives as they do; it is chosen without regard to what it does.

    Args:
        town: Where.
        seed: Any non-negative integer; the same gives the same recording.
        duration_s: Length of the recording.
    """
    rng = scenario_rng(seed)
    plan, cars, walkers = simulate(town, rng, duration_s)
    ego = choose_ego(cars, rng)
    times_s = np.arange(round(duration_s / DT_S) + 1) * DT_S
    at_m, speed_mps, _ = _trace(ego, BURN_IN_STEPS, times_s)
    ego_xy_m, ego_yaw_rad = ego.route.pose(at_m)
    place = np.searchsorted(ego.route.starts_m, at_m, side="right") - 1
    agents = [_car_agent(car, BURN_IN_STEPS, times_s) for car in cars if car is not ego]
    agents += [_walker_agent(walker, BURN_IN_STEPS, times_s) for walker in walkers]
    near = [agent for agent in agents if np.hypot(*(agent.xy_m - ego_xy_m).T).min() < KEEP_WITHIN_M]
    return Recording(
        dt_s=DT_S,
        ego_xy_m=ego_xy_m,
        ego_yaw_rad=ego_yaw_rad,
        ego_speed_mps=speed_mps,
        ego_lane=np.array(ego.route.lanes, dtype=np.int64)[place],
        agents=tuple(near),
        signal_state=plan.states(times_s),
    )


def simulate(
    town: Town, rng: np.random.Generator, duration_s: float
) -> tuple[SignalPlan, list[Car], list[Walker]]:
    """Fill a town with traffic and run it from `-BURN_IN_S` to `duration_s`.

    Args:
        town: Where.
        rng: Source of chance.
        duration_s: How long after the burn-in.

    Returns:
        The lights' plan, all cars and all walkers with their traces, one entry per `STEP_S`.
    """
    plan, cars, walkers = populate(town, rng, duration_s)
    traffic = Traffic(town, plan, Pavements(town, plan, walkers), cars)
    for step in range(BURN_IN_STEPS + round(duration_s / STEP_S) + 1):
        traffic.step(-BURN_IN_S + step * STEP_S)
    return plan, cars, walkers


def populate(
    town: Town, rng: np.random.Generator, duration_s: float
) -> tuple[SignalPlan, list[Car], list[Walker]]:
    """Fill a town with traffic, as it is at `-BURN_IN_S`.

    Args:
        town: Where.
        rng: Source of chance.
        duration_s: How long after the burn-in routes and people are to last.

    Returns:
        The lights' plan, all cars and all walkers.
    """
    plan = plan_signals(town, rng)
    start_s, end_s = -BURN_IN_S, duration_s + STEP_S
    walkers = send_walkers(town, plan, start_s, end_s, rng)
    route_m = (end_s - start_s) * MAX_SPEED_MPS + ROUTE_TO_SPARE_M
    cars = place_cars(town, int(rng.integers(*NUM_CARS)), route_m, rng)
    return plan, cars, walkers


def scenario_rng(seed: int) -> np.random.Generator:
    """The chance that all of a scene's traffic comes from, in its order."""
    return np.random.default_rng([seed, 0x71])


def choose_ego(cars: list[Car], rng: np.random.Generator) -> Car:
    """Any car that is not a truck, all equally likely."""
    candidates = [car for car in cars if not car.is_truck]
    return candidates[int(rng.integers(len(candidates)))]


def make_look(seed: int) -> Look:
    """Draw light and weather: mostly day, some dusk and night, some rain.

    Args:
        seed: Any non-negative integer.
    """
    rng = np.random.default_rng([seed, 0x72])
    daylight = str(rng.choice(["day", "dusk", "night"], p=[0.72, 0.13, 0.15]))
    rain_share = {"day": 0.2, "dusk": 0.15, "night": 0.1}[daylight]
    return Look(
        daylight=daylight,  # type: ignore[arg-type]
        is_raining=bool(rng.random() < rain_share),
        sun_azimuth_rad=float(rng.uniform(-np.pi, np.pi)),
    )


def describe(town: Town, recording: Recording, look: Look) -> str:
    """A line as in nuScenes; says Night and Rain exactly when it is so.

    Args:
        town: Where it happened.
        recording: What happened.
        look: Light and weather.
    """
    words = []
    if look.daylight == "night":
        words.append("Night")
    if look.is_raining:
        words.append("Rain")
    lanes = [town.lanes[i] for i in dict.fromkeys(recording.ego_lane.tolist())]
    turns = [lane.turn for lane in lanes if lane.turn is not None]
    words += [f"turn {turn}" if turn != "straight" else "intersection" for turn in turns]
    if any(lane.limit_mps > 10 and lane.turn is None for lane in lanes):
        words.append("wide road")
    if (recording.ego_speed_mps < 0.3).mean() > 0.1:
        words.append("waiting")
    people = sum(agent.kind == "pedestrian" for agent in recording.agents)
    if people > 10:
        words.append("many peds")
    words.append("parked cars" if len(town.parked_cars) > 40 else "moving cars")
    line = ", ".join(dict.fromkeys(words))
    return line[0].upper() + line[1:]


def _trace(car: Car, first: int, times_s: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """([T] arc length, [T] speed, [T] acceleration) at the given times after the burn-in."""
    rows = np.array(car.trace, dtype=np.float64)
    step = np.minimum(first + np.floor(times_s / STEP_S + 1e-6).astype(int), len(rows) - 1)
    into_s = times_s - (step - first) * STEP_S
    at_m, speed_mps, accel_mps2 = rows[step, :3].T
    return (
        at_m + speed_mps * into_s + accel_mps2 * into_s**2 / 2,
        speed_mps + accel_mps2 * into_s,
        accel_mps2,
    )


def _car_agent(car: Car, first: int, times_s: FloatArray) -> Agent:
    at_m, speed_mps, accel_mps2 = _trace(car, first, times_s)
    xy_m, yaw_rad = car.box(at_m)
    return Agent(
        kind="truck" if car.is_truck else "car",
        size_m=car.size_m,
        style=car.style,
        xy_m=xy_m,
        yaw_rad=yaw_rad,
        speed_mps=speed_mps,
        is_braking=lights_brakes(speed_mps, accel_mps2),
        is_present=np.ones(len(times_s), dtype=np.bool_),
    )


def _walker_agent(walker: Walker, first: int, times_s: FloatArray) -> Agent:
    trace_m = np.array(walker.trace_m[first:])
    at_m = np.interp(times_s, np.arange(len(trace_m)) * STEP_S, trace_m)
    xy_m, yaw_rad = walker.pose(at_m)
    return Agent(
        kind="pedestrian",
        size_m=walker.size_m(),
        style=walker.style,
        xy_m=xy_m,
        yaw_rad=yaw_rad,
        speed_mps=np.gradient(at_m, DT_S),
        is_braking=np.zeros(len(times_s), dtype=np.bool_),
        is_present=np.ones(len(times_s), dtype=np.bool_),
    )
