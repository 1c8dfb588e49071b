"""From a driver's name to the driver, and what its car carries."""

import hashlib
import json
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any, Literal

from lss_core.errors import DataError
from shoot.prediction.run import TrainedRun, open_run
from shoot.simulation.drivers.choice import Choose
from shoot.simulation.drivers.driver import Driver
from shoot.simulation.drivers.simple import ConstantVelocityDriver, RuleDriver, StillDriver
from shoot.simulation.drivers.templates import OracleDriver, PriorDriver, RunDriver
from shoot.simulation.senses import SensorSettings
from shoot.training.planning.run_folder import PlanningRun
from shoot.world.config import CARD, azimuths_for

DriverName = Literal["run", "rule", "constant_velocity", "prior", "still", "oracle"]
OF_RUNS: tuple[DriverName, ...] = ("run", "prior", "oracle")
# The oracle knows where it is going.
OF_GATES: tuple[DriverName, ...] = ("run", "prior")
# As in the worlds that the shipped planner and the small preset are trained on.
USUAL_IMAGE_SCALE = 0.11


@dataclass(frozen=True)
class DriverSettings:
    """Who drives, and how.

    Attributes:
        name: Which driver.
        run: Folder of the run that it needs, of `OF_RUNS`.
        choose: Which template it takes, of `OF_RUNS`.
        route_gate: Whether templates that leave the route are masked, of `OF_GATES`.

    Raises:
        DataError: If a run is missing, or given to one that needs none.
    """

    name: DriverName
    run: str | None = None
    choose: Choose = "most_probable"
    route_gate: bool = True

    def __post_init__(self) -> None:
        if (self.run is not None) != (self.name in OF_RUNS):
            raise DataError(
                f"The driver '{self.name}' needs a run folder; name one."
                if self.run is None
                else f"The driver '{self.name}' takes no run folder; leave '{self.run}' out."
            )

    def card(self) -> dict[str, Any]:
        """What decides how it drives; of a run what it has learned, not where it lies.

        Raises:
            DataError: If the run cannot be opened.
        """
        card: dict[str, Any] = {"driver": self.name}
        if self.name in OF_RUNS:
            card |= {"choose": self.choose, "learned": _digest(self)}
        if self.name in OF_GATES:
            card["route_gate"] = self.route_gate
        return card


@lru_cache(maxsize=1)
def make_driver(settings: DriverSettings) -> Driver:
    """The driver; the same object for the same settings.

    Raises:
        DataError: If its run cannot be opened.
    """
    if settings.name == "rule":
        return RuleDriver()
    if settings.name == "constant_velocity":
        return ConstantVelocityDriver()
    if settings.run is None:
        return StillDriver()
    if settings.name == "run":
        return RunDriver(_open(settings.run), settings.choose, settings.route_gate)
    if settings.name == "prior":
        return PriorDriver(PlanningRun(Path(settings.run)), settings.choose, settings.route_gate)
    return OracleDriver(PlanningRun(Path(settings.run)).templates(), settings.choose)


def car_of(settings: DriverSettings, image_scale: float | None = None) -> SensorSettings:
    """What its car carries: the rig, size of images and lidar of the world its run was trained on.

    Args:
        settings: Of the driver.
        image_scale: Another size of the images; None: that of the run's data, if these are a world
            and still where they were, else `USUAL_IMAGE_SCALE`.
    """
    world = {} if settings.run is None else _card_of_world(Path(settings.run))
    scale = image_scale or world.get("image_scale", USUAL_IMAGE_SCALE)
    return SensorSettings(
        rig=world.get("rig", "nuscenes"),
        image_scale=scale,
        lidar_azimuths=world.get("lidar_azimuths") or azimuths_for(scale),
    )


def _card_of_world(run: Path) -> dict[str, Any]:
    """How the world was made that a run was trained on; empty if its data are no world, or gone."""
    path = Path(PlanningRun(run).config().data.root) / CARD
    try:
        card = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return {}
    return card if isinstance(card, dict) else {}


@lru_cache(maxsize=1)
def _open(folder: str) -> TrainedRun:
    return open_run(folder)


def _digest(settings: DriverSettings) -> str:
    """sha256 of templates and weights."""
    assert settings.run is not None
    if settings.name != "run":
        return PlanningRun(Path(settings.run)).templates().sha256
    run = _open(settings.run)
    digest = hashlib.sha256(run.templates.sha256.encode())
    for name, value in sorted(run.module.state_dict().items()):
        digest.update(name.encode() + value.cpu().numpy().tobytes())
    return digest.hexdigest()
