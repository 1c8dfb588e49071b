"""Off-road, and both checks on a real scene and in the synthetic city."""

import math
import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from driving_world import (
    NUM_SAMPLES,
    WIDE_ROAD,
    config_of,
    label_split,
    straight,
    values_of_first,
    write_drive,
    write_road,
)

from lss_core.config import CAMERAS, DataConfig
from lss_core.data.samples import SampleIndex
from lss_core.errors import DataError
from shoot.evaluation.driving_checks import CHECK_HORIZONS_S, DrivingChecks


@pytest.mark.parametrize(
    ("right_m", "left_m", "expected"),
    [(-1.0, 1.0, 0.0), (-9.0, 0.9, 100.0), (-0.9, 9.0, 100.0)],
)
def test_a_corner_may_be_off_the_road_while_the_middle_is_on_it(
    tmp_path: Path, right_m: float, left_m: float, expected: float
) -> None:
    data = config_of(write_drive(tmp_path))
    # Half of the car is 0.925 m wide. The last sample's path ends at 80 m.
    outline = [(-5.0, right_m), (90.0, right_m), (90.0, left_m), (-5.0, left_m)]
    write_road(tmp_path, [[outline, []]])
    split = label_split(data)
    values = DrivingChecks(split, data)(split.futures.xy_m)
    for horizon_s in CHECK_HORIZONS_S:
        assert values[f"off_road_{horizon_s}s"].tolist() == [expected] * NUM_SAMPLES


def test_a_turned_ego_has_its_corners_elsewhere(tmp_path: Path) -> None:
    data = config_of(write_drive(tmp_path))
    write_road(tmp_path, [[[(-5.0, -2.0), (90.0, -2.0), (90.0, 2.0), (-5.0, 2.0)], []]])
    split = label_split(data)
    checks = DrivingChecks(split, data)
    # The front left corner is 1.06 m + 0.87 m further left than the axle at 20 degrees; the axle is
    # at y = 0.086 m after the first quarter of a second.
    path_m = straight(1.0, math.radians(20.0))
    assert values_of_first(checks, split, path_m, "off_road") == [100.0] * 4
    path_m = straight(0.5, math.radians(20.0))
    assert values_of_first(checks, split, path_m, "off_road") == [100.0] * 4
    # At 10 degrees it is 0.54 m + 0.91 m: y = 2 m is reached when the axle is at 0.55 m, at 3.2 m.
    path_m = straight(1.0, math.radians(10.0))
    assert values_of_first(checks, split, path_m, "off_road") == [0.0, 0.0, 0.0, 100.0]


def test_each_horizon_sees_the_road_end_in_time(tmp_path: Path) -> None:
    data = config_of(write_drive(tmp_path))
    write_road(tmp_path, [[[(-5.0, -9.0), (23.0, -9.0), (23.0, 9.0), (-5.0, 9.0)], []]])
    split = label_split(data)
    checks = DrivingChecks(split, data)
    # The front bumper is at x = 23.1 m after 2 s at 10 m/s, and after 4 s at 5 m/s.
    assert values_of_first(checks, split, straight(10.0), "off_road") == [0.0, 100.0, 100.0, 100.0]
    assert values_of_first(checks, split, straight(5.0), "off_road") == [0.0, 0.0, 0.0, 100.0]
    assert values_of_first(checks, split, straight(3.9), "off_road") == [0.0] * 4


def test_times_without_a_point_have_no_rate(tmp_path: Path) -> None:
    """The road ends at 26 m: on it at 2 s, off it at 3 s; the paths end before 5 s."""
    data = config_of(write_drive(tmp_path))
    write_road(tmp_path, [[[(-50.0, -50.0), (26.0, -50.0), (26.0, 50.0), (-50.0, 50.0)], []]])
    for dt_s, horizons_s in ((1.0, (1, 2, 3)), (0.3, (3,)), (0.7, ())):
        num_points = int(4.0 / dt_s)
        split = label_split(data, horizon_s=num_points * dt_s, dt_s=dt_s)
        checks = DrivingChecks(split, data)(split.futures.xy_m)
        values = {name: float(value[0]) for name, value in checks.items() if "off" in name}
        found = {1: 0.0, 2: 0.0, 3: 100.0}
        assert values == {f"off_road_{at_s}s": found[at_s] for at_s in horizons_s}


