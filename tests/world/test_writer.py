"""A tiny world on disk: three scenes of 1.5 s, small images."""

import hashlib
import json
import os
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from nuscenes import NuScenes
from nuscenes.map_expansion.map_api import NuScenesMap
from PIL import Image

from lss_core.data.splits import official_scenes
from lss_core.errors import DataError
from shoot.cli import make_world as command
from shoot.world import writer
from shoot.world.capture import LIDAR_PERIOD_S, keyframe_steps
from shoot.world.roads import make_town
from shoot.world.scenario import make_look, make_scenario
from shoot.world.scenery import ego_pose
from shoot.world.tiling import TILE_M, seed_of, tile_of
from shoot.world.writer import VERSION, MakeWorldConfig, make_world

DURATION_S = 1.5


def config(out: Path, **changes: object) -> MakeWorldConfig:
    plain = MakeWorldConfig(
        out=out, train_scenes=2, val_scenes=1, seed=3, image_scale=0.08, workers=1,
        scenes_per_town=2, duration_s=DURATION_S, lidar_azimuths=48,
    )  # fmt: skip
    return replace(plain, **changes)


def start(out: Path, **changes: object) -> "subprocess.Popen[bytes]":
    """Run the command in a process of its own (without the slow checks of types in tests)."""
    settings = {**config(out, **changes).__dict__}
    del settings["out"]
    flags = [
        word
        for name, value in settings.items()
        for word in (f"--{name.replace('_', '-')}", str(value))
    ]
    code = "from shoot.cli.make_world import main; main()"
    return subprocess.Popen(
        [sys.executable, "-c", code, str(out), *flags],
        stdout=subprocess.DEVNULL,
        env={**os.environ, "OMP_NUM_THREADS": "1"},
    )


def digest(root: Path) -> dict[str, str]:
    return {
        str(path.relative_to(root)): hashlib.sha256(path.read_bytes()).hexdigest()
        for path in sorted(root.rglob("*"))
        if path.is_file()
    }


