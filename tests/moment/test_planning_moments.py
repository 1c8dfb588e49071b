"""A sample given as plain images and a rig file is planned as an evaluation plans it."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from PIL import Image
from world_fixture import TinyRun

from lss_core.data.dataset import ego_from_camera
from lss_core.errors import DataError
from shoot.moment.planning import Moment, describe_plan, plan_moment, strange_lenses
from shoot.moment.rig_file import Rig, RigCamera, look_from, read_rig
from shoot.prediction.plain import PlainRun, open_plain
from shoot.prediction.run import open_run, predict
from shoot.training.planning.data import LabelledSplit, load_split


@pytest.fixture(scope="module")
def plain(tiny_run: TinyRun) -> PlainRun:
    return open_plain(tiny_run.folder)


@pytest.fixture(scope="module")
def split(plain: PlainRun) -> LabelledSplit:
    return load_split(plain.config.data, "val", plain.templates)


def as_rig(split: LabelledSplit, row: int, path: Path) -> tuple[Rig, dict[str, Path]]:
    """A sample's cameras as a rig file, their names and images."""
    index = split.index
    poses = ego_from_camera(index, row)
    entries: list[dict[str, Any]] = []
    for n, name in enumerate(index.cameras):
        height_px, width_px = (int(side) for side in index.image_hw[row, n])
        entries.append(
            {
                "name": str(name),
                "width_px": width_px,
                "height_px": height_px,
                "intrinsics": index.rawpixel_from_camera[row, n].tolist(),
                "ego_from_camera": poses[n].tolist(),
            }
        )
    path.write_text(yaml.safe_dump({"cameras": entries}))
    images = {str(name): Path(index.image_path[row, n]) for n, name in enumerate(index.cameras)}
    return read_rig(path), images


def test_as_an_evaluation_plans_it(
    tiny_run: TinyRun, plain: PlainRun, split: LabelledSplit, tmp_path: Path
) -> None:
    log_prob = predict(open_run(tiny_run.folder), split)
    for position in (0, len(split.labels) - 1):
        row = int(split.futures.sample[position])
        rig, images = as_rig(split, row, tmp_path / "rig.yaml")
        moment = Moment.of(rig, {name: tiny_run.root / path for name, path in images.items()})
        plan = plan_moment(plain, moment)
        np.testing.assert_allclose(plan.probabilities, np.exp(log_prob[position]), rtol=1e-5)
        # It would not be so of other images, nor of cameras as mounted on a car that stands.
        shuffled = replace(moment, paths=moment.paths[::-1])
        mounted = tuple(
            replace(camera, ego_from_camera=mounting)
            for camera, mounting in zip(
                rig.cameras, split.index.egocam_from_camera[row], strict=True
            )
        )
        for other in (shuffled, Moment(mounted, moment.paths)):
            said = plan_moment(plain, other).probabilities
            assert not np.allclose(said, plan.probabilities, rtol=1e-4)


def test_what_is_written(
    tiny_run: TinyRun, plain: PlainRun, split: LabelledSplit, tmp_path: Path
) -> None:
    row = int(split.futures.sample[0])
    rig, images = as_rig(split, row, tmp_path / "rig.yaml")
    # In another order than the rig's, and not all.
    some = {name: tiny_run.root / images[name] for name in ("CAM_BACK", "CAM_FRONT")}
    moment = Moment.of(rig, some)
    plan = plan_moment(plain, moment)
    told = describe_plan(plain, moment, plan, 1000)
    assert list(told["cameras"]) == ["CAM_FRONT", "CAM_BACK"]
    assert len(told["ranked"]) == len(plain.templates.points)
    chances = [one["probability"] for one in told["ranked"]]
    assert chances == sorted(chances, reverse=True)
    assert sum(chances) == pytest.approx(1.0, abs=1e-5)
    best = told["ranked"][0]
    template = plain.templates.points[best["template"]]
    np.testing.assert_allclose(best["points_m"], template, atol=1e-4)
    assert told["times_s"][0] == plain.templates.dt_s
    assert told["times_s"][-1] == plain.templates.horizon_s
    assert told["planner"]["run"] == tiny_run.folder.name
    assert told["planner"]["templates_sha256"] == plain.templates.sha256
    assert [one["rank"] for one in describe_plan(plain, moment, plan, 3)["ranked"]] == [1, 2, 3]


def test_any_number_of_cameras_of_any_sizes(plain: PlainRun, tmp_path: Path) -> None:
    rng = np.random.default_rng(4)
    entries, images = [], {}
    for number, (width_px, height_px) in enumerate([(64, 48), (200, 40), (30, 60)]):
        path = tmp_path / f"{number}.png"
        Image.fromarray(rng.integers(0, 256, (height_px, width_px, 3), np.uint8)).save(path)
        images[f"EYE{number}"] = path
        entries.append(
            {
                "name": f"EYE{number}",
                "width_px": width_px,
                "height_px": height_px,
                "intrinsics": {"fx": 60, "fy": 60, "cx": width_px / 2, "cy": height_px / 2},
                "position_m": [1.0, 0.2 * number, 1.4],
                "yaw_deg": 40.0 * number,
            }
        )
    (tmp_path / "rig.yaml").write_text(yaml.safe_dump({"cameras": entries}))
    moment = Moment.of(read_rig(tmp_path / "rig.yaml"), images)
    assert np.isfinite(plan_moment(plain, moment).probabilities).all()
    with pytest.raises(DataError, match="64x48 px, expected 200x40"):
        plan_moment(plain, Moment.of(Rig(moment.cameras), images | {"EYE1": images["EYE0"]}))
    with pytest.raises(DataError, match="'LEFT', which is no camera of the rig"):
        Moment.of(Rig(moment.cameras), {"LEFT": images["EYE0"]})


def test_a_camera_that_fired_before_was_further_back(tmp_path: Path) -> None:
    """At 10 m/s, 0.04 s are 0.4 m."""
    pose = look_from(np.array([1.5, 0.2, 1.4]), 0.3, 0.1, 0.0)
    camera = RigCamera("LEFT", (48, 64), np.diag([60.0, 60.0, 1.0]), pose, delay_s=-0.04)
    moved = Moment((camera,), (tmp_path,), speed_mps=10.0).ego_from_camera[0]
    np.testing.assert_allclose(moved[:3, 3], [1.1, 0.2, 1.4])
    np.testing.assert_array_equal(moved[:3, :3], pose[:3, :3])
    np.testing.assert_array_equal(camera.ego_from_camera[:3, 3], [1.5, 0.2, 1.4])


def test_lenses_unlike_those_of_training_are_told(
    plain: PlainRun, split: LabelledSplit, tmp_path: Path
) -> None:
    """The tiny run notes them itself; a lens twice as long is none of them."""
    rig, images = as_rig(split, int(split.futures.sample[0]), tmp_path / "rig.yaml")
    assert strange_lenses(plain, Moment.of(rig, images)) == []
    front = rig.cameras[1]
    longer = np.diag([2.0, 2.0, 1.0]) @ front.rawpixel_from_camera
    zoomed = replace(front, rawpixel_from_camera=longer)
    (sentence,) = strange_lenses(plain, Moment((zoomed,), (tmp_path,)))
    focal_px = longer[0, 0] * plain.config.data.image.width_px / front.image_hw[1]
    assert f"'{front.name}' has a focal length of {focal_px:.0f} px" in sentence
