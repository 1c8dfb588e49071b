"""Poses that no car has: each mistake is named."""

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from driven_tracks import tracks_of
from scipy.spatial.transform import Rotation
from tiny_tables import (
    TRAIN_A,
    TRAIN_B,
    VAL,
    VERSION,
    TinyScene,
    read_table,
    write_table,
    write_tiny,
)

from lss_core.config import CAMERAS
from lss_core.data.checks.pose_repairs import likely_mistakes
from lss_core.data.checks.poses import find_flaws
from lss_core.data.samples import SampleIndex, load_index
from lss_core.data.tables.tracks import Tracks
from lss_core.errors import DataError

SCENES = (TRAIN_A, TRAIN_B, VAL)
Row = dict[str, Any]
Change = Callable[[Row], Row]


@pytest.fixture(scope="module")
def tables(tmp_path_factory: pytest.TempPathFactory) -> dict[str, list[Row]]:
    root = write_tiny(
        tmp_path_factory.mktemp("poses"), SCENES, cameras=CAMERAS[:2], image_hw=(9, 16)
    )
    return {path.stem: read_table(root, path.stem) for path in (root / VERSION).glob("*.json")}


@pytest.fixture
def load(tmp_path: Path, tables: dict[str, list[Row]], monkeypatch: pytest.MonkeyPatch) -> Any:
    monkeypatch.setenv("SHOOT_CACHE", str(tmp_path / "cache"))

    def load(**changed: list[Row]) -> SampleIndex:
        (tmp_path / VERSION).mkdir(exist_ok=True)
        for name, records in (tables | changed).items():
            write_table(tmp_path, name, records)
        return load_index(tmp_path, VERSION, CAMERAS[:2])

    return load


def problems(index: SampleIndex) -> list[str]:
    """Texts of the scenes' problems; empty where there is none."""
    return index.problem_text[index.scene_problem].tolist()


def turned(change: Callable[[Rotation], Rotation]) -> Change:
    """Poses with other rotations."""

    def of(pose: Row) -> Row:
        x, y, z, w = change(Rotation.from_quat(np.roll(pose["rotation"], -1))).as_quat()
        return pose | {"rotation": [w, x, y, z]}

    return of


def from_axes(axes: list[list[float]]) -> Change:
    """Ego frames with other axes: columns, as the right ego frame sees them."""
    return turned(lambda rotation: rotation * Rotation.from_matrix(axes))


def with_yaw(change: Callable[[float], float]) -> Change:
    return turned(lambda r: Rotation.from_euler("z", change(r.as_euler("zyx")[0])))


def scaled(factor: float) -> Change:
    return lambda pose: pose | {"translation": [factor * x for x in pose["translation"]]}


def x_last(pose: Row) -> Row:
    return pose | {"rotation": [*pose["rotation"][1:], pose["rotation"][0]]}


def inverted(pose: Row) -> Row:
    rotation = Rotation.from_quat(np.roll(pose["rotation"], -1)).inv()
    x, y, z, w = rotation.as_quat()
    place = -rotation.apply(pose["translation"])
    return pose | {"rotation": [w, x, y, z], "translation": place.tolist()}


def mirrored(pose: Row) -> Row:
    x, y, z = pose["translation"]
    return pose | {"translation": [x, -y, z]}


def in_degrees(pose: Row) -> Row:
    x, y, z = pose["translation"]
    return pose | {"translation": [8.4 + x / 74_000.0, 49.0 + y / 111_000.0, z]}


def in_radians(pose: Row) -> Row:
    x, y, z = in_degrees(pose)["translation"]
    return pose | {"translation": [math.radians(x), math.radians(y), z]}


def earth_centred(pose: Row) -> Row:
    """At 8.4 degrees east, 49 degrees north: local east, north, up in ECEF."""
    lat, lon = np.deg2rad([49.0, 8.4])
    up = np.array([math.cos(lat) * math.cos(lon), math.cos(lat) * math.sin(lon), math.sin(lat)])
    east = np.array([-math.sin(lon), math.cos(lon), 0.0])
    enu = np.stack([east, np.cross(up, east), up], axis=-1)
    rotation = Rotation.from_matrix(enu) * Rotation.from_quat(np.roll(pose["rotation"], -1))
    x, y, z, w = rotation.as_quat()
    place = 6.366e6 * up + enu @ pose["translation"]
    return pose | {"rotation": [w, x, y, z], "translation": place.tolist()}


