"""What shoot-check says of data sets with mistakes, and of things that are not there."""

import json
import math
import re
import shutil
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import pytest
from checked_data import Row, bad, check, findings, report_of
from PIL import Image
from tiny_tables import KEYFRAMES_A_SCENE, VERSION, TinyScene, read_table, write_table, write_tiny

from lss_core.config import CAMERAS, ImageConfig
from lss_core.data.samples import load_index
from shoot.data_report import format_report, survey, view_cameras

HALF = math.sqrt(0.5)


def test_findings_are_printed_last(spoilt: Path) -> None:
    shutil.rmtree(spoilt / "samples" / "CAM_BACK")
    said = check(spoilt)
    assert said.status == 0, said.err
    assert said.out.strip().splitlines()[-1].startswith("warning: missing images (CAM_BACK)")


# What is wrong, or not there


def test_a_calibration_that_cannot_be(spoilt: Path, tmp_path: Path) -> None:
    calibrations = read_table(spoilt, "calibrated_sensor")
    calibrations[2]["camera_intrinsic"][0][0] = -1.0
    write_table(spoilt, "calibrated_sensor", calibrations)
    report = report_of(spoilt, tmp_path / "out", status=2)
    (finding,) = report["findings"]
    assert (finding["level"], finding["reason"]) == ("error", "impossible calibration")
    assert finding["where"].startswith(f"{KEYFRAMES_A_SCENE} of ")
    assert calibrations[2]["token"] in finding["texts"][0]
    # The camera's facts are those of its other calibrations.
    heights = {camera["height_m"]["least"] for camera in report["cameras"]}
    assert heights == {1.5}


def test_the_report_comes_before_the_complaint(spoilt: Path) -> None:
    poses = read_table(spoilt, "ego_pose")
    poses[-1]["translation"][0] += 1e5
    write_table(spoilt, "ego_pose", poses)
    said = check(spoilt)
    assert said.status == 2
    assert "CAM_FRONT_LEFT" in said.out
    assert re.search(r"^error: [a-z ]+ \(1 of 3 scenes\): records? 'scene-0003-", said.out, re.M)
    (complaint,) = said.err.strip().splitlines()
    assert complaint.startswith("error: ")
    assert str(spoilt) in complaint


def test_turned_frames_show_in_the_direction_of_motion(spoilt: Path) -> None:
    poses = read_table(spoilt, "ego_pose")
    for pose in poses:
        # The heading turned by a quarter to the right: y points forward.
        w, z = pose["rotation"][0], pose["rotation"][3]
        half = math.sqrt(0.5)
        pose["rotation"] = [half * (w + z), 0.0, 0.0, half * (z - w)]
    write_table(spoilt, "ego_pose", poses)
    index = load_index(spoilt, VERSION, CAMERAS)
    angle = survey(index, spoilt, VERSION).motion.off_axis_deg
    assert angle.median == pytest.approx(90.0, abs=0.1)
    assert view_cameras(index, spoilt, ImageConfig())["CAM_FRONT"][0].driven is not None


def test_images_of_another_size(spoilt: Path, tmp_path: Path) -> None:
    for path in (spoilt / "samples" / "CAM_FRONT").glob("*.jpg"):
        Image.new("RGB", (80, 45)).save(path)
    report = report_of(spoilt, tmp_path / "out", status=2, cameras=("CAM_FRONT", "CAM_BACK"))
    (finding,) = report["findings"]
    assert (finding["level"], finding["reason"]) == ("error", "unusable files")
    assert "80x45 px, expected 160x90" in finding["texts"][0]
    # Nothing can be drawn into them.
    assert not (tmp_path / "out" / "CAM_FRONT.png").exists()
    assert (tmp_path / "out" / "CAM_BACK.png").exists()


def test_tables_alone(spoilt: Path, tmp_path: Path) -> None:
    shutil.rmtree(spoilt / "samples")
    report = report_of(spoilt, tmp_path / "out")
    assert findings(report) == [("note", "missing images"), ("note", "missing sweeps")]


def test_sizes_that_tables_lack_are_those_of_files(spoilt: Path) -> None:
    frames = read_table(spoilt, "sample_data")
    for frame in frames:
        del frame["width"], frame["height"]
    write_table(spoilt, "sample_data", frames)
    index = load_index(spoilt, VERSION, CAMERAS)
    camera = survey(index, spoilt, VERSION).cameras[0]
    assert list(camera.sizes) == ["unknown"]
    assert camera.field_deg.median == pytest.approx(2 * math.degrees(math.atan(80 / 128)), abs=0.01)


def test_a_split_whose_scenes_are_missing(spoilt: Path, tmp_path: Path) -> None:
    splits = {"train": ["scene-0001", "scene-0007"], "val": ["scene-0008"]}
    (spoilt / VERSION / "splits.json").write_text(json.dumps(splits))
    report = report_of(spoilt, tmp_path / "out", status=2)
    drives = report["drives"]
    counts = [(s["name"], s["num_listed"], s["num_scenes"]) for s in drives["splits"]]
    assert counts == [("train", 2, 1), ("val", 1, 0)]
    assert drives["num_scenes_in_no_split"] == 2
    assert findings(report) == 2 * [("error", "scenes not in the tables")]
    assert [finding["texts"] for finding in report["findings"]] == [["scene-0007"], ["scene-0008"]]


