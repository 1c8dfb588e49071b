"""What a written city holds, as the devkit reads it."""

import json
from pathlib import Path

import cv2
import numpy as np
import pytest
from devkit_labels import check_labels
from nuscenes import NuScenes
from nuscenes.map_expansion.map_api import NuScenesMap
from PIL import Image
from small_city import DURATION_S, config

from lss_core.data.splits import official_scenes
from lss_core.grid import BevGrid
from lss_core.labels import sample_labels
from lss_core.labels.roads import LINE_WIDTH_M
from shoot.world import writer
from shoot.world.config import VERSION
from shoot.world.looks.scenery import ego_pose
from shoot.world.nuscenes.capture import LIDAR_PERIOD_S, keyframe_steps
from shoot.world.nuscenes.tiling import TILE_M, seed_of, tile_of
from shoot.world.orders import town_orders
from shoot.world.town.roads import make_town
from shoot.world.traffic.scenario import make_look, make_scenario
from shoot.world.writer import make_world


@pytest.fixture(scope="module")
def nusc(root: Path) -> NuScenes:
    return NuScenes(VERSION, str(root), verbose=False)


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
        for town in town_orders(
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


def test_labels_are_what_the_devkit_says(root: Path, nusc: NuScenes):
    grid = BevGrid()
    for scene in (nusc.scene[0], nusc.scene[-1]):
        token = scene["last_sample_token"]
        maps = NuScenesMap(str(root), nusc.get("log", scene["log_token"])["location"])
        centre, released = (
            sample_labels(root, VERSION, token, grid, rule=rule) for rule in ("centre", "released")
        )
        check_labels(nusc, maps, token, grid, centre, released, LINE_WIDTH_M)
        assert all(centre[name].any() for name in ("car", "vehicle", "drivable"))
