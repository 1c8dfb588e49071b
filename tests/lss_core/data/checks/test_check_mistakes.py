"""What shoot-check says of poses and calibrations that were made wrong on purpose."""

from pathlib import Path
from typing import Any

import pytest
import test_camera_mountings
import test_poses
from tiny_tables import TRAIN_A, TRAIN_B, VAL, VERSION, read_table, write_table, write_tiny
from world_fixture import command

from lss_core.config import CAMERAS

Row = dict[str, Any]


@pytest.fixture(scope="module")
def root(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Six cameras, three scenes; each test writes one of its tables."""
    folder = tmp_path_factory.mktemp("mistakes")
    image_hw = test_camera_mountings.HEIGHT, test_camera_mountings.WIDTH
    return write_tiny(folder, (TRAIN_A, TRAIN_B, VAL), cameras=CAMERAS, image_hw=image_hw)


def said_of(root: Path, table: str, rows: list[Row]) -> str:
    """What the command prints of the data set with another table, in one line."""
    right = read_table(root, table)
    write_table(root, table, rows)
    try:
        said = command("shoot-check", "--data.root", root, "--data.version", VERSION)
    finally:
        write_table(root, table, right)
    assert said.status == 2, said.out
    assert len(said.err.strip().splitlines()) == 1
    return " ".join(said.out.split())


@pytest.mark.parametrize("mistake", test_poses.MISTAKES)
def test_mistakes_of_poses_are_named(root: Path, mistake: str) -> None:
    change, measured, named = test_poses.MISTAKES[mistake]
    said = said_of(root, "ego_pose", [change(pose) for pose in read_table(root, "ego_pose")])
    assert measured in said
    assert named in said


@pytest.mark.parametrize("mistake", test_camera_mountings.MISTAKES)
def test_mistakes_of_calibrations_are_named(root: Path, mistake: str) -> None:
    change, named, _ = test_camera_mountings.MISTAKES[mistake]
    rows = read_table(root, "calibrated_sensor")
    said = said_of(
        root,
        "calibrated_sensor",
        [change(row) if test_camera_mountings.is_camera(row) else row for row in rows],
    )
    assert named in said


def test_repeated_poses_and_one_wrong_place_are_named(root: Path) -> None:
    poses = read_table(root, "ego_pose")
    rows = {
        scene.name: [
            row
            for row, pose in enumerate(poses)
            if pose["token"].startswith(f"{scene.name}-LIDAR_TOP")
        ]
        for scene in (TRAIN_A, VAL)
    }
    own = rows[TRAIN_A.name]
    for i, row in enumerate(own):
        source = poses[own[i - i % 5]]
        poses[row] = poses[row] | {key: source[key] for key in ("translation", "rotation")}
    wrong = poses[rows[VAL.name][33]]
    wrong["translation"][1] += 8.0
    said = said_of(root, "ego_pose", poses)
    assert "the pose of a keyframe were copied to the sweeps around it" in said
    assert "off the way between the poses around it" in said
