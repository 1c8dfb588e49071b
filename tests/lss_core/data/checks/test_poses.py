"""Poses that no car has: each mistake is named, and what cars do is none."""

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
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
from lss_core.geometry import rigid_from_yaw

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


def tracks_of(
    times_s: np.ndarray, places_m: np.ndarray, yaw_rad: np.ndarray, scene: int = 0
) -> Tracks:
    poses = rigid_from_yaw(places_m, yaw_rad)
    return Tracks(times_s + 1.5e9, np.full(len(times_s), scene, dtype=np.int64), poses)


def joined(parts: list[Tracks]) -> Tracks:
    names = ("time_s", "scene", "global_from_ego")
    return Tracks(*(np.concatenate([getattr(part, name) for part in parts]) for name in names))


def driven(
    seconds: float, speed_mps: Callable[[Any], Any], curvature_pm: Callable[[Any], Any]
) -> Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]]:
    """Places and headings over time of a rear axle that follows a curvature at a speed."""
    fine_s = np.linspace(0.0, seconds, 40_001)
    step_s = fine_s[1]
    speed = speed_mps(fine_s) * np.ones_like(fine_s)
    yaw_rad = 0.8 + np.cumsum(speed * curvature_pm(fine_s)) * step_s
    xy_m = np.cumsum(np.stack([np.cos(yaw_rad), np.sin(yaw_rad)], axis=-1) * speed[:, None], 0)
    xy_m = xy_m * step_s + [500_123.0, 5_400_456.0]

    def at(times_s: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        places = np.stack([np.interp(times_s, fine_s, xy_m[:, axis]) for axis in (0, 1)], axis=-1)
        return places, np.interp(times_s, fine_s, yaw_rad)

    return at


DRIVES = {
    "straight": driven(20.0, lambda t: 30.0, lambda t: 0.0),
    "standing": driven(20.0, lambda t: 0.0, lambda t: 0.0),
    "hard braking": driven(20.0, lambda t: np.clip(30.0 - 10.0 * (t - 5.0), 0, 30), lambda t: 0.0),
    "starting": driven(20.0, lambda t: np.clip(4.0 * (t - 3.0), 0.0, 20.0), lambda t: 0.001),
    "parking": driven(20.0, lambda t: 1.5, lambda t: np.sign(np.sin(0.9 * t)) / 3.2),
    "roundabout": driven(20.0, lambda t: 8.0, lambda t: np.where((t > 4) & (t < 14), 1 / 12, 0)),
    "tight circle": driven(20.0, lambda t: 4.5, lambda t: 1 / 4.0),
    "slalom": driven(20.0, lambda t: 15.0, lambda t: 0.03 * np.sin(2.0 * t)),
    "reversing": driven(20.0, lambda t: np.where(t < 8, 5.0, -2.6), lambda t: 0.05),
    "only reversing": driven(20.0, lambda t: -3.0, lambda t: 0.03),
}


@pytest.mark.parametrize("noise", [0.0, 1.0])
@pytest.mark.parametrize("rate_hz", [1.0, 2.0, 10.0, 20.0, 100.0])
@pytest.mark.parametrize("drive", DRIVES)
def test_what_cars_do_is_no_flaw(drive: str, rate_hz: float, noise: float) -> None:
    rng = np.random.default_rng(5)
    times_s = np.arange(0.0, 20.0, 1.0 / rate_hz)
    # Time stamps are not even, and what they belong to was a little later.
    times_s = times_s + rng.uniform(0.0, 0.2 / rate_hz, len(times_s))
    places_m, yaw_rad = DRIVES[drive](times_s)
    places_m = places_m + noise * rng.normal(0.0, 0.05, places_m.shape)
    yaw_rad = yaw_rad + noise * rng.normal(0.0, np.deg2rad(0.5), yaw_rad.shape)
    assert find_flaws(tracks_of(times_s, places_m, yaw_rad)) == {}


def test_a_steep_road_is_no_flaw() -> None:
    tracks = tracks_of(
        0.1 * np.arange(80), np.stack([np.arange(80.0), np.zeros(80)], -1), np.zeros(80)
    )
    climbing = Rotation.from_euler("y", -math.atan(0.15)).as_matrix()
    tracks.global_from_ego[:, :3, :3] = climbing
    assert find_flaws(tracks) == {}


def test_poses_shared_by_the_cameras_of_a_moment_are_no_flaw() -> None:
    # Six cameras fire within 50 ms and have one pose, twice a second.
    times_s = (0.5 * np.arange(30)[:, None] + 0.01 * np.arange(6)).ravel()
    places_m = np.repeat(np.stack([10.0 * np.arange(30), np.zeros(30)], -1), 6, axis=0)
    assert find_flaws(tracks_of(times_s, places_m, np.zeros(180))) == {}


def test_the_nearest_of_ten_poses_a_second_is_no_flaw() -> None:
    # Cameras that fire whenever they like, and have the pose of the nearest moment that has one.
    times_s = np.sort(np.random.default_rng(3).uniform(0.0, 20.0, 400))
    places_m, yaw_rad = driven(20.0, lambda t: 25.0, lambda t: 0.004)(np.round(times_s, 1))
    assert find_flaws(tracks_of(times_s, places_m, yaw_rad)) == {}


def test_short_scenes_count_together() -> None:
    def scene(number: int, off_rad: float) -> Tracks:
        times_s = 0.1 * np.arange(9)
        places_m, yaw_rad = DRIVES["straight"](times_s)
        return tracks_of(times_s, places_m, yaw_rad + off_rad, number)

    assert find_flaws(scene(0, 1.0)) == {}
    assert find_flaws(joined([scene(n, 0.0) for n in range(5)])) == {}
    flaws = find_flaws(joined([scene(n, 1.0) for n in range(5)]))
    assert sorted(flaws) == list(range(5))
    assert "left of its motion by 57 degrees" in flaws[3].measured


def test_one_scene_may_be_wrong_among_others() -> None:
    parts = []
    for number, off_rad in enumerate([0.0, -np.pi / 2, 0.0]):
        times_s = 0.1 * np.arange(100)
        places_m, yaw_rad = DRIVES["slalom"](times_s)
        parts.append(tracks_of(times_s, places_m, yaw_rad + off_rad, number))
    tracks = joined(parts)
    flaws = find_flaws(tracks)
    assert list(flaws) == [1]
    assert "y axis looks forward" in likely_mistakes(tracks, flaws)[1]


def test_scenes_together_are_scenes_one_by_one() -> None:
    rng = np.random.default_rng(0)
    parts = []
    for scene, name in enumerate(DRIVES):
        times_s = 100.0 * rng.permutation(9)[0] + np.sort(rng.uniform(0.0, 20.0, 150))
        places_m, yaw_rad = DRIVES[name](times_s % 100.0)
        if scene % 3 == 0:
            yaw_rad = yaw_rad + np.pi / 2
        if scene % 3 == 1:
            places_m[70] += 9.0
        parts.append(tracks_of(times_s, places_m, yaw_rad, scene))
    together = joined(parts)
    singly = {scene: flaw.measured for part in parts for scene, flaw in find_flaws(part).items()}
    assert {scene: flaw.measured for scene, flaw in find_flaws(together).items()} == singly
    assert len(singly) > 4


def test_without_poses_there_is_no_flaw(load: Any, tables: dict[str, list[Row]]) -> None:
    none = Tracks(np.zeros(0), np.zeros(0, dtype=np.int64), np.zeros((0, 4, 4)))
    assert find_flaws(none) == {}
    with pytest.raises(DataError, match=r"sample_data\.json' has no record that is used"):
        load(sample_data=[])
    own = [row for row in tables["sample_data"] if VAL.name not in row["token"]]
    index = load(sample_data=own)
    assert index.problem_reason[index.scene_problem].tolist() == ["", "", "scene without poses"]
    assert not len(index.warning_text)
