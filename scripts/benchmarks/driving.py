"""Routes driven in closed loop by the shipped planner, on one core, and what takes how long."""

import tempfile
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from unittest.mock import patch

from benchmarks.measuring import Pair, Side, Spread
from benchmarks.row import Check, Row, Setting
from shoot.simulation.drivers.making import DriverSettings, car_of
from shoot.simulation.drivers.templates import RunDriver
from shoot.simulation.routes.running import RouteSettings, run_routes
from shoot.simulation.senses import Senses

RUN = Path(__file__).parents[2] / "templates" / "synthetic-1000"
NUM_ROUTES = 4
DURATION_S = 20.0


@dataclass(frozen=True)
class DriveTime:
    """Seconds a route.

    Attributes:
        all_s: Of everything: town, traffic, reference, score and filmstrip included.
        cameras_s: Of it, rendering.
        network_s: Of it, images to probabilities.
    """

    all_s: float
    cameras_s: float
    network_s: float


def drive_routes() -> DriveTime:
    """Drive some routes, traffic answering, in this process."""
    driver = DriverSettings("run", str(RUN))
    settings = RouteSettings(driver, car_of(driver), "reactive", 0, DURATION_S)
    cameras, network = _Clock(), _Clock()
    with (
        tempfile.TemporaryDirectory() as folder,
        patch.object(Senses, "look", cameras.around(Senses.look)),
        patch.object(RunDriver, "weigh", network.around(RunDriver.weigh)),
    ):
        started = time.perf_counter()
        run_routes(settings, NUM_ROUTES, Path(folder))
        all_s = time.perf_counter() - started
    return DriveTime(*(s / NUM_ROUTES for s in (all_s, cameras.seconds, network.seconds)))


def ready() -> Callable[[], DriveTime]:
    """What is timed, for a process of its own."""
    return drive_routes


def drive_rows(setting: Setting) -> Iterator[Row]:
    """Routes in closed loop, against the world's own clock."""
    side = Side(ready)
    try:
        side.result()  # loads and warms up
        taken = [side.result() for _ in range(max(2, setting.repeats // 3))]
        peak_mb = side.peak_mb()
    finally:
        side.close()
    all_s = Spread.of([one.all_s for one in taken])
    cameras_s = Spread.of([one.cameras_s for one in taken]).median
    network_s = Spread.of([one.network_s for one in taken]).median
    real_s = DURATION_S
    yield Row(
        "a route of 20 s in closed loop, one core",
        "as long as it takes in the world",
        "shoot-simulate with the shipped planner, traffic answering",
        Pair(
            Spread.of([real_s]),
            all_s,
            Spread.of([real_s / one.all_s for one in taken]),
            0.0,
            peak_mb,
        ),
        1.0,
        None,
        (
            Check(
                f"of it six cameras rendered {cameras_s:.2f} s, the network {network_s:.2f} s; "
                "town, traffic, reference, score and filmstrip the rest",
                True,
            ),
        ),
    )


class _Clock:
    """Sums up how long calls of a function take."""

    def __init__(self) -> None:
        self.seconds = 0.0

    def around(self, function: Callable[..., Any]) -> Callable[..., Any]:
        """The same function, its calls timed."""

        def timed(*args: Any) -> Any:
            started = time.perf_counter()
            result = function(*args)
            self.seconds += time.perf_counter() - started
            return result

        return timed
