"""A planner trained elsewhere looks at a real nuScenes scene; skipped where there is none.

Nothing of the real data leaves the test's own folder.
"""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image
from viewer_case import data_of
from world_fixture import TinyRun, command

from lss_core.camera import project
from lss_core.config import CAMERAS
from lss_core.data.dataset import ego_from_camera
from lss_core.data.samples import SampleIndex, load_index
from lss_core.data.sensors.lidar import load_sweep
from lss_core.geometry import apply, invert, rigid_from_quaternion
from shoot.trajectories import mine_futures

pytestmark = pytest.mark.real
VERSION = "v1.0-mini"
TOKEN = "ca9a282c9e77460f8360f564131a8af5"
WIDTH_PX, HEIGHT_PX = 1600.0, 900.0


@pytest.fixture(scope="module")
def index(real_root: Path) -> SampleIndex:
    return load_index(real_root, VERSION, CAMERAS)


def in_image(index: SampleIndex, points_ego: np.ndarray, camera: int) -> tuple[Any, Any]:
    """Pixels and depths of the points that a camera sees."""
    row = index.row_of(TOKEN)
    pixels, depth_m = project(
        points_ego, index.rawpixel_from_camera[row, camera], ego_from_camera(index, row)[camera]
    )
    with np.errstate(invalid="ignore"):
        seen = (depth_m > 1.0) & (pixels >= 0.0).all(-1) & (pixels < [WIDTH_PX, HEIGHT_PX]).all(-1)
    return pixels[seen], depth_m[seen]


def test_render_draws_the_real_scene(tiny_run: TinyRun, real_root: Path, tmp_path: Path) -> None:
    said = command(
        "shoot-render", tiny_run.folder, "--data.root", real_root, "--data.version", VERSION,
        "--token", TOKEN, "--lidar", "--out", tmp_path,
    )  # fmt: skip
    assert said.status == 0, said.err
    picture = np.asarray(Image.open(tmp_path / f"{TOKEN}.png").convert("RGB"), dtype=float)
    assert picture.shape[1] > 1000
    # Six photographs fill the upper third: hardly a pixel of blank paper there.
    upper = picture[int(0.1 * len(picture)) : int(0.3 * len(picture))]
    assert (upper.min(axis=-1) > 250.0).mean() < 0.1


def test_view_shows_the_real_scene(tiny_run: TinyRun, real_root: Path, tmp_path: Path) -> None:
    page = tmp_path / "scene.html"
    said = command(
        "shoot-view", tiny_run.folder, "--data.root", real_root, "--data.version", VERSION,
        "--split", "train", "--skip-bad", "--out", page,
    )  # fmt: skip
    assert said.status == 0, said.err
    data = data_of(page.read_text())
    (sample,) = data["samples"]
    assert sample["token"] == TOKEN
    assert [image["camera"] for image in sample["images"]] == list(range(6))
    assert min(len(data["road"]), len(sample["boxes"])) > 3


def test_missing_files_of_the_other_keyframes_are_named(
    tiny_run: TinyRun, real_root: Path, tmp_path: Path
) -> None:
    said = command(
        "shoot-render", tiny_run.folder, "--data.root", real_root, "--data.version", VERSION,
        "--split", "train", "--out", tmp_path,
    )  # fmt: skip
    assert said.status == 2
    assert "--data.skip-bad" in said.err


def test_driven_path_lies_on_the_road_ahead(index: SampleIndex) -> None:
    future = mine_futures(index, np.asarray([index.row_of(TOKEN)]), "keyframes").xy_m[0]
    on_ground = np.concatenate([future, np.zeros((len(future), 1))], axis=-1)
    pixels, depth_m = in_image(index, on_ground, CAMERAS.index("CAM_FRONT"))
    # The first metres lie below the image's edge.
    assert len(pixels) >= 15
    assert (np.diff(depth_m) > 0.0).all()
    assert (np.diff(pixels[:, 1]) < 0.0).all()
    # From the bottom, in the middle, ...
    assert pixels[0, 1] > 800.0
    assert abs(pixels[0, 0] - WIDTH_PX / 2) < 60.0
    # ... to where a road at 38 m ends: just below the horizon, still about the middle.
    focal_px = index.rawpixel_from_camera[index.row_of(TOKEN), CAMERAS.index("CAM_FRONT"), 0, 0]
    assert pixels[-1, 1] == pytest.approx(491.0 + focal_px * 1.5 / 37.0, abs=15.0)
    assert abs(pixels[-1, 0] - WIDTH_PX / 2) < 60.0


def test_sweep_is_seen_by_all_six_cameras(index: SampleIndex, real_root: Path) -> None:
    points = load_sweep(index, real_root, index.row_of(TOKEN))
    counts = [len(in_image(index, points, n)[0]) for n in range(len(CAMERAS))]
    assert min(counts) > 2500
    # Of 32 beams on 360 degrees; neighbours overlap a little.
    assert 0.4 * len(points) < sum(counts) < 1.1 * len(points)


def test_lidar_depth_agrees_with_annotated_boxes(index: SampleIndex, real_root: Path) -> None:
    row = index.row_of(TOKEN)
    points = load_sweep(index, real_root, row)
    agree = []
    for centre_global, size_m, turn in _boxes(real_root):
        ego_from_box = invert(index.global_from_ego[row]) @ rigid_from_quaternion(
            np.asarray(centre_global), np.asarray(turn)
        )
        half_m = np.asarray([size_m[1], size_m[0], size_m[2]]) / 2.0
        signs = np.stack(np.meshgrid(*[[-1.0, 1.0]] * 3), axis=-1).reshape(-1, 3)
        corners = apply(ego_from_box, signs * half_m)
        for camera in range(len(CAMERAS)):
            outline, outline_depth_m = in_image(index, corners, camera)
            if len(outline) < 8:
                continue
            pixels, depth_m = in_image(index, points, camera)
            # The middle of the projected box: no road, and less of what is behind.
            reach = 0.25 * np.ptp(outline, axis=0)
            middle = (np.abs(pixels - outline.mean(axis=0)) < reach).all(axis=-1)
            if middle.sum() >= 3:
                depth = float(np.median(depth_m[middle]))
                agree.append(outline_depth_m.min() - 0.5 < depth < outline_depth_m.max() + 0.5)
    # What stands before or behind an object may fool the median now and then.
    assert len(agree) >= 10
    assert np.mean(agree) > 0.8


def _boxes(root: Path) -> list[tuple[list[float], list[float], list[float]]]:
    """Centre, size (width, length, height) and quaternion of what the sweep has hit well."""
    annotations: list[dict[str, Any]] = json.loads(
        (root / VERSION / "sample_annotation.json").read_text()
    )
    return [
        (row["translation"], row["size"], row["rotation"])
        for row in annotations
        if row["sample_token"] == TOKEN and row["num_lidar_pts"] >= 8
    ]