@pytest.fixture(scope="module")
def root(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("worlds") / "world"
    assert start(folder).wait() == 0
    return folder


@pytest.fixture(scope="module")
def mended(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A world of another seed with all sweeps, whose making failed once at the very end."""

    def broken(*_: object) -> None:
        raise OSError("disk full")

    folder = tmp_path_factory.mktemp("mended")
    small = config(folder, seed=4, train_scenes=0, duration_s=0.6, sweeps="all")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(writer, "write_mask", broken)
        with pytest.raises(OSError, match="disk full"):
            make_world(small)
    assert not (folder / VERSION).exists()
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(writer, "capture_scene", broken)  # nothing is made twice
        make_world(small)
    return folder


@pytest.fixture(scope="module")
def nusc(root: Path) -> NuScenes:
    return NuScenes(VERSION, str(root), verbose=False)


def test_nothing_but_the_data_set_is_left(root: Path):
    assert sorted(path.name for path in root.iterdir()) == [
        "maps",
        "samples",
        VERSION,
        "world.json",
    ]


def test_scenes_carry_official_names_and_lie_in_their_own_towns(nusc: NuScenes):
    names = [scene["name"] for scene in nusc.scene]
    assert names == [*official_scenes(VERSION, "train")[:2], official_scenes(VERSION, "val")[0]]
    tiles = []
    for scene in nusc.scene:
        first = nusc.get("sample", scene["first_sample_token"])
        pose = nusc.get(
            "ego_pose", nusc.get("sample_data", first["data"]["LIDAR_TOP"])["ego_pose_token"]
        )
        location = nusc.get("log", scene["log_token"])["location"]
        tiles.append((location, *np.floor(np.array(pose["translation"][:2]) / TILE_M)))
    assert tiles[0] == tiles[1]
    assert tiles[0] != tiles[2]


def test_every_sample_has_seven_sensors_with_files(nusc: NuScenes):
    assert len(nusc.sample) >= 6
    for sample in nusc.sample:
        assert len(sample["data"]) == 7
        for channel, data_token in sample["data"].items():
            row = nusc.get("sample_data", data_token)
            path = Path(nusc.get_sample_data_path(data_token))
            assert path.is_file()
            if channel != "LIDAR_TOP":
                with Image.open(path) as image:
                    assert image.size == (row["width"], row["height"]) == (128, 72)
            else:
                points = np.fromfile(path, np.float32).reshape(-1, 5)
                assert len(points) > 200
                assert row["timestamp"] == sample["timestamp"]


def test_cameras_fire_within_50_ms_before_the_lidar_stamp(nusc: NuScenes):
    delays = {}
    for sample in nusc.sample:
        for channel, data_token in sample["data"].items():
            row = nusc.get("sample_data", data_token)
            delays.setdefault(channel, []).append(sample["timestamp"] - row["timestamp"])
            assert nusc.get("ego_pose", row["ego_pose_token"])["timestamp"] == row["timestamp"]
    assert all(0 <= delay <= 50_000 for values in delays.values() for delay in values)
    assert (
        np.mean(delays["CAM_FRONT_LEFT"])
        > np.mean(delays["CAM_FRONT"])
        > np.mean(delays["CAM_BACK"])
    )


def test_lidar_turns_every_50_ms_with_a_pose_each(nusc: NuScenes):
    for scene in nusc.scene:
        first = nusc.get("sample", scene["first_sample_token"])
        row = nusc.get("sample_data", first["data"]["LIDAR_TOP"])
        assert row["prev"] == ""
        stamps = [row["timestamp"]]
        names = {row["filename"]}
        while row["next"]:
            follower = nusc.get("sample_data", row["next"])
            assert follower["prev"] == row["token"]
            row = follower
            stamps.append(row["timestamp"])
            names.add(row["filename"])
        assert len(stamps) == len(names) == round(DURATION_S / 0.05)
        assert set(np.diff(stamps)) == {50_000}


def test_chains_of_samples_and_annotations_hold(nusc: NuScenes):
    for scene in nusc.scene:
        walked = [scene["first_sample_token"]]
        while following := nusc.get("sample", walked[-1])["next"]:
            walked.append(following)
        assert walked[-1] == scene["last_sample_token"]
        assert len(walked) == scene["nbr_samples"]
    for instance in nusc.instance:
        walked = [instance["first_annotation_token"]]
        while following := nusc.get("sample_annotation", walked[-1])["next"]:
            walked.append(following)
        assert walked[-1] == instance["last_annotation_token"]
        assert len(walked) == instance["nbr_annotations"]


def test_poses_interpolate_the_recording(nusc: NuScenes):
    scene = nusc.scene[1]
    town = make_town(seed_of(3, "train", "town", 0))
    recording = make_scenario(town, seed_of(3, "train", "scene", 1), DURATION_S)
    first = nusc.get("sample", scene["first_sample_token"])
    start_us = first["timestamp"] - 50_000
    for data_token in first["data"].values():
        row = nusc.get("sample_data", data_token)
        pose = nusc.get("ego_pose", row["ego_pose_token"])
        x, y, yaw = ego_pose(recording, (row["timestamp"] - start_us) / 1e6)
        offset = tile_of("train", 0).origin_m
        assert pose["translation"] == pytest.approx([x + offset[0], y + offset[1], 0.0], abs=1e-5)
        turn = pose["rotation"]
        assert 2 * np.arctan2(turn[3], turn[0]) % (2 * np.pi) == pytest.approx(yaw % (2 * np.pi))


def test_boxes_hold_the_points_they_count(nusc: NuScenes):
    counted = held = 0
    for sample in nusc.sample:
        path, boxes, _ = nusc.get_sample_data(sample["data"]["LIDAR_TOP"])
        points = np.fromfile(path, np.float32).reshape(-1, 5)[:, :3]
        for box in boxes:
            local = (points - box.center) @ box.rotation_matrix
            width, length, height = box.wlh
            inside = np.all(np.abs(local) < np.array([length, width, height]) / 2 + 0.1, axis=1)
            # What the road under a car returns may also lie in its box: at least the count.
            counted += nusc.get("sample_annotation", box.token)["num_lidar_pts"]
            held += inside.sum()
            assert inside.sum() >= nusc.get("sample_annotation", box.token)["num_lidar_pts"]
    assert counted > 30
    assert held < 4 * counted


def test_maps_load_and_know_the_road(root: Path, nusc: NuScenes):
    scene = nusc.scene[0]
    location = nusc.get("log", scene["log_token"])["location"]
    city = NuScenesMap(str(root), location)
    sample = nusc.get("sample", scene["first_sample_token"])
    pose = nusc.get(
        "ego_pose", nusc.get("sample_data", sample["data"]["LIDAR_TOP"])["ego_pose_token"]
    )
    x, y = pose["translation"][:2]
    on_point = city.layers_on_point(x, y)
    assert on_point["drivable_area"]
    lane = city.get_closest_lane(x, y, radius=3)
    assert city.get_outgoing_lane_ids(lane)
    line = np.array(city.discretize_lanes([lane], 0.5)[lane])
    assert np.hypot(*(line[:, :2] - [x, y]).T).min() < 2.5
    masks = city.get_map_mask((x, y, 60.0, 60.0), 0.0, ["drivable_area", "walkway"], (60, 60))
    assert masks[0][30, 30] == 1
    assert 0.05 < masks[0].mean() < 0.95
    for layer in city.non_geometric_layers:
        assert isinstance(getattr(city, layer), list)
    heading = 2 * np.arctan2(pose["rotation"][3], pose["rotation"][0])
    house = np.array([x, y]) + 60 * np.array([-np.sin(heading), np.cos(heading)])
    record = next(row for row in nusc.map if scene["log_token"] in row["log_tokens"])
    assert record["mask"].is_on_mask(x, y)[0]
    far = record["mask"].is_on_mask(np.array([house[0]]), np.array([house[1]]))[0]
    assert far == bool(city.layers_on_point(*house, layer_names=["drivable_area", "walkway"])[
        "drivable_area"
    ] or city.layers_on_point(*house, layer_names=["walkway"])["walkway"])  # fmt: skip


def test_all_tokens_referenced_exist(root: Path):
    for path in (root / "maps" / "expansion").glob("*.json"):
        layers = json.loads(path.read_text())
        nodes = {row["token"] for row in layers["node"]}
        polygons = {row["token"] for row in layers["polygon"]}
        lines = {row["token"] for row in layers["line"]}
        lanes = {row["token"] for row in layers["lane"] + layers["lane_connector"]}
        for row in layers["polygon"]:
            assert set(row["exterior_node_tokens"]) <= nodes
        for layer in layers.values():
            for row in layer if isinstance(layer, list) else []:
                if isinstance(row, dict):
                    assert row.get("polygon_token", next(iter(polygons))) in polygons
                    assert row.get("line_token", next(iter(lines))) in lines
        assert set(layers["connectivity"]) == set(layers["arcline_path_3"]) == lanes
        for links in layers["connectivity"].values():
            assert set(links["incoming"]) | set(links["outgoing"]) <= lanes


def test_night_stands_in_the_description_and_in_the_images(tmp_path: Path):
    looks = [make_look(seed_of(0, "val", "scene", i)).daylight for i in range(60)]
    night, day = looks.index("night"), looks.index("day")
    towns = [
        town
        for town in writer._town_orders(
            config(tmp_path, seed=0, train_scenes=0, val_scenes=60, duration_s=0.5)
        )
        if town.index in (night, day)
    ]
    (tmp_path / ".parts").mkdir()
    brightness = {}
    for town in towns:
        writer._make_town(town, tmp_path)
        part = json.loads((tmp_path / ".parts" / f"{town.scenes[0].name}.json").read_text())
        images = [row["filename"] for row in part["sample_data"] if row["fileformat"] == "jpg"]
        brightness["Night" in part["scene"][0]["description"]] = np.mean(
            [cv2.imread(str(tmp_path / name)).mean() for name in images]
        )
    assert brightness[True] < 0.6 * brightness[False]


def test_a_scene_depends_on_its_number_only(root: Path, tmp_path: Path):
    assert start(tmp_path / "more", train_scenes=0, val_scenes=2).wait() == 0
    name = official_scenes(VERSION, "val")[0]
    ours, more = (
        {k: v for k, v in digest(folder).items() if name in k}
        for folder in (root, tmp_path / "more")
    )
    assert len(ours) > 10
    assert ours == more


def test_another_seed_gives_another_world(root: Path, mended: Path):
    ours, other = (
        json.loads((folder / VERSION / "ego_pose.json").read_text())[-1]["translation"]
        for folder in (root, mended)
    )
    assert ours != other


def test_killed_and_continued_by_two_workers_gives_the_same_bytes(root: Path, tmp_path: Path):
    out = tmp_path / "killed"
    parts = out / ".parts"
    job = start(out)
    first = parts / f"{official_scenes(VERSION, 'train')[0]}.json"
    deadline = time.monotonic() + 300
    while not first.exists() and job.poll() is None and time.monotonic() < deadline:
        time.sleep(0.02)
    os.kill(job.pid, signal.SIGKILL)
    job.wait()
    assert first.exists()
    assert not (out / VERSION).exists()
    finished = next(iter((out / "samples" / "CAM_FRONT").glob("*")))
    made_at = finished.stat().st_mtime_ns
    assert start(out, workers=2).wait() == 0
    assert finished.stat().st_mtime_ns == made_at, "a finished scene was made again"
    assert digest(out) == digest(root)


def test_finished_worlds_are_left_alone(root: Path):
    before = {path: path.stat().st_mtime_ns for path in root.rglob("*")}
    make_world(config(root))
    assert {path: path.stat().st_mtime_ns for path in root.rglob("*")} == before


@pytest.mark.parametrize(
    ("changes", "setting"),
    [
        ({"seed": 9}, "seed"),
        ({"image_scale": 0.1}, "image_scale"),
        ({"train_scenes": 1}, "train_scenes"),
    ],
)
def test_other_settings_in_the_same_folder_are_refused(root: Path, changes, setting):
    with pytest.raises(DataError, match=setting):
        make_world(config(root, **changes))


def test_strange_folders_are_refused(tmp_path: Path):
    (tmp_path / "real" / VERSION).mkdir(parents=True)
    with pytest.raises(DataError, match="another data set"):
        make_world(config(tmp_path / "real"))
    (tmp_path / "file").write_text("")
    with pytest.raises(DataError, match="is a file"):
        make_world(config(tmp_path / "file"))
    (tmp_path / "torn").mkdir()
    (tmp_path / "torn" / "world.json").write_text("{")
    with pytest.raises(DataError, match="cannot be read"):
        make_world(config(tmp_path / "torn"))


@pytest.mark.parametrize(
    ("changes", "flag"),
    [
        ({"train_scenes": 701}, "--train-scenes"),
        ({"image_scale": 3.0}, "--image-scale"),
        ({"train_scenes": 0, "val_scenes": 0}, "nothing to write"),
        ({"workers": 0}, "--workers"),
        ({"tail_s": DURATION_S}, "--tail-s"),
    ],
)
def test_impossible_settings_are_refused(tmp_path: Path, changes, flag):
    with pytest.raises(DataError, match=flag):
        config(tmp_path, **changes)


def test_the_command_reports_in_one_sentence(root: Path, monkeypatch, capsys):
    monkeypatch.setattr(sys, "argv", ["shoot-make-world", str(root)])
    with pytest.raises(SystemExit) as stop:
        command.main()
    assert stop.value.code == 2
    said = capsys.readouterr().err
    assert said.startswith("error: ")
    assert said.count("\n") == 1
    assert "train_scenes = 2" in said


def test_all_sweeps_on_request(mended: Path):
    rows = json.loads((mended / VERSION / "sample_data.json").read_text())
    sweeps = [row for row in rows if "LIDAR_TOP" in row["filename"]]
    assert len(sweeps) == 12
    assert all((mended / row["filename"]).is_file() for row in sweeps)
    assert sum(row["filename"].startswith("sweeps/") for row in sweeps) == 10


def test_keyframes_come_unevenly_every_half_second():
    steps = np.diff(keyframe_steps(400, np.random.default_rng(0)))
    assert steps.min() >= 8
    assert steps.max() <= 12
    assert len(set(steps)) > 2
    assert abs(steps.mean() - 10) < 0.5


def test_keyframes_of_the_tail_have_boxes_and_a_sweep_but_no_images(tmp_path: Path):
    tailed = config(
        tmp_path / "w", train_scenes=0, duration_s=2.0, keyframe_s=0.3, tail_s=1.0, sweeps="all"
    )
    make_world(tailed)
    tables = tmp_path / "w" / VERSION
    names = ("sample", "sample_data", "sample_annotation")
    rows = {name: json.loads((tables / f"{name}.json").read_text()) for name in names}
    first_us = rows["sample"][0]["timestamp"]
    late = {r["token"] for r in rows["sample"] if r["timestamp"] - first_us >= 1.0e6}
    assert len(late) >= 3
    data = [row for row in rows["sample_data"] if row["sample_token"] in late]
    assert {r["filename"].split("/")[1] for r in data if r["is_key_frame"]} == {"LIDAR_TOP"}
    assert all((tmp_path / "w" / r["filename"]).is_file() for r in data if r["is_key_frame"])
    assert {row["sample_token"] for row in rows["sample_annotation"]} >= late
    # Whoever has the whole tail ahead has images: no sample is lost for want of them.
    begin_us = first_us - round(LIDAR_PERIOD_S * 1e6)
    early = {r["token"] for r in rows["sample"] if r["timestamp"] - begin_us <= 1.0e6}
    pictured = {r["sample_token"] for r in rows["sample_data"] if r["fileformat"] == "jpg"}
    assert early == pictured
    # Sweeps between them are in the tables for their poses, without files.
    turns = [r for r in data if not r["is_key_frame"] and r["timestamp"] - first_us > 1.0e6]
    assert turns
    assert not any((tmp_path / "w" / row["filename"]).exists() for row in turns)
