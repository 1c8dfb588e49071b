"""Many routes driven: over processes, each result a file that is there whole or not at all."""

from collections import defaultdict
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import Any

import cv2
import torch

from lss_core.errors import DataError
from lss_core.files import clear_leftovers, sole_writer
from lss_core.progress import progress
from shoot.jobs.parallel import run_jobs
from shoot.metrics.driving_score.score import NAME
from shoot.simulation.drivers.driver import drive
from shoot.simulation.drivers.making import DriverSettings, make_driver
from shoot.simulation.filming.film import Film, Reel
from shoot.simulation.filming.video import import_av
from shoot.simulation.route_log import Mode
from shoot.simulation.routes.orders import RouteOrder, route_orders
from shoot.simulation.routes.pictures import mishaps_of, write_pictures
from shoot.simulation.routes.result import failure_of, result_of, score_rules
from shoot.simulation.routes.result_files import (
    ROUTES,
    Row,
    read_object,
    route_file,
    settle_settings,
    video_file,
    write_row,
)
from shoot.simulation.routes.scene import scene_of
from shoot.simulation.senses import SensorSettings
from shoot.simulation.simulator import Simulator
from shoot.world.config import WORLD_FORMAT
from shoot.world.town.roads import make_town
from shoot.world.town.town import Town

# Raise it whenever the same settings would give other bytes: results must not mix two loops.
LOOP_FORMAT = 1


@dataclass(frozen=True)
class RouteSettings:
    """What decides the result of a route, its number aside.

    Attributes:
        driver: Who drives.
        car: What it carries.
        mode: Whether traffic answers.
        seed: Of the routes.
        duration_s: Length of each.
    """

    driver: DriverSettings
    car: SensorSettings
    mode: Mode
    seed: int
    duration_s: float

    def card(self) -> dict[str, Any]:
        """The same as JSON, with the versions of what it goes through."""
        car = asdict(self.car)
        return {
            "loop_format": LOOP_FORMAT,
            "world_format": WORLD_FORMAT,
            "score": NAME,
            **self.driver.card(),
            "mode": self.mode,
            "seed": self.seed,
            "duration_s": self.duration_s,
            **{name: car[name] for name in ("rig", "image_scale", "lidar_azimuths")},
        }


def run_routes(
    settings: RouteSettings,
    num: int,
    folder: Path,
    workers: int = 1,
    dask: str | None = None,
    with_video: bool = False,
) -> list[Row]:
    """Drive the first `num` routes of a seed, except those that are there; returns all results.

    The bytes of the results depend neither on workers nor on what was there.

    Args:
        settings: Of all of them.
        num: How many.
        folder: Of the results; one file a route.
        workers: Processes.
        dask: Address of a dask scheduler, see `run_jobs`.
        with_video: Write a video of each route, too; routes that have none are driven again.

    Raises:
        DataError: If the folder holds results of other settings, the driver cannot be had, or
            videos are wanted and cannot be written here.
    """
    if with_video:
        import_av()
    orders = list(route_orders(num, settings.seed))
    with sole_writer(folder):
        settle_settings(folder, settings.card())
        clear_leftovers(folder)
        (folder / ROUTES).mkdir(exist_ok=True)
        towns: defaultdict[int, list[RouteOrder]] = defaultdict(list)
        for order in orders:
            if not _is_done(folder, order, with_video):
                towns[order.town].append(order)
        still_to_do = sum(map(len, towns.values()))
        job = partial(
            _drive_town, settings=settings, folder=folder.absolute(), with_video=with_video
        )
        with progress("Routes", num, num - still_to_do) as advance:
            for count in run_jobs(job, list(towns.values()), workers, dask, folder):
                advance(count)
        return [_read(route_file(folder, order.index), order) for order in orders]


def _read(path: Path, order: RouteOrder) -> Row:
    row = read_object(path)
    if (row.get("town_seed"), row.get("seed")) != (order.town_seed, order.seed):
        raise DataError(f"'{path}' is not of route {order.index}; take it away, it is driven anew.")
    return row


def _is_done(folder: Path, order: RouteOrder, with_video: bool) -> bool:
    """Whether a route's result is there, and its video if wanted; a failure has no pictures."""
    path = route_file(folder, order.index)
    if not path.exists() or not with_video:
        return path.exists()
    is_failure = _read(path, order)["error"] is not None
    return is_failure or video_file(folder, order.index).exists()


def _drive_town(
    orders: list[RouteOrder], settings: RouteSettings, folder: Path, with_video: bool
) -> int:
    """Drive routes of one town, and write their results."""
    with _one_thread():
        town = make_town(orders[0].town_seed)
        for order in orders:
            row, film = _drive_route(order, town, settings)
            if film is not None:  # before the result, which says that all is done
                write_pictures(film, folder, order.index, with_video)
            write_row(route_file(folder, order.index), row)
    return len(orders)


def _drive_route(order: RouteOrder, town: Town, settings: RouteSettings) -> tuple[Row, Film | None]:
    """A route's result and, if it was driven to its end, what is to be shown of it."""
    mode, duration_s = settings.mode, settings.duration_s
    driver = make_driver(settings.driver)
    try:
        by_rules = Simulator(town, order.seed, mode, duration_s=duration_s)
        by_rules.reset()
        reference_m = score_rules(by_rules.finish_by_rules(), town)
        reel = Reel()
        log = drive(driver, town, order.seed, mode, settings.car, duration_s, reel.keep)
        scene = scene_of(log, town)
        mishaps = mishaps_of(scene)
        film = Film(town, log, reel.views if driver.cameras else (), driver.name, mishaps)
        return result_of(order, log, scene, mishaps, reference_m), film
    except (OSError, MemoryError):  # of the machine, not of the driver
        raise
    except DataError as error:
        return failure_of(order, mode, error.sentence), None
    except Exception as error:
        return failure_of(order, mode, f"{type(error).__name__}: {error}"), None


@contextmanager
def _one_thread() -> Iterator[None]:
    """Let networks compute on one core: workers share the machine, and sums keep their order."""
    before = torch.get_num_threads()
    cv2.setNumThreads(1)
    torch.set_num_threads(1)
    try:
        yield
    finally:
        torch.set_num_threads(before)
