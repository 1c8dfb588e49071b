"""What a page shows of a scene is what the planner says of it, and where things were."""

import json
import math
from pathlib import Path

import numpy as np
import pytest
from driving_world import config_of, label_split, standing, write_drive, write_road
from viewer_case import GRID, data_of, decoded, make_scene
from world_fixture import SAMPLES_A_SCENE, TinyRun, command

from lss_core.camera import project
from lss_core.data.dataset import ego_from_camera
from lss_core.data.sensors.images import PixelMap, load_image
from shoot.metrics.ranks import rank_labels
from shoot.prediction.run import open_run, predict
from shoot.report.viewer import scene as viewed
from shoot.report.viewer.page import render_viewer
from shoot.report.viewer.pictures import cost_picture, image_within, points_picture
from shoot.report.viewer.scene import view_scene
from shoot.report.viewer.surroundings import boxes_around, road_edges
from shoot.training.planning.data import load_split

SCENE = "scene-0012"


@pytest.fixture(scope="module")
def page(tiny_run: TinyRun, tmp_path_factory: pytest.TempPathFactory) -> str:
    path = tmp_path_factory.mktemp("page") / "new" / "scene.html"
    said = command("shoot-view", tiny_run.folder, "--scene", SCENE, "--out", path)
    assert said.status == 0, said.err
    size = f"{path.stat().st_size / 1e6:.1f} MB"
    assert f"Page: {path}, {SAMPLES_A_SCENE} samples of {SCENE}, {size}" in said.out
    return path.read_text(encoding="utf-8")


def test_it_shows_what_shoot_evaluate_scores(page: str, tiny_run: TinyRun) -> None:
    run = open_run(tiny_run.folder)
    split = load_split(run.config.data, "val", run.templates)
    log_prob = predict(run, split)
    ranks = rank_labels(log_prob, split.labels)
    of_scene = np.flatnonzero(split.scene_names == SCENE)
    data = data_of(page)
    assert [data["name"], len(data["samples"])] == [SCENE, len(of_scene)]
    assert data["num_templates"] == len(run.templates.points)
    for sample, position in zip(data["samples"], of_scene.tolist(), strict=True):
        label, prob = int(split.labels[position]), np.exp(log_prob[position])
        assert sample["token"] == str(split.index.sample_token[split.rows[position]])
        best = np.argsort(-prob, kind="stable")[:10]
        np.testing.assert_allclose(sample["probabilities"], prob[best], rtol=1e-4)
        np.testing.assert_allclose(prob[sample["best"]], prob[best], rtol=1e-4)
        assert sample["label"] == label
        assert sample["label_probability"] == pytest.approx(float(prob[label]), rel=1e-4)
        assert sample["rank"] == ranks.num_before[position] + 1
        assert sample["hit"] == ranks.hits(10)[position]
        np.testing.assert_allclose(sample["driven"], split.futures.xy_m[position], atol=0.006)
        for number in (*sample["best"], label):
            path_m = data["templates"][str(number)]
            np.testing.assert_allclose(path_m, run.templates.points[number], atol=0.006)
    times_s = [sample["time_s"] for sample in data["samples"]]
    assert times_s == pytest.approx([0.0, 0.5, 1.0, 1.5, 2.0])
    # The car's own way, as each sample sees it: 2 s on it is where it had driven to.
    x_m, y_m, yaw_rad = data["samples"][4]["pose"]
    assert [x_m, y_m] == pytest.approx(data["samples"][0]["driven"][7], abs=0.02)
    assert math.cos(yaw_rad) < 1.0


def test_the_same_scene_gives_the_same_bytes(page: str, tiny_run: TinyRun, tmp_path: Path) -> None:
    path = tmp_path / "again.html"
    assert command("shoot-view", tiny_run.folder, "--scene", SCENE, "--out", path).status == 0
    assert path.read_text(encoding="utf-8") == page
    assert str(tiny_run.folder.parent) not in page
    assert str(tiny_run.root) not in page
    first = tmp_path / "first.html"
    assert command("shoot-view", tiny_run.folder, "--out", first).status == 0
    assert data_of(first.read_text())["name"] == "scene-0003"


def test_the_ground_lies_where_the_cameras_see_it(page: str, tiny_run: TinyRun) -> None:
    run = open_run(tiny_run.folder)
    split = load_split(run.config.data, "val", run.templates)
    position = int(np.flatnonzero(split.scene_names == SCENE)[3])
    index, row = split.index, int(split.rows[position])
    # Two places that the front camera sees, and one behind the car.
    ground = np.array([[12.0, 3.0, 0.0], [20.0, -2.0, 0.0], [-9.0, 1.5, 0.0]])
    seen = data_of(page)["samples"][3]["images"]
    assert [image["camera"] for image in seen] == list(range(6))
    for camera, image in enumerate(seen):
        pose = ego_from_camera(index, row)[camera]
        pixels, depth_m = project(ground, index.rawpixel_from_camera[row, camera], pose)
        height_px, width_px = index.image_hw[row, camera]
        scaled = np.array([[x, y, 1.0] for x, y, _ in ground]) @ np.transpose(
            image["image_from_ground"]
        )
        np.testing.assert_allclose(scaled[:, 2], depth_m, atol=1e-4)
        there = depth_m > 0.5
        shares = scaled[there, :2] / scaled[there, 2:]
        expected = (pixels[there] + 0.5) / [width_px, height_px]
        np.testing.assert_allclose(shares, expected, atol=1e-4)
        shown = np.asarray(decoded(image["picture"]), dtype=float)
        file = Path(run.config.data.root) / index.image_path[row, camera]
        hw = int(height_px), int(width_px)
        whole = load_image(file, PixelMap(hw, 0, 0, False, 0.0, hw, hw)).astype(float)
        assert shown.shape == whole.shape
        assert np.abs(shown - whole).mean() < 12.0