def test_holes_in_the_road_are_off_it(tmp_path: Path) -> None:
    data = config_of(write_drive(tmp_path))
    hole = [(8.0, 0.5), (16.0, 0.5), (16.0, 6.0), (8.0, 6.0)]
    write_road(tmp_path, [[WIDE_ROAD[0], [hole]]])
    split = label_split(data)
    checks = DrivingChecks(split, data)
    assert values_of_first(checks, split, straight(3.0), "off_road") == [0.0, 100.0, 100.0, 100.0]
    assert values_of_first(checks, split, straight(3.0, offset_m=-0.5), "off_road") == [0.0] * 4


def test_a_map_that_is_missing_beside_others_is_an_error(tmp_path: Path) -> None:
    data = config_of(write_drive(tmp_path))
    write_road(tmp_path, [WIDE_ROAD])
    split = label_split(data, change=_two_locations)
    with pytest.raises(DataError, match=r"singapore-onenorth\.json' is missing"):
        DrivingChecks(split, data)


def _two_locations(index: SampleIndex) -> SampleIndex:
    """The last samples get a scene of their own, elsewhere."""
    scene = index.sample_scene.copy()
    scene[3:] = 1
    return replace(
        index,
        sample_scene=scene,
        scene_name=np.array(["scene-0003", "scene-0012"]),
        scene_location=np.array(["boston-seaport", "singapore-onenorth"]),
    )


def test_each_sample_is_looked_up_in_its_own_map(tmp_path: Path) -> None:
    data = config_of(write_drive(tmp_path))
    write_road(tmp_path, [WIDE_ROAD])
    nowhere = [[(500.0, 0.0), (501.0, 0.0), (500.0, 1.0)], []]
    write_road(tmp_path, [nowhere], location="singapore-onenorth")
    split = label_split(data, change=_two_locations)
    values = DrivingChecks(split, data)(split.futures.xy_m)["off_road_1s"]
    assert values.tolist() == [0.0] * 3 + [100.0] * 4


@pytest.mark.real
def test_a_real_driver_stays_on_the_road_and_a_swerve_does_not(real_root: Path) -> None:
    data = DataConfig(root=str(real_root), version="v1.0-mini", cameras=CAMERAS)
    split = label_split(data, "train")
    checks = DrivingChecks(split, data)
    driven = checks(split.futures.xy_m)
    assert len(split.labels) == 28
    for horizon_s in CHECK_HORIZONS_S:
        assert (driven[f"collision_{horizon_s}s"] == 0.0).all()
        assert (driven[f"off_road_{horizon_s}s"] == 0.0).all()
    # A sharp swerve to either side ends in something, or off the road.
    swerves = split.futures.xy_m[..., ::-1] * [0.0, 1.0]
    for side in (-1.0, 1.0):
        values = checks(side * swerves)
        assert values["off_road_5s"].mean() > 50.0


@pytest.fixture(scope="module")
def city(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two scenes of the synthetic city, made in a process without the slow checks of types."""
    root = tmp_path_factory.mktemp("worlds") / "city"
    flags = ["--train-scenes", "0", "--val-scenes", "2", "--seed", "5", "--image-scale", "0.05"]
    flags += ["--duration-s", "9", "--lidar-azimuths", "48", "--workers", "1"]
    code = "from shoot.cli.make_world import main; main()"
    environment = {**os.environ, "OMP_NUM_THREADS": "1"}
    subprocess.run(
        [sys.executable, "-c", code, str(root), *flags],
        stdout=subprocess.DEVNULL,
        env=environment,
        check=True,
    )
    return root


def test_drivers_of_the_city_neither_collide_nor_leave_the_road(city: Path) -> None:
    data = config_of(city)
    split = label_split(data)
    checks = DrivingChecks(split, data)
    values = checks(split.futures.xy_m)
    # Nobody is hit there, so no box needs to be left out: frames, times and sizes agree.
    assert checks.num_boxes_left_out == 0
    assert len(split.labels) > 8
    for horizon_s in CHECK_HORIZONS_S:
        assert (values[f"off_road_{horizon_s}s"] == 0.0).all()
        assert np.nanmax(values[f"collision_{horizon_s}s"]) == 0.0
    # Mirrored and turned paths do leave it.
    swerve = np.stack([0.2 * split.futures.xy_m[..., 0], split.futures.xy_m[..., 0]], axis=-1)
    assert checks(swerve)["off_road_5s"].max() == 100.0
