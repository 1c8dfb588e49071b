"""Calibrations that belong to other images, or to no car: each mistake is named."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from tiny_tables import TRAIN_A, VAL, VERSION, read_table, write_table, write_tiny

from lss_core.config import CAMERAS
from lss_core.data.checks.calibration import camera_flaws
from lss_core.data.samples import SampleIndex, load_index

NUM = len(CAMERAS)
HEIGHT, WIDTH = 90, 160
Row = dict[str, Any]
Change = Callable[[Row], Row]


@pytest.fixture(scope="module")
def tables(tmp_path_factory: pytest.TempPathFactory) -> dict[str, list[Row]]:
    root = tmp_path_factory.mktemp("calibrations")
    write_tiny(root, (TRAIN_A, VAL), image_hw=(HEIGHT, WIDTH))
    return {path.stem: read_table(root, path.stem) for path in (root / VERSION).glob("*.json")}


@pytest.fixture
def load(tmp_path: Path, tables: dict[str, list[Row]], monkeypatch: pytest.MonkeyPatch) -> Any:
    monkeypatch.setenv("SHOOT_CACHE", str(tmp_path / "cache"))

    def load(**changed: list[Row]) -> SampleIndex:
        (tmp_path / VERSION).mkdir()
        for name, records in (tables | changed).items():
            write_table(tmp_path, name, records)
        return load_index(tmp_path, VERSION, CAMERAS)

    return load


def is_camera(row: Row) -> bool:
    return bool(row["camera_intrinsic"])


def intrinsics(change: Callable[[np.ndarray], Any]) -> Change:
    return lambda row: row | {"camera_intrinsic": np.asarray(
        change(np.asarray(row["camera_intrinsic"]))).tolist()}  # fmt: skip


def times(*factors: float) -> Change:
    return intrinsics(lambda matrix: np.diag(factors) @ matrix)


def mounted(change: Callable[[Rotation, np.ndarray], tuple[Rotation, Any]]) -> Change:
    def of(row: Row) -> Row:
        rotation = Rotation.from_quat(np.roll(row["rotation"], -1))
        rotation, place = change(rotation, np.asarray(row["translation"]))
        x, y, z, w = rotation.as_quat()
        return row | {"rotation": [w, x, y, z], "translation": np.asarray(place).tolist()}

    return of


def inverted(rotation: Rotation, place: np.ndarray) -> tuple[Rotation, Any]:
    return rotation.inv(), -rotation.inv().apply(place)


def of_car_axes(rotation: Rotation, place: np.ndarray) -> tuple[Rotation, Any]:
    forward_left_up = Rotation.from_matrix([[0, -1, 0], [0, 0, -1], [1, 0, 0]])
    return rotation * forward_left_up, place


def z_down(rotation: Rotation, place: np.ndarray) -> tuple[Rotation, Any]:
    flip = Rotation.from_euler("x", np.pi)
    return flip * rotation, flip.apply(place)


def x_last(row: Row) -> Row:
    return row | {"rotation": [*row["rotation"][1:], row["rotation"][0]]}


def distorted(*numbers: Any) -> Change:
    return lambda row: row | {"camera_distortion": list(numbers)}


# What is done to the calibrations of all cameras, what is said, and of how many cameras.
MISTAKES: dict[str, tuple[Change, str, int]] = {
    "half-size images": (times(2, 2, 1), "images 2 times as large", NUM),
    "1.6 times": (times(1.6, 1.6, 1), "images 1.6 times as large", NUM),
    "double-size images": (times(0.5, 0.5, 1), "images 0.5 times as large", NUM),
    "turned": (
        intrinsics(lambda m: m[[1, 0, 2]][:, [1, 0, 2]]), "width and height look swapped", NUM
    ),
    "shares": (times(1 / WIDTH, 1 / HEIGHT, 1), "shares of the image", NUM),
    "millimetres": (
        intrinsics(lambda m: [[0.5, 0, m[0][2]], [0, 0.5, m[1][2]], [0, 0, 1]]), "millimetres", NUM
    ),
    "transposed": (intrinsics(np.transpose), "looks transposed", NUM),
    "inverted": (mounted(inverted), "mounting looks inverted", 4),
    "rotation inverted": (mounted(lambda r, t: (r.inv(), t)), "rotation looks inverted", 4),
    "x, y, z, w": (x_last, "x, y, z, w", 3),
    "car's axes": (mounted(of_car_axes), "x forward, y left, z up", NUM),
    "z down": (mounted(z_down), "x forward, y right, z down", NUM),
    "upside down": (
        mounted(lambda r, t: (r * Rotation.from_euler("z", np.pi), t)), "upside down", NUM
    ),
    "distorted": (distorted(-0.3, 0.1, 0.0, 0.0, 0.0), "undistort the images", NUM),
    "distorted fisheye": (distorted([0.05, 0.01, 0, 0, 0, 0.002]), "undistort the images", NUM),
}  # fmt: skip


@pytest.mark.parametrize("mistake", MISTAKES)
def test_mistakes_of_all_cameras_are_named(
    load: Any, tables: dict[str, list[Row]], mistake: str
) -> None:
    change, named, num = MISTAKES[mistake]
    rows = [change(row) if is_camera(row) else row for row in tables["calibrated_sensor"]]
    index = load(calibrated_sensor=rows)
    flawed = np.flatnonzero((index.camera_problem > 0).all(axis=0))
    assert len(flawed) >= num
    texts = index.problem_text[index.camera_problem[0, flawed]].tolist()
    assert all(f"{VERSION}/calibrated_sensor.json has " in text for text in texts)
    assert sum(named in text for text in texts) >= num, texts
    assert not index.scene_problem.any()


def test_one_inverted_camera_is_named_and_no_other(load: Any, tables: dict[str, list[Row]]) -> None:
    wrong = f"{VAL.name}-{CAMERAS[0]}"
    rows = [
        mounted(inverted)(row) if row["token"] == wrong else row
        for row in tables["calibrated_sensor"]
    ]
    index = load(calibrated_sensor=rows)
    assert (index.camera_problem > 0).sum() == 17
    (text,) = {index.problem_text[number] for number in np.unique(index.camera_problem) if number}
    assert f"record '{wrong}'" in text
    assert "1.7 m below the road" in text
    assert "inverted" in text


def test_sizes_that_are_not_known_say_nothing(load: Any, tables: dict[str, list[Row]]) -> None:
    sizes = {"width": 0, "height": 0}
    index = load(
        calibrated_sensor=[
            times(2, 2, 1)(row) if is_camera(row) else row for row in tables["calibrated_sensor"]
        ],
        sample_data=[row | sizes for row in tables["sample_data"]],
    )
    assert not index.camera_problem.any()


def camera(
    share_xy: tuple[float, float] = (0.5, 0.5),
    focal: float = 0.8,
    yaw_deg: float = 0.0,
    pitch_deg: float = 0.0,
    height_m: float = 1.5,
    size_wh: tuple[int, int] = (1600, 900),
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Intrinsics, mounting and image size of a camera that looks down by a pitch."""
    width, height = size_wh
    matrix = np.array(
        [
            [focal * width, 0.0, share_xy[0] * width],
            [0.0, focal * width, share_xy[1] * height],
            [0.0, 0.0, 1.0],
        ]
    )
    mounting = np.eye(4)
    turned = Rotation.from_euler("zy", [yaw_deg, pitch_deg], degrees=True).as_matrix()
    mounting[:3, :3] = turned @ [[0, 0, 1], [-1, 0, 0], [0, -1, 0]]
    mounting[:3, 3] = [1.5, 0.3, height_m]
    return matrix[None], mounting[None], np.array([[height, width]])


