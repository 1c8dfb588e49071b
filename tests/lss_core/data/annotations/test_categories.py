from pathlib import Path

import pytest
from driving_world import (
    config_of,
    label_split,
    standing,
    straight,
    values_of_first,
    write_drive,
)

from lss_core.data.annotations.categories import is_road_user
from shoot.evaluation.driving_checks import DrivingChecks

LYFT = ("car", "pedestrian", "other_vehicle", "bus", "motorcycle", "truck", "emergency_vehicle",
        "bicycle")  # fmt: skip
ARGOVERSE = (
    "REGULAR_VEHICLE", "PEDESTRIAN", "BICYCLIST", "MOTORCYCLIST", "WHEELED_RIDER", "BICYCLE",
    "MOTORCYCLE", "WHEELED_DEVICE", "WHEELCHAIR", "STROLLER", "BOX_TRUCK", "TRUCK", "TRUCK_CAB",
    "BUS", "SCHOOL_BUS", "ARTICULATED_BUS", "LARGE_VEHICLE", "VEHICULAR_TRAILER",
    "RAILED_VEHICLE", "OFFICIAL_SIGNALER",
)  # fmt: skip
NUSCENES = ("vehicle.car", "vehicle.emergency.police", "human.pedestrian.adult", "Vehicle.Car",
            "vehicle", "human")  # fmt: skip
OTHERS = (
    "Car",
    "Van",
    "Cyclist",
    "Person_sitting",
    "person sitting",
    "TYPE_VEHICLE",
    "other-vehicle",
)
THINGS = ("movable_object.barrier", "static_object.bicycle_rack", "animal", "DOG", "BOLLARD",
          "CONSTRUCTION_CONE", "STOP_SIGN", "traffic_cone", "DontCare")  # fmt: skip
NOBODY_KNOWS = ("autorickshaw", "fahrzeug.auto", "", "vehicles.", "superhuman", "1")


@pytest.mark.parametrize("name", [*NUSCENES, *LYFT, *ARGOVERSE, *OTHERS])
def test_vehicles_and_people_count_in_many_words(name: str) -> None:
    assert is_road_user(name) is True


@pytest.mark.parametrize("name", THINGS)
def test_things_and_animals_do_not_count(name: str) -> None:
    assert is_road_user(name) is False


@pytest.mark.parametrize("name", NOBODY_KNOWS)
def test_what_nobody_knows_is_neither(name: str) -> None:
    assert is_road_user(name) is None


@pytest.mark.parametrize("name", ["car", "PEDESTRIAN", "REGULAR_VEHICLE", "vehicle"])
def test_a_path_collides_with_a_car_by_any_name(tmp_path: Path, name: str) -> None:
    data = config_of(write_drive(tmp_path, [standing(12.0, 6.0, category=name)]))
    split = label_split(data)
    checks = DrivingChecks(split, data)
    path_m = straight(5.0, offset_m=6.0)
    assert values_of_first(checks, split, path_m, "collision")[-1] == 100.0
    assert checks.basis.boxes == {name: 1}