def test_one_moment_has_no_speed_and_no_future(tmp_path: Path) -> None:
    root = write_tiny(tmp_path / "data", (TinyScene("made-up", seconds=0.0),))
    report = report_of(root, tmp_path / "out")
    assert report["motion"]["speed_mps"]["median"] is None
    assert report["drives"]["pose_step_s"]["most"] is None
    assert findings(report) == [("note", "no futures"), ("note", "no splits")]


def test_scenes_without_lidar(tmp_path: Path) -> None:
    root = write_tiny(tmp_path / "data", (TinyScene("scene-0001", has_lidar=False),))
    report = report_of(root, tmp_path / "out")
    assert report["lidar"]["num_keyframes"] == 0
    assert bad(report) == []


def write_boxes(root: Path, names: Sequence[str]) -> None:
    """A box of each category at the first sample, one beside the other."""
    tokens = [str(number) for number in range(len(names))]
    sample = read_table(root, "sample")[0]["token"]
    pairs = list(zip(tokens, names, strict=True))
    write_table(root, "category", [{"token": token, "name": name} for token, name in pairs])
    write_table(root, "instance", [{"token": t, "category_token": t} for t in tokens])
    boxes = [
        {
            "token": token,
            "sample_token": sample,
            "instance_token": token,
            "translation": [3.0 * number, 0.0, 0.0],
            "size": [1.0, 1.0, 1.0],
            "rotation": [1.0, 0.0, 0.0, 0.0],
        }
        for number, token in enumerate(tokens)
    ]
    write_table(root, "sample_annotation", boxes)


def test_boxes_by_category(spoilt: Path, tmp_path: Path) -> None:
    write_boxes(spoilt, ["vehicle.car", "movable_object.barrier", "gadget"])
    report = report_of(spoilt, tmp_path / "out")
    counted = {box["name"]: (box["num_boxes"], box["is_counted"]) for box in report["boxes"]}
    assert counted == {
        "vehicle.car": (1, True),
        "movable_object.barrier": (1, False),
        "gadget": (1, None),
    }
    assert bad(report) == [("warning", "unknown categories")]
    assert "gadget" in report["findings"][0]["texts"][0]


def test_boxes_that_cannot_be(spoilt: Path, tmp_path: Path) -> None:
    write_boxes(spoilt, ["vehicle.car"])
    boxes = read_table(spoilt, "sample_annotation")
    boxes[0]["size"] = [-1.0, 1.0, 1.0]
    write_table(spoilt, "sample_annotation", boxes)
    report = report_of(spoilt, tmp_path / "out", status=2)
    assert findings(report) == [("error", "unusable annotations")]
    assert report["boxes"] is None


def test_a_damaged_map(spoilt: Path, tmp_path: Path) -> None:
    (spoilt / "maps" / "expansion").mkdir(parents=True)
    (spoilt / "maps" / "expansion" / "boston-seaport.json").write_text("{}")
    report = report_of(spoilt, tmp_path / "out", status=2)
    assert findings(report) == [("error", "unusable map")]
    assert report["locations"][0]["on_road"] is None


def test_names_cannot_steer_a_terminal(tmp_path: Path) -> None:
    root = write_tiny(tmp_path / "data", (TinyScene("scene-0001"),))
    logs = read_table(root, "log")
    logs[0]["location"] = "\x1b[2Jhere"
    write_table(root, "log", logs)
    index = load_index(root, VERSION, CAMERAS)
    text = format_report(survey(index, root, VERSION))
    assert "\x1b" not in text
    assert "here" in text


# Tables made wrong on purpose; all that is named: test_check_mistakes.py


def never_turned(record: Row) -> None:
    record["rotation"] = [1.0, 0.0, 0.0, 0.0]


def full_size_intrinsics(record: Row) -> None:
    if record["camera_intrinsic"]:
        rows = 2.0 * np.asarray(record["camera_intrinsic"][:2])
        record["camera_intrinsic"] = [*rows.tolist(), [0.0, 0.0, 1.0]]


@pytest.mark.parametrize(
    ("table", "spoil", "mistake"),
    [
        ("ego_pose", never_turned, "as if headings had never been written"),
        ("calibrated_sensor", full_size_intrinsics, "intrinsics of images 2 times as large"),
    ],
)
def test_mistakes_are_named_and_drawn(
    table: str, spoil: Callable[[Row], None], mistake: str, spoilt: Path, tmp_path: Path
) -> None:
    records = read_table(spoilt, table)
    for record in records:
        spoil(record)
    write_table(spoilt, table, records)
    report = report_of(spoilt, tmp_path / "out", status=2)
    errors = [one for one in report["findings"] if one["level"] == "error"]
    assert any(mistake in text for one in errors for text in one["texts"]), errors
    # What can be drawn shows it.
    assert (tmp_path / "out" / "CAM_FRONT.png").exists()


def test_warnings_of_the_index_are_findings(spoilt: Path, tmp_path: Path) -> None:
    frames = read_table(spoilt, "sample_data")
    for frame in frames:
        frame["is_key_frame"] = True
    write_table(spoilt, "sample_data", frames)
    report = report_of(spoilt, tmp_path / "out")
    assert findings(report) == [("warning", "several keyframes")]


# What users get wrong


def test_wrong_places(tiny_root: Path, tmp_path: Path) -> None:
    for said, word in (
        (check(tmp_path / "nowhere"), "nowhere"),
        (check(tiny_root, "--data.version", "v1.0-mini"), "v1.0-mini"),
        (check(tiny_root, "--data.cameras", "CAM_ROOF"), "CAM_ROOF"),
    ):
        assert said.status == 2
        (complaint,) = said.err.strip().splitlines()
        assert complaint.startswith("error: ")
        assert word in complaint
