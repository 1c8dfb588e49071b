"""What all drivers are: something that reads sensors, or not, and plans."""

from collections.abc import Callable
from dataclasses import replace
from typing import Protocol, runtime_checkable

from shoot.simulation.observation import Observation
from shoot.simulation.plan import Plan
from shoot.simulation.route_log import Mode, RouteLog
from shoot.simulation.senses import SensorSettings
from shoot.simulation.simulator import Simulator
from shoot.world.town.town import Town


@runtime_checkable
class Driver(Protocol):
    """Plans, moment by moment."""

    @property
    def name(self) -> str:
        """For tables."""

    @property
    def cameras(self) -> tuple[str, ...]:
        """Channels it reads; empty if none."""

    @property
    def num_scans(self) -> int:
        """Lidar turns it reads; 0 if none."""

    def plan(self, observation: Observation) -> Plan:
        """Where the ego is to be in the next seconds."""


def drive(
    driver: Driver,
    town: Town,
    seed: int,
    mode: Mode,
    car: SensorSettings,
    duration_s: float = 20.0,
    watch: Callable[[Observation, Plan], None] | None = None,
) -> RouteLog:
    """Let a driver drive one route to its end.

    Args:
        driver: Who plans.
        town: Where.
        seed: Of the scene, see `Simulator`.
        mode: Whether traffic answers, see `Simulator`.
        car: What it carries; what of it is read, the driver says.
        duration_s: Length of the route.
        watch: Told of each planning: what was seen and what was planned.
    """
    read = replace(car, cameras=driver.cameras, num_scans=driver.num_scans)
    simulator = Simulator(town, seed, mode, read, duration_s)
    observation = simulator.reset()
    while not simulator.is_over:
        plan = driver.plan(observation)
        if watch is not None:
            watch(observation, plan)
        observation = simulator.step(plan)
    return simulator.log()
