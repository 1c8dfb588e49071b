"""Bad data through the commands: one line and status 2, or all that is bad listed in a file."""

import json
import shutil
from pathlib import Path
from typing import Any

import pytest
import tally
import world_fixture
from bad_data import OUTCOME, Case, Spoil, change, check_sentence, rewrite
from bad_files import IMAGES
from bad_records import CALIBRATIONS, NAN, POSES
from bad_tables import SPLITS, TABLE_CASES
from PIL import Image
from test_bad_data import sound  # noqa: F401
from tiny_tables import read_table
from world_fixture import Said, TinyRun, command, copy_run, train_flags

from lss_core.config import CAMERAS


def complaint(said: Said) -> str:
    """The one line that a command ended with."""
    line = world_fixture.complaint(said)
    check_sentence(line)
    return line


@pytest.fixture
def run(tiny_run: TinyRun, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> TinyRun:
    """A copy of data and run that a test may spoil; the run reads the copy."""
    monkeypatch.setenv("SHOOT_CACHE", str(tmp_path / "cache"))
    return copy_run(tiny_run, tmp_path)


def fit(root: Path, out: Path, *more: object) -> Said:
    return command("shoot-fit-templates", "--data.root", root, "--out", out, "--k", 5, *more)


def train(run: TinyRun, *more: object) -> Said:
    out = run.folder.with_name("new")
    return command("shoot-train", *train_flags(run.root, run.templates, out, 2, 2), *more)


def evaluate(run: TinyRun, *more: object) -> Said:
    return command("shoot-evaluate", run.folder, "--out", run.folder / "report.json", *more)


def render(run: TinyRun, *more: object) -> Said:
    return command("shoot-render", run.folder, "--out", run.folder / "pictures", *more)


def calibration(scene: str, **values: Any) -> Spoil:
    return change("calibrated_sensor", f"{scene}-{CAMERAS[0]}", **values)


def leap(scene: str, number: int = 30) -> Spoil:
    """A sweep's pose that is not to be reached."""

    def spoil(root: Path) -> None:
        own = [r for r in read_table(root, "ego_pose") if r["token"].startswith(f"{scene}-LIDAR")]
        change("ego_pose", own[number]["token"], translation=[0.0, 0.0, 0.0])(root)

    return spoil


def cut(scene: str, number: int, camera: str = CAMERAS[1]) -> Spoil:
    def spoil(root: Path) -> None:
        path = root / "samples" / camera / f"{scene}-{number:02d}.jpg"
        path.write_bytes(path.read_bytes()[:-300])

    return spoil


# What ends in each command, and a word of its sentence.
_EACH: dict[str, tuple[Spoil, str]] = {
    "calibration": (calibration("scene-0003", camera_intrinsic=[[NAN] * 3] * 3), "scene-0003-CAM"),
    "image": (cut("scene-0003", 0), "scene-0003-00.jpg"),
    "poses": (leap("scene-0003"), "scene-0003-LIDAR_TOP"),
}


@pytest.mark.parametrize("name", _EACH)
def test_each_command_ends_in_one_sentence(name: str, run: TinyRun, tmp_path: Path) -> None:
    spoil, word = _EACH[name]
    spoil(run.root)
    said = [train(run), evaluate(run), render(run)]
    if name == "poses":
        said.append(fit(run.root, tmp_path / "t.npz", "--split", "val"))
    for one in said:
        with tally.throw("bad data: in commands", OUTCOME):
            assert word in complaint(one)
            if name != "image":  # found when it is read
                assert "--data.skip-bad" in one.err


def test_training_lists_what_it_leaves_out(run: TinyRun) -> None:
    with tally.throw("bad data: in commands", OUTCOME, times=5):
        calibration("scene-0001", rotation=[0.0] * 4)(run.root)
        leap("scene-0002")(run.root)
        cut("scene-0004", 1)(run.root)
        (run.root / "samples" / CAMERAS[2] / "scene-0004-02.jpg").write_bytes(b"")
        (run.root / "samples" / CAMERAS[2] / "scene-0003-02.jpg").unlink()
        said = train(run, "--skip-bad")
        assert said.status == 0, said.err
        listed = json.loads((run.folder.with_name("new") / "left_out.json").read_text())
        assert listed["train"]["by_reason"] == {
            "impossible motion": 15, "impossible calibration": 5, "damaged image": 2
        }  # fmt: skip
        assert listed["train"]["count"] == len(listed["train"]["list"]) == 22
        assert [one["sample"] for one in listed["val"]["list"]] == ["scene-0003-02"]
        assert "Left out 15 of 60 samples: 15 impossible motion" in " ".join(said.out.split())
        # What is left: the two whole scenes' five samples each, without two.
        assert "Training on 8 samples" in said.out


def test_evaluation_and_pictures_list_what_they_leave_out(run: TinyRun) -> None:
    with tally.throw("bad data: in commands", OUTCOME, times=3):
        leap("scene-0012")(run.root)
        cut("scene-0013", 1)(run.root)
        calibration("scene-0002", rotation=[0.0] * 4)(run.root)  # of training: only poses are read
        html = run.folder / "report.html"
        said = evaluate(run, "--data.skip-bad", "--html", html)
        assert said.status == 0, said.err
        report = json.loads((run.folder / "report.json").read_text())
        assert (report["num_samples"], report["num_bad_samples"]) == (9, 16)
        assert "16 samples that cannot be used" in html.read_text()
        listed = json.loads((run.folder / "report.left_out.json").read_text())["val"]
        assert listed["by_reason"] == {"impossible motion": 15, "damaged image": 1}
        said = render(run, "--skip-bad", "--num", 2)
        assert said.status == 0, said.err
        pictures = run.folder / "pictures"
        assert json.loads((pictures / "left_out.json").read_text())["val"] == listed
        assert len(list(pictures.glob("*.png"))) == 2
        said = render(run, "--data.skip-bad", "--token", "scene-0013-01")
        assert "scene-0013-01.jpg" in complaint(said)


def test_templates_list_scenes_they_leave_out(run: TinyRun, tmp_path: Path) -> None:
    with tally.throw("bad data: in commands", OUTCOME, times=2):
        leap("scene-0002")(run.root)
        change("ego_pose", _first_pose(run.root, "scene-0004"), rotation=[NAN] * 4)(run.root)
        for flags in ([], ["--stream"]):
            out = tmp_path / f"t{len(flags)}.npz"
            assert "'scene-0002-LIDAR_TOP" in complaint(fit(run.root, out, *flags))
            said = fit(run.root, out, "--skip-bad", *flags)
            assert said.status == 0, said.err
            card = json.loads(out.with_suffix(".json").read_text())
            assert (card["num_scenes"], card["num_bad_scenes"]) == (2, 2)
            listed = json.loads((tmp_path / f"t{len(flags)}.left_out.json").read_text())["train"]
            assert [(one["scene"], one["sample"]) for one in listed["list"]] == [
                ("scene-0002", ""), ("scene-0004", "")
            ]  # fmt: skip


def _first_pose(root: Path, scene: str) -> str:
    tokens = (str(record["token"]) for record in read_table(root, "ego_pose"))
    return next(token for token in tokens if token.startswith(f"{scene}-LIDAR"))


def test_lidar_and_depth_training_look_at_sweeps(run: TinyRun) -> None:
    with tally.throw("bad data: in commands", OUTCOME, times=2):
        sweep = run.root / "samples" / "LIDAR_TOP" / "scene-0001-005.pcd.bin"
        whole = sweep.read_bytes()
        sweep.unlink()
        flags = ["--optim.depth-weight", 0.1]
        assert sweep.name in complaint(train(run, *flags))
        sweep.write_bytes(whole[:-7])
        said = train(run, *flags, "--data.skip-bad")
        assert said.status == 0, said.err
        listed = json.loads((run.folder.with_name("new") / "left_out.json").read_text())
        assert listed["train"]["by_reason"] == {"damaged lidar sweep": 1}


def test_render_of_a_rig_with_other_sizes(run: TinyRun) -> None:
    """As Lyft has it: sizes absent from the tables, and not the same for all cameras."""
    with tally.throw("bad data: in commands", OUTCOME):
        rewrite(
            "sample_data",
            lambda rs: [{k: v for k, v in r.items() if k not in ("width", "height")} for r in rs],
        )(run.root)
        for path in (run.root / "samples" / CAMERAS[1]).glob("*.jpg"):
            path.write_bytes((run.root / "samples" / CAMERAS[0] / path.name).read_bytes())
        for path in (run.root / "samples" / CAMERAS[2]).glob("*.jpg"):
            Image.new("RGB", (61, 70), "red").save(path)
        said = render(run, "--num", 1)
        assert said.status == 0, said.err


FIT_CASES: list[Case] = [
    case
    for case in (*POSES, *TABLE_CASES, *SPLITS)
    if case.says is not None and case.skipped is None
]


@pytest.fixture
def spoilt(
    sound: Path,  # noqa: F811
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> Path:
    monkeypatch.setenv("SHOOT_CACHE", str(tmp_path / "cache"))
    shutil.copytree(sound, tmp_path / "data")
    return tmp_path / "data"


@pytest.mark.full
@pytest.mark.parametrize("case", FIT_CASES, ids=str)
def test_fitting_ends_in_one_sentence(case: Case, spoilt: Path, tmp_path: Path) -> None:
    case.spoil(spoilt)
    assert case.says is not None
    with tally.throw("bad data: in commands", OUTCOME):
        for flags in ([], ["--data.skip-bad"]):
            line = complaint(
                fit(spoilt, tmp_path / "t.npz", "--data.cameras", *CAMERAS[:2], *flags)
            )
            # Where a scene is too short, there is nothing to fit.
            assert any(word in line for word in (*case.says, "to 0 trajectories"))


ALL_OF_A_SAMPLE = [c for c in (*IMAGES, *CALIBRATIONS) if c.says is not None and not c.lidar]


@pytest.mark.full
@pytest.mark.parametrize("case", ALL_OF_A_SAMPLE, ids=str)
def test_pictures_end_in_one_sentence(case: Case, run: TinyRun) -> None:
    """The cases are made for a scene that the tiny run's data has, too."""
    case.spoil(run.root)
    with tally.throw("bad data: in commands", OUTCOME):
        complaint(render(run, "--split", "train", "--num", 20))
        said = render(run, "--split", "train", "--data.skip-bad", "--num", 20)
        if said.status:
            assert case.skipped is None
            complaint(said)
        else:
            listed = json.loads((run.folder / "pictures" / "left_out.json").read_text())
            num_pictures = len(list((run.folder / "pictures").glob("*.png")))
            assert num_pictures == 20 - listed["train"]["count"] < 20