@pytest.mark.parametrize("yaw_deg", range(-180, 180, 45))
@pytest.mark.parametrize(
    "made",
    [
        {},
        {"share_xy": (0.51, 0.546)},  # nuScenes
        {"share_xy": (0.487, 0.411), "focal": 2.06},  # Lyft's telephoto
        {"share_xy": (0.5, 0.49), "size_wh": (1550, 2048)},  # Argoverse 2's portrait
        {"share_xy": (0.5, 0.27), "size_wh": (1920, 886)},  # cut off above
        {"focal": 0.25, "pitch_deg": 35.0},  # a wide one that looks down
        {"height_m": -0.4},  # of an ego frame on the roof
        {"height_m": 3.5},  # a truck's
    ],
)
def test_usual_cameras_have_no_flaw(made: dict[str, Any], yaw_deg: float) -> None:
    matrix, mounting, image_hw = camera(yaw_deg=yaw_deg, **made)
    assert camera_flaws(matrix, mounting, image_hw, [None]) == []


def test_doubtful_cameras_are_worth_a_word(load: Any, tables: dict[str, list[Row]]) -> None:
    cut = intrinsics(lambda matrix: matrix - _SHIFT)
    index = load(
        calibrated_sensor=[
            cut(row) if is_camera(row) else row for row in tables["calibrated_sensor"]
        ]
    )
    assert not index.camera_problem.any()
    assert index.warning_reason.tolist() == ["calibration against image"]
    assert index.warning_text[0].startswith("12 of 12 calibrations look strange")


# Of images whose upper part was cut off: the principal point goes up.
_SHIFT = np.array([[0, 0, 0], [0, 0, 0.32 * HEIGHT], [0, 0, 0]])


def test_distortion_is_as_opencv_has_it() -> None:
    cv2 = pytest.importorskip("cv2")
    matrix, mounting, image_hw = camera()
    numbers = np.array([-0.002, 0.001, 0.0004, -0.0003, 0.0005])
    corners = np.array([[0, 0], [1600, 0], [0, 900], [1600, 900]], dtype=np.float64)
    rays = (corners - matrix[0, :2, 2]) / matrix[0, 0, 0]
    moved, _ = cv2.projectPoints(
        np.column_stack([rays, np.ones(4)]), np.zeros(3), np.zeros(3), matrix[0], numbers
    )
    shift_px = np.linalg.norm(moved[:, 0] - corners, axis=-1).max()
    for factor, is_flaw in ((1.9 / shift_px, False), (2.1 / shift_px, True)):
        flaws = camera_flaws(matrix, mounting, image_hw, [(factor * numbers).tolist()])
        assert bool(flaws) == is_flaw
    # Other models are not known.
    assert camera_flaws(matrix, mounting, image_hw, [{"k": [0.0, 0.01]}])[0].is_sure
    assert camera_flaws(matrix, mounting, image_hw, [[0.0, 0.0, 0.0, 0.0, 0.0, 1e-4]]) == []
