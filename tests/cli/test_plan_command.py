"""shoot-plan: the example as it is printed, a stream of it, and what users get wrong."""

import json
import shlex
import shutil
from pathlib import Path

import numpy as np
import pytest
from PIL import Image, ImageOps
from world_fixture import command, complaint, start_command

from lss_core.config import CAMERAS
from shoot.moment.rig_file import read_rig
from shoot.moment.rig_text import format_rig


@pytest.fixture(scope="module")
def example(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of an example; what the command said is `said.txt` there."""
    folder = tmp_path_factory.mktemp("plan") / "my rig"
    folder.mkdir()
    writing = start_command("shoot-plan", "--example", folder, log=folder / "said.txt")
    writing.join()
    assert writing.exitcode == 0, (folder / "said.txt").read_text()
    return folder


def test_the_example_is_planned_as_it_says(example: Path) -> None:
    line = (example / "said.txt").read_text().splitlines()[-1]
    name, *arguments = shlex.split(line)
    said = command(name, *arguments)
    assert said.status == 0, said.err
    assert "no planner for real roads" in " ".join((said.out + said.err).split())
    assert "The 10 most probable of 1000 templates" in said.out
    told = json.loads((example / "plan.json").read_text())
    assert list(told["cameras"]) == list(CAMERAS)
    assert told["planner"]["run"] == "synthetic-1000"
    assert "synthetic city" in told["planner"]["trained_on"]["note"]
    assert len(told["ranked"]) == 20
    assert told["speed_mps"] > 1.0
    # It turns left there.
    assert all(one["points_m"][-1][1] > 10.0 for one in told["ranked"][:3])
    with Image.open(example / "plan.png") as picture:
        assert min(picture.size) > 800
    again = example / "again.json"
    assert command(name, *arguments, "--out", again).status == 0
    assert again.read_bytes() == (example / "plan.json").read_bytes()


def test_a_rig_file_there_and_back(example: Path, tmp_path: Path) -> None:
    rig = read_rig(example / "rig.yaml")
    (tmp_path / "rig.yaml").write_text(format_rig(list(rig.cameras)))
    for one, other in zip(rig.cameras, read_rig(tmp_path / "rig.yaml").cameras, strict=True):
        assert (one.name, one.image_hw) == (other.name, other.image_hw)
        np.testing.assert_allclose(one.ego_from_camera, other.ego_from_camera, atol=1e-5)
        np.testing.assert_allclose(one.rawpixel_from_camera, other.rawpixel_from_camera)


def test_a_stream_is_planned_frame_by_frame(example: Path, tmp_path: Path) -> None:
    av = pytest.importorskip("av")
    for name in ("CAM_FRONT", "CAM_BACK"):
        (tmp_path / name).mkdir()
        seen = example / f"{name}.jpg"
        shutil.copy(seen, tmp_path / name / "frame_0010.jpg")
        with Image.open(seen) as image:
            ImageOps.mirror(image).save(tmp_path / name / "frame_9.png")
    shutil.copy(seen, tmp_path / "CAM_BACK" / "0011.jpg")  # the front camera has none
    out, video = tmp_path / "plan.jsonl", tmp_path / "plan.mp4"
    rig = ("--rig", example / "rig.yaml")
    said = command(
        "shoot-plan", *rig, "--stream", tmp_path, "--out", out, "--picture", video, "--top", 3
    )
    assert said.status == 0, said.err
    told = " ".join((said.out + said.err).split())
    assert "left out: 1" in told
    assert "without an image: CAM_FRONT_LEFT, CAM_FRONT_RIGHT, CAM_BACK_LEFT" in told
    first, second = (json.loads(line) for line in out.read_text().splitlines())
    assert [first.pop("number"), second.pop("number")] == [9, 10]
    assert first["ranked"] != second["ranked"]
    with av.open(str(video)) as container:
        assert sum(1 for _ in container.decode(video=0)) == 2
    # As the same images alone.
    images = [f"{name}={tmp_path / name / 'frame_0010.jpg'}" for name in ("CAM_FRONT", "CAM_BACK")]
    one, picture = tmp_path / "one.json", tmp_path / "one.png"
    flags = ("--out", one, "--picture", picture, "--top", 3)
    assert command("shoot-plan", *rig, "--images", *images, *flags).status == 0
    assert json.loads(one.read_text()) == second


def test_a_stream_without_frames(example: Path, tmp_path: Path) -> None:
    rig = ("--rig", example / "rig.yaml", "--stream", tmp_path)
    assert "no folder named as a camera" in complaint(command("shoot-plan", *rig))
    (tmp_path / "CAM_FRONT").mkdir()
    assert "no frame that all of CAM_FRONT have" in complaint(command("shoot-plan", *rig))
    for name in ("1.jpg", "image1.jpg"):
        shutil.copy(example / "CAM_FRONT.jpg", tmp_path / "CAM_FRONT" / name)
    assert "two images of frame 1" in complaint(command("shoot-plan", *rig))


def test_mistakes_are_one_sentence(example: Path, tmp_path: Path) -> None:
    rig, front = ("--rig", example / "rig.yaml"), f"CAM_FRONT={example / 'CAM_FRONT.jpg'}"
    out = ("--out", tmp_path / "plan.json", "--picture", tmp_path / "plan.png")
    for arguments, words in (
        ((), "rig is missing"),
        (rig, "images or stream"),
        ((*rig, "--images", front, "--stream", tmp_path), "images or stream"),
        ((*rig, "--images", front[10:]), "no NAME=FILE"),
        ((*rig, "--images", front, front), "two images of 'CAM_FRONT'"),
        ((*rig, "--images", front.replace("FRONT=", "AHEAD=")), "no camera of the rig"),
        ((*rig, "--images", "CAM_FRONT=nowhere.jpg"), "nowhere.jpg"),
        (("--rig", tmp_path / "rig.yaml", "--images", front), "There is no rig file"),
        ((*rig, "--images", front, "--run", tmp_path), "no run folder"),
    ):
        assert words in complaint(command("shoot-plan", *arguments, *out)), words
    strange = ("--out", tmp_path / "plan.json", "--picture", tmp_path / "plan.xyz")
    said = command("shoot-plan", *rig, "--images", front, *strange)
    assert "its name must end in one of" in complaint(said)
    assert not (tmp_path / "plan.json").exists()