def test_roads_and_boxes_are_where_they_were_put(tmp_path: Path) -> None:
    things = [
        standing(20.0, 3.0, math.pi / 2, length_m=4.0, width_m=2.0, keyframes=[0, 1]),
        standing(30.0, -3.0, category="movable_object.barrier"),
    ]
    data = config_of(write_drive(tmp_path, things))
    write_road(tmp_path, [[[(-5.0, -4.0), (500.0, -4.0), (500.0, 6.0), (-5.0, 6.0)], []]])
    split = label_split(data)
    around = boxes_around(data, split)
    assert [len(boxes) for boxes in around] == [1, 1, 0, 0, 0, 0, 0]
    # Turned to the left: 4 m to the sides, 2 m ahead; half a second later 5 m nearer.
    corners_m = np.array([[19.0, 5.0], [19.0, 1.0], [21.0, 1.0], [21.0, 5.0]])
    np.testing.assert_allclose(around[0][0], corners_m, atol=1e-3)
    np.testing.assert_allclose(around[1][0], corners_m - [5.0, 0.0], atol=1e-3)
    (edge,) = road_edges(data, split, 40.0)
    pose = split.index.global_from_ego[split.rows[0]]
    seen_m = (edge - pose[:2, 3]) @ pose[:2, :2]
    for corner_m in ((-5.0, -4.0), (-5.0, 6.0)):
        assert np.hypot(*(seen_m - corner_m).T).min() < 0.01
    # Half of a kilometre is not carried along.
    assert seen_m[:, 0].max() < 200.0


def test_without_tables_and_maps_there_are_neither(tmp_path: Path) -> None:
    data = config_of(write_drive(tmp_path))
    (tmp_path / data.version / "sample_annotation.json").unlink()
    split = label_split(data)
    assert boxes_around(data, split) == [[]] * 7
    assert road_edges(data, split, 40.0) == []


def test_pictures_from_above_have_ahead_up_and_left_left() -> None:
    cost_map = np.zeros(GRID.shape)
    cost_map[-1, 0] = 3.0  # far ahead, to the right
    picture = np.asarray(decoded(cost_picture(cost_map, 0.0, 2.0)).convert("L"))
    assert picture.shape == GRID.shape
    assert np.argwhere(picture < 200).tolist() == [[0, GRID.shape[1] - 1]]
    scan_m = np.array([[59.9, 15.9, 1.0], [-9.9, 15.9, 1.0], [61.0, 0.0, 1.0], [0.0, -16.1, 0.0]])
    points = decoded(points_picture(scan_m, GRID))
    assert points.size == (128, 280)
    opaque = np.asarray(points.convert("RGBA"))[..., 3]
    assert np.argwhere(opaque).tolist() == [[0, 0], [279, 0]]


def test_images_keep_within_their_budget() -> None:
    noise = np.random.default_rng(0).integers(0, 255, (450, 800, 3), dtype=np.uint8)
    sizes = []
    for budget in (10**6, 100_000, 30_000, 10_000):
        text = image_within(noise, budget)
        assert len(text) <= budget
        sizes.append(decoded(text).size)
    assert sizes[0] == (800, 450)
    assert sizes == sorted(sizes, reverse=True)
    assert decoded(image_within(noise[:30, :40], 10**6)).size == (40, 30)


def test_all_images_of_a_scene_share_what_a_page_may_have(
    tiny_run: TinyRun, monkeypatch: pytest.MonkeyPatch
) -> None:
    run = open_run(tiny_run.folder)
    split = load_split(run.config.data, "val", run.templates)

    def num_bytes() -> tuple[int, int]:
        """Of all data, and of the images among them."""
        shown = view_scene(run, split, [])
        images = [len(image.picture) for sample in shown.samples for image in sample.images]
        return len(json.dumps(data_of(render_viewer(shown)))), sum(images)

    whole, images = num_bytes()
    most = whole - images // 5
    monkeypatch.setattr(viewed, "MOST_BYTES", most)
    assert num_bytes()[0] < most


def test_texts_of_the_data_cannot_end_their_element() -> None:
    word = "</script><!--<script>"
    scene = make_scene()
    page = render_viewer(viewed.ViewedScene(**{**scene.__dict__, "description": word}))
    assert word not in page
    assert data_of(page)["description"] == word
