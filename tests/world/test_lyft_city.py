"""A city that Lyft's car drove through: read, and seen by a planner of nuScenes' cameras."""

import json
from pathlib import Path

import numpy as np
import pytest
from nuscenes.nuscenes import NuScenes
from PIL import Image
from small_city import config, start
from world_fixture import Said, TinyRun, command, complaint

from lss_core.config import CAMERAS
from lss_core.data.samples import SampleIndex, load_index
from lss_core.data.sensors.lidar import load_sweep
from lss_core.errors import DataError
from lss_core.geometry import apply
from shoot.world.config import VERSION
from shoot.world.writer import make_world

SEVEN = (*CAMERAS, "CAM_FRONT_ZOOMED")


@pytest.fixture(scope="module")
def lyft_city(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """One scene; its first keyframes have images and five seconds ahead of them."""
    root = tmp_path_factory.mktemp("lyft") / "world"
    job = start(root, rig="lyft", train_scenes=0, duration_s=6.0, tail_s=4.9, image_scale=0.05)
    assert job.wait() == 0
    return root


@pytest.fixture(scope="module")
def index(lyft_city: Path) -> SampleIndex:
    return load_index(lyft_city, VERSION, SEVEN)


def test_all_seven_cameras_are_read(index: SampleIndex, lyft_city: Path) -> None:
    pictured = index.has_camera.all(axis=1)
    assert pictured.sum() >= 2
    assert np.array_equal(pictured, index.has_camera.any(axis=1))
    assert not index.scene_problem.any()
    assert not index.camera_problem.any()
    assert len(index.warning_text) == 0
    for path in index.image_path[0].tolist():
        assert Image.open(lyft_city / path).size == (96, 54)
    assert np.unique(index.image_hw[0], axis=0).tolist() == [[54, 96]]
    # The zoomed camera's focal length, at a twentieth of the size.
    assert index.rawpixel_from_camera[0, -1, 0, 0] == pytest.approx(3962.0 / 20, rel=0.01)


def test_images_come_up_to_a_tenth_of_a_second_before_the_sweep(index: SampleIndex) -> None:
    late_s = index.time_s[0] - index.camera_time_s[0]
    order = np.asarray(SEVEN)[np.argsort(-late_s[:6])]
    assert order.tolist() == ["CAM_BACK", "CAM_BACK_LEFT", "CAM_FRONT_LEFT", "CAM_FRONT",
                              "CAM_FRONT_RIGHT", "CAM_BACK_RIGHT"]  # fmt: skip
    assert late_s.max() == pytest.approx(0.103, abs=0.002)
    # Nothing was recorded before the first turn's start.
    assert index.camera_time_s[0].min() >= index.track_time_s[0] - 0.05


def test_sweeps_lie_on_the_road_the_right_way_round(index: SampleIndex, lyft_city: Path) -> None:
    points_ego = load_sweep(index, lyft_city, 0)
    assert np.quantile(points_ego[:, 2], 0.02) == pytest.approx(0.0, abs=0.1)
    points = apply(index.global_from_ego[0], points_ego)
    devkit = NuScenes(VERSION, str(lyft_city), verbose=False)
    data = devkit.get("sample", str(index.sample_token[0]))["data"]
    hits = 0
    for box in devkit.get_boxes(data["LIDAR_TOP"]):
        local = (points - box.center) @ box.rotation_matrix
        inside = (np.abs(local) < box.wlh[[1, 0, 2]] / 2 + 0.1).all(axis=1).sum()
        counted = devkit.get("sample_annotation", box.token)["num_lidar_pts"]
        assert inside >= 0.8 * counted
        hits += counted
    assert hits > 5


@pytest.mark.parametrize(("begun", "now"), [("lyft", "nuscenes"), ("nuscenes", "lyft")])
def test_another_rig_in_the_same_folder_is_refused(tmp_path: Path, begun: str, now: str) -> None:
    card = config(tmp_path, rig=begun).card()
    (tmp_path / "world.json").write_text(json.dumps(card))
    with pytest.raises(DataError, match="begun with rig"):
        make_world(config(tmp_path, rig=now))


def test_a_planner_of_nuscenes_cameras_drives_lyfts_car(
    tiny_run: TinyRun, lyft_city: Path, tmp_path: Path
) -> None:
    out = tmp_path / "report.json"

    def evaluate(*more: object) -> Said:
        options = ("--out", out, "--data.root", lyft_city, *more)
        return command("shoot-evaluate", tiny_run.folder, *options)

    def scores(*more: object) -> dict:
        said = evaluate(*more)
        assert said.status == 0, said.err
        return json.loads(out.read_text())

    six = scores()
    assert six == scores("--data.cameras", *CAMERAS)
    seven = scores("--data.cameras", *SEVEN)
    assert six["num_samples"] == seven["num_samples"] >= 2
    assert six != seven
    assert "CAM_FRONT_ZOOMED" in complaint(evaluate("--data.cameras", "CAM_TOP"))
