"""The rig file: both ways of saying a mounting agree; each mistake is one sentence."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from lss_core.errors import DataError
from shoot.moment.rig_file import RigCamera, look_from, read_rig

FRONT: dict[str, Any] = {
    "name": "FRONT",
    "width_px": 400,
    "height_px": 220,
    "intrinsics": {"fx": 310.0, "fy": 312.0, "cx": 201.0, "cy": 111.0},
    "position_m": [1.7, 0.1, 1.5],
    "yaw_deg": 0.0,
}


def written(folder: Path, *cameras: object) -> Path:
    path = folder / "rig.yaml"
    path.write_text(yaml.safe_dump({"cameras": list(cameras)}))
    return path


def read_one(folder: Path, **changes: object) -> RigCamera:
    entry = {name: value for name, value in (FRONT | changes).items() if value is not None}
    (camera,) = read_rig(written(folder, entry)).cameras
    return camera


@pytest.mark.parametrize(
    ("yaw_deg", "pitch_deg", "roll_deg", "right", "down", "ahead"),
    [
        (0.0, 0.0, 0.0, (0, -1, 0), (0, 0, -1), (1, 0, 0)),
        (90.0, 0.0, 0.0, (1, 0, 0), (0, 0, -1), (0, 1, 0)),  # looks left, so its right is ahead
        (0.0, 30.0, 0.0, (0, -1, 0), (0.5, 0, -(0.75**0.5)), (0.75**0.5, 0, 0.5)),  # up
        (0.0, 0.0, 90.0, (0, 0, -1), (0, 1, 0), (1, 0, 0)),  # its right side is down
        (180.0, 30.0, 0.0, (0, 1, 0), (-0.5, 0, -(0.75**0.5)), (-(0.75**0.5), 0, 0.5)),
    ],
)
def test_angles_turn_as_they_say(
    yaw_deg: float, pitch_deg: float, roll_deg: float, right: Any, down: Any, ahead: Any
) -> None:
    pose = look_from(np.array([1.0, 2.0, 1.5]), *np.deg2rad([yaw_deg, pitch_deg, roll_deg]))
    np.testing.assert_allclose(pose[:3, :3], np.stack([right, down, ahead], axis=1), atol=1e-12)
    np.testing.assert_array_equal(pose[:, 3], [1.0, 2.0, 1.5, 1.0])


def test_matrices_and_numbers_say_the_same(tmp_path: Path) -> None:
    by_numbers = read_one(tmp_path, yaw_deg=50.0, pitch_deg=-3.0, roll_deg=2.0)
    by_matrices = read_one(
        tmp_path,
        intrinsics=[[310.0, 0.0, 201.0], [0.0, 312.0, 111.0], [0.0, 0.0, 1.0]],
        ego_from_camera=by_numbers.ego_from_camera.tolist(),
        position_m=None,
        yaw_deg=None,
    )
    assert by_matrices.image_hw == by_numbers.image_hw == (220, 400)
    np.testing.assert_array_equal(by_matrices.rawpixel_from_camera, by_numbers.rawpixel_from_camera)
    np.testing.assert_array_equal(by_matrices.ego_from_camera, by_numbers.ego_from_camera)
    assert (by_matrices.delay_s, read_one(tmp_path, delay_s=-0.02).delay_s) == (0.0, -0.02)


MIRRORED = np.diag([1.0, 1.0, -1.0, 1.0]).tolist()
LEVEL = look_from(np.array([1.7, 0.1, 1.5]), 0.0, 0.0, 0.0)
BY_MATRIX = {"position_m": None, "yaw_deg": None}

MISTAKES: dict[str, tuple[dict[str, object], str]] = {
    "no name": ({"name": None}, "number 1.name: Field required"),
    "misspelt": ({"yaw": 3.0}, "'FRONT'.yaw: Unexpected keyword"),
    "width of a text": ({"width_px": "wide"}, "'FRONT'.width_px"),
    "no height": ({"height_px": 0}, "height_px is 0, but must lie in 1"),
    "turned about more than once": ({"yaw_deg": 3000.0}, "yaw_deg is 3000"),
    "late by an hour": ({"delay_s": 3600.0}, "delay_s is 3600"),
    "no cx": ({"intrinsics": {"fx": 1.0, "fy": 1.0, "cy": 2.0}}, "give fx, fy, cx and cy"),
    "intrinsics 2 x 2": ({"intrinsics": [[1.0, 0.0], [0.0, 1.0]]}, r"shape \[3, 3\]"),
    "focal length 0": ({"intrinsics": FRONT["intrinsics"] | {"fx": 0.0}}, "camera_intrinsic"),
    "focal length no number": ({"intrinsics": FRONT["intrinsics"] | {"fx": "long"}}, "numbers"),
    "of larger images": (
        {"intrinsics": {"fx": 1240.0, "fy": 1248.0, "cx": 804.0, "cy": 444.0}},
        "intrinsics of images 4 times as large",
    ),
    "in millimetres": ({"intrinsics": FRONT["intrinsics"] | {"fx": 4, "fy": 4}}, "millimetres"),
    "width and height swapped": ({"width_px": 220, "height_px": 400}, "look swapped"),
    "distorted": ({"distortion": [-0.3, 0.1, 0.0, 0.0]}, "undistort the images first"),
    "no mounting": ({"position_m": None}, "does not say how it is mounted"),
    "no yaw": ({"yaw_deg": None}, "does not say how it is mounted"),
    "two mountings": ({"ego_from_camera": LEVEL.tolist()}, "keep one of the two"),
    "position in two numbers": ({"position_m": [1.7, 1.5]}, r"shape \[3\]"),
    "mirrored": (BY_MATRIX | {"ego_from_camera": MIRRORED}, "mirrors"),
    "inverted": (
        BY_MATRIX | {"ego_from_camera": np.linalg.inv(LEVEL).tolist()},
        "looks inverted",
    ),
    "upside down": ({"roll_deg": 180.0}, "upside down"),
}


@pytest.mark.parametrize("mistake", MISTAKES)
def test_a_mistake_is_one_sentence(mistake: str, tmp_path: Path) -> None:
    changes, sentence = MISTAKES[mistake]
    with pytest.raises(DataError, match=sentence) as refused:
        read_one(tmp_path, **changes)
    said = refused.value.sentence
    assert "rig.yaml" in said
    assert said.endswith(".")
    assert "pydantic" not in said


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("cameras: [", "is no YAML"),
        ("- FRONT", "is no rig file"),
        ("", "is no rig file"),
        ("cameras: []", "has no camera"),
        ("cameras: {FRONT: 3}", "is no rig file: cameras"),
        ("cameras: [3]", "is no rig file: cameras.number 1"),
    ],
)
def test_what_is_no_rig_file(text: str, sentence: str, tmp_path: Path) -> None:
    (tmp_path / "rig.yaml").write_text(text)
    with pytest.raises(DataError, match=sentence):
        read_rig(tmp_path / "rig.yaml")


def test_names_are_those_of_folders_and_given_once(tmp_path: Path) -> None:
    with pytest.raises(DataError, match="two cameras named 'FRONT'"):
        read_rig(written(tmp_path, FRONT, FRONT))
    for name in ("a/b", "a=b", ".."):
        with pytest.raises(DataError, match="name it otherwise"):
            read_rig(written(tmp_path, FRONT | {"name": name}))


def test_what_is_only_strange_is_told_and_taken(tmp_path: Path) -> None:
    rig = read_rig(written(tmp_path, FRONT | {"position_m": [1.7, 0.0, 7.0]}))
    assert len(rig.cameras) == 1
    assert rig.oddities == (
        "Camera 'FRONT' has its camera at a height of 7 m over the ego's origin.",
    )
