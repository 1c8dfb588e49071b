"""shoot-simulate: a planner drives through towns it has not seen, and is scored."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from lss_core.bounds import Bounds, Seed, Workers, check_settings
from shoot.cli.app import run
from shoot.report.driving.page import write_driving_page
from shoot.report.route_table import format_routes
from shoot.simulation.drivers.choice import Choose
from shoot.simulation.drivers.making import DriverName, DriverSettings, car_of
from shoot.simulation.route_log import Mode
from shoot.simulation.routes.result_files import SUMMARY
from shoot.simulation.routes.running import RouteSettings, run_routes
from shoot.simulation.routes.summary import Summary, sum_up
from shoot.world.config import IMAGE_SCALES


@dataclass(frozen=True)
class SimulateConfig:
    """Drive routes through towns that no data set has, and score them.

    Attributes:
        run: Run folder; of the drivers `run`, `prior` and `oracle` only.
        out: Folder of the results; called again with the same settings, the command goes on there.
        driver: Who drives: the trained planner; the world's own rules; straight on as before; the
            template driven most in training; nobody (it stands); the template nearest to what the
            rules would do.
        routes: How many routes, two in each town.
        seed: Of towns, traffic, light and weather.
        mode: Traffic that answers what the car does, or that does what it did in the recording.
        workers: Processes; changes nothing but the time it takes.
        dask: Address of a dask scheduler, as tcp://host:8786; its workers then drive. They must
            see the folders under the same names.
        choose: Which template is driven: the most probable one, or the one least far on average
            from one that is drawn.
        route_gate: Mask templates that leave the route, which the planner is not told.
        duration_s: Length of a route, of which the world's rules drive the first 2 s.
        image_scale: Size of the images as a share of the rig's; that of the run's data if not
            given.
        beside: Folders of results to compare with, on the routes that are in both.
        video: Write a video of each route, too; needs PyAV (`pip install 'shoot-planner[video]'`).
    """

    run: Annotated[str | None, tyro.conf.Positional] = None
    out: Path = Path("routes")
    driver: DriverName = "run"
    routes: Annotated[int, Bounds(1, 10_000)] = 100
    seed: Seed = 0
    mode: Mode = "reactive"
    workers: Workers = 2
    dask: str | None = None
    choose: Choose = "most_probable"
    route_gate: bool = True
    duration_s: Annotated[float, Bounds(4.0, 60.0)] = 20.0
    image_scale: Annotated[float | None, Bounds(*IMAGE_SCALES)] = None
    beside: tuple[Path, ...] = ()
    video: bool = False

    def __post_init__(self) -> None:
        check_settings(self)


def simulate(config: SimulateConfig) -> Summary:
    """Drive, print the table and save summary and page.

    Raises:
        DataError: If the run is not as it should be, or the folder holds something else.
        OSError: If a file cannot be written.
    """
    driver = DriverSettings(config.driver, config.run, config.choose, config.route_gate)
    car = car_of(driver, config.image_scale)
    settings = RouteSettings(driver, car, config.mode, config.seed, config.duration_s)
    rows = run_routes(
        settings, config.routes, config.out, config.workers, config.dask, config.video
    )
    summary = sum_up(rows, settings.card(), config.beside)
    summary.save(config.out)
    print(format_routes(summary))
    page = write_driving_page(config.out, summary.to_json(), rows, config.beside)
    print(f"Summary: {config.out / SUMMARY}\nPage: {page}")
    return summary


def main() -> None:
    """Entry point of `shoot-simulate`."""
    run(SimulateConfig, simulate, "Drive routes through towns not seen before, and score them.")