MISTAKES: dict[str, tuple[Change, str, str]] = {
    "y forward": (
        from_axes([[0, 1, 0], [-1, 0, 0], [0, 0, 1]]),
        "points right of its motion by 90 degrees",
        "y axis looks forward",
    ),
    "y backward": (
        from_axes([[0, -1, 0], [1, 0, 0], [0, 0, 1]]),
        "points left of its motion by 90 degrees",
        "y axis looks backward",
    ),
    "half a turn": (from_axes([[-1, 0, 0], [0, -1, 0], [0, 0, 1]]), "against its motion", "half a"),
    "camera axes": (
        from_axes([[0, 0, 1], [-1, 0, 0], [0, -1, 0]]), "z axis is 90 degrees off", "camera's"
    ),
    "z down": (
        from_axes([[1, 0, 0], [0, -1, 0], [0, 0, -1]]), "180 degrees off", "y right, z down"
    ),
    "x, y, z, w": (x_last, "", "x, y, z, w"),
    "rotation inverted": (turned(Rotation.inv), "", "rotation looks inverted"),
    "pose inverted": (inverted, "", "pose looks inverted"),
    "y mirrored": (mirrored, "", "one axis mirrored"),
    "identity": (turned(lambda _: Rotation.identity()), "", "all rotations are the identity"),
    "30 degrees": (with_yaw(lambda yaw: yaw + 0.5236), "left of its motion by 30 degrees", ""),
    "compass": (with_yaw(lambda yaw: math.pi / 2 - yaw), "", "compass course"),
    "degrees": (with_yaw(math.degrees), "", "degrees taken for radians"),
    "radians": (with_yaw(math.radians), "", "radians taken for degrees"),
    "whole angle": (with_yaw(lambda yaw: 2.0 * yaw), "", "that of twice the heading"),
    "earth-centred": (earth_centred, "degrees off", "earth-centred coordinates (ECEF)"),
    "latitude": (in_degrees, "", "degrees of latitude and longitude"),
    "latitude in radians": (in_radians, "", "radians of latitude and longitude"),
    "centimetres": (scaled(100.0), "m/s all the way", "centimetres"),
    "millimetres": (scaled(1000.0), "m/s all the way", "millimetres"),
}  # fmt: skip


@pytest.mark.parametrize("mistake", MISTAKES)
def test_mistakes_of_all_poses_are_named(
    load: Any, tables: dict[str, list[Row]], mistake: str
) -> None:
    change, measured, named = MISTAKES[mistake]
    texts = problems(load(ego_pose=[change(pose) for pose in tables["ego_pose"]]))
    assert all(texts), texts
    assert all(f"{VERSION}/ego_pose.json" in text for text in texts)
    assert all(measured in text for text in texts), texts
    assert all(named in text for text in texts), texts
    # What has no known mistake has none by chance.
    assert named or not any("look" in text for text in texts), texts


def test_right_poses_have_no_problem(load: Any) -> None:
    index = load()
    assert not index.scene_problem.any()
    assert not index.camera_problem.any()
    assert not len(index.warning_text)


def sweeps_of(tables: dict[str, list[Row]], scene: TinyScene) -> list[int]:
    """Rows in ego_pose.json of a scene's sweeps, by time."""
    start = f"{scene.name}-LIDAR_TOP"
    return [row for row, pose in enumerate(tables["ego_pose"]) if pose["token"].startswith(start)]


@pytest.mark.parametrize(
    ("changed", "reason", "named"),
    [
        ({"heading": 180.0}, "heading that jumps", "180 degrees within"),
        ({"heading": 40.0}, "heading that jumps", "this one heading looks wrong"),
        ({"ahead_m": 8.0}, "place off its path", "8 m off the way"),
        ({"aside_m": 2.0}, "place off its path", "2 m off the way"),
        ({"late_s": -0.7}, "place off its path", "0.7 s too early"),
    ],
)
def test_one_wrong_pose_is_named(
    load: Any, tables: dict[str, list[Row]], changed: dict[str, float], reason: str, named: str
) -> None:
    poses, frames = [list(tables[name]) for name in ("ego_pose", "sample_data")]
    row = sweeps_of(tables, VAL)[33]
    x_m, y_m, _ = poses[row]["translation"]
    cos, sin = math.cos(VAL.yaw_rad), math.sin(VAL.yaw_rad)
    ahead_m, aside_m = changed.get("ahead_m", 0.0), changed.get("aside_m", 0.0)
    place = [x_m + cos * ahead_m - sin * aside_m, y_m + sin * ahead_m + cos * aside_m, 0.0]
    yaw_rad = math.radians(changed.get("heading", 0.0))
    poses[row] = with_yaw(lambda yaw: yaw + yaw_rad)(poses[row]) | {"translation": place}
    frame = next(i for i, f in enumerate(frames) if f["ego_pose_token"] == poses[row]["token"])
    late_us = round(1e6 * changed.get("late_s", 0.0))
    frames[frame] = frames[frame] | {"timestamp": frames[frame]["timestamp"] + late_us - 1}
    index = load(ego_pose=poses, sample_data=frames)
    assert index.problem_reason[index.scene_problem].tolist() == ["", "", reason]
    assert named in problems(index)[2]
    # That record is named, or the one before it, from which the step is wrong.
    around = {poses[row]["token"], poses[row - 1]["token"]}
    assert any(f"record '{token}'" in problems(index)[2] for token in around)


