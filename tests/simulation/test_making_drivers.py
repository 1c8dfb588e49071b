"""Drivers by name, and the car that goes with a run."""

from dataclasses import replace
from pathlib import Path
from typing import get_args

import pytest
from world_fixture import TinyRun, copy_run

from lss_core.errors import DataError
from lss_core.strict_json import save_json
from shoot.simulation.drivers.making import (
    OF_RUNS,
    DriverName,
    DriverSettings,
    car_of,
    make_driver,
)


@pytest.mark.parametrize("name", get_args(DriverName))
def test_a_driver_has_the_name_it_was_asked_by(name: DriverName, tiny_run: TinyRun) -> None:
    run = str(tiny_run.folder) if name in OF_RUNS else None
    settings = DriverSettings(name, run)
    assert make_driver(settings).name == name
    assert settings.card()["driver"] == name
    with pytest.raises(DataError, match="run folder"):
        DriverSettings(name, None if run else "run")


def test_what_was_learned_is_told_apart_and_where_it_lies_is_not(
    tiny_run: TinyRun, tmp_path: Path
) -> None:
    here = DriverSettings("run", str(tiny_run.folder))
    copied = DriverSettings("run", str(copy_run(tiny_run, tmp_path).folder))
    assert here.card() == copied.card()
    assert replace(here, name="prior").card()["learned"] != here.card()["learned"]
    assert replace(here, route_gate=False).card() != here.card()


def test_a_car_carries_what_the_world_of_its_run_was_seen_with(
    tiny_run: TinyRun, tmp_path: Path
) -> None:
    run = copy_run(tiny_run, tmp_path)
    settings = DriverSettings("run", str(run.folder))
    usual = car_of(settings)  # its data are no world
    assert (usual.rig, usual.image_scale, usual.lidar_azimuths) == ("nuscenes", 0.11, 384)
    save_json({"rig": "lyft", "image_scale": 0.3, "lidar_azimuths": 0}, run.root / "world.json")
    car = car_of(settings)
    assert (car.rig, car.image_scale, car.lidar_azimuths) == ("lyft", 0.3, 1024)
    assert car_of(settings, 0.08).image_scale == 0.08