def test_keyframe_poses_copied_to_their_sweeps_are_named(
    load: Any, tables: dict[str, list[Row]]
) -> None:
    poses = list(tables["ego_pose"])
    for scene in SCENES:
        rows = sweeps_of(tables, scene)
        for i, row in enumerate(rows):
            source = poses[rows[i - i % 5]]
            poses[row] = poses[row] | {key: source[key] for key in ("translation", "rotation")}
    index = load(ego_pose=poses)
    assert set(index.problem_reason[index.scene_problem]) == {"repeated pose"}
    assert all("keyframe were copied to the sweeps" in text for text in problems(index))


def test_headings_from_places_of_a_car_that_stands_are_named() -> None:
    times_s = 0.1 * np.arange(80)
    speed_mps = np.clip(np.minimum(2.0 * (times_s - 2.0), 3.0 * (6.0 - times_s)), 0.0, None)
    way_m = 0.1 * np.cumsum(speed_mps)
    yaw_rad = np.where(np.diff(way_m, prepend=0.0) > 0.0, 0.9, 0.0)
    tracks = tracks_of(times_s, way_m[:, None] * [math.cos(0.9), math.sin(0.9)], yaw_rad)
    flaws = find_flaws(tracks)
    assert flaws[0].reason == "heading that jumps"
    assert "successive places" in likely_mistakes(tracks, flaws)[0]


def test_times_in_other_units_are_named(load: Any, tables: dict[str, list[Row]]) -> None:
    frames = [row | {"timestamp": row["timestamp"] / 1000} for row in tables["sample_data"]]
    index = load(sample_data=frames)
    assert all("milliseconds instead of microseconds" in text for text in problems(index))


def test_camera_clock_half_a_second_late_is_named(load: Any, tables: dict[str, list[Row]]) -> None:
    frames = [
        row | {"timestamp": row["timestamp"] + 500_000 * (f"/{CAMERAS[1]}/" in row["filename"])}
        for row in tables["sample_data"]
    ]
    index = load(sample_data=frames)
    assert not index.camera_problem[:, 0].any()
    # The last images of each scene were taken when there are no sweeps any more.
    late = index.camera_problem[:, 1].reshape(3, -1)[:, :-1]
    assert (index.problem_reason[late] == "image off the path").all()
    assert "its time looks wrong by 0.5 s" in index.problem_text[late[0, 0]]
    assert index.warning_reason.tolist() == ["image at another time"]


def test_a_car_that_never_moves_is_worth_a_word(load: Any, tables: dict[str, list[Row]]) -> None:
    still = {"translation": [12.0, 48.0, 0.0], "rotation": [1.0, 0.0, 0.0, 0.0]}
    index = load(ego_pose=[pose | still for pose in tables["ego_pose"]])
    assert not index.scene_problem.any()
    assert index.warning_reason.tolist() == ["nothing moves"]


def test_small_offset_of_all_headings_is_worth_a_word(
    load: Any, tables: dict[str, list[Row]]
) -> None:
    index = load(ego_pose=[with_yaw(lambda yaw: yaw - 0.17)(pose) for pose in tables["ego_pose"]])
    assert not index.scene_problem.any()
    assert "right of its motion by 10 degrees" in index.warning_text[0]


def test_without_poses_there_is_no_flaw(load: Any, tables: dict[str, list[Row]]) -> None:
    none = Tracks(np.zeros(0), np.zeros(0, dtype=np.int64), np.zeros((0, 4, 4)))
    assert find_flaws(none) == {}
    with pytest.raises(DataError, match=r"sample_data\.json' has no record that is used"):
        load(sample_data=[])
    own = [row for row in tables["sample_data"] if VAL.name not in row["token"]]
    index = load(sample_data=own)
    assert index.problem_reason[index.scene_problem].tolist() == ["", "", "scene without poses"]
    assert not len(index.warning_text)
