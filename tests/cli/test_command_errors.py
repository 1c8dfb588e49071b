"""What users get wrong: every command says it in one sentence and ends with status 2."""

import json
import shutil
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from tiny_tables import VERSION, read_table, write_table
from world_fixture import Said, TinyRun, command, complaint, evaluate, train_flags, write_rides

from lss_core import image_encoder
from shoot.cli import app
from shoot.templates import TemplateSet


def fit(root: Path, out: Path, *more: object) -> Said:
    return command("shoot-fit-templates", "--data.root", root, "--out", out, "--k", 10, *more)


def train(run: TinyRun, out: Path, *more: object) -> Said:
    return command("shoot-train", *train_flags(run.root, run.templates, out, 2, 1), *more)


def first_val_image(root: Path) -> Path:
    """The front image of the first validation sample."""
    return root / "samples" / "CAM_FRONT" / "scene-0003-00.jpg"


# Data


def test_wrong_data_root(tmp_path: Path) -> None:
    assert str(tmp_path / "nowhere") in complaint(fit(tmp_path / "nowhere", tmp_path / "t.npz"))


def test_version_without_tables(tiny_run: TinyRun, tmp_path: Path) -> None:
    said = fit(tiny_run.root, tmp_path / "t.npz", "--data.version", "v1.0-mini")
    assert "v1.0-mini" in complaint(said)
    (tmp_path / "v1.0-trainval").mkdir()
    assert str(tmp_path) in complaint(fit(tmp_path, tmp_path / "t.npz"))


def test_table_cut_off(tmp_path: Path) -> None:
    root = write_rides(tmp_path / "data")
    table = root / VERSION / "ego_pose.json"
    table.write_text(table.read_text()[:-100])
    assert "ego_pose" in complaint(fit(root, tmp_path / "t.npz"))


def test_table_that_points_nowhere(tmp_path: Path) -> None:
    root = write_rides(tmp_path / "data")
    poses = read_table(root, "ego_pose")
    write_table(root, "ego_pose", poses[:-1])
    complaint(fit(root, tmp_path / "t.npz"))


@pytest.mark.parametrize("name", ["shoot-fit-templates", "shoot-evaluate", "shoot-render"])
def test_unknown_split(name: str, tiny_run: TinyRun, tmp_path: Path) -> None:
    if name == "shoot-fit-templates":
        said = fit(tiny_run.root, tmp_path / "t.npz", "--split", "validation")
    else:
        said = command(name, tiny_run.folder, "--split", "validation", "--out", tmp_path / "out")
    assert "'validation'" in complaint(said)
    assert "val" in said.err


def test_scene_in_training_and_validation(spoilt: TinyRun, tmp_path: Path) -> None:
    splits = {"train": ["scene-0001", "scene-0003"], "val": ["scene-0003"]}
    (spoilt.root / VERSION / "splits.json").write_text(json.dumps(splits))
    assert "scene-0003" in complaint(train(spoilt, tmp_path / "new"))


def test_missing_image(spoilt: TinyRun, tmp_path: Path) -> None:
    first_val_image(spoilt.root).unlink()
    for said in (
        train(spoilt, tmp_path / "new"),
        evaluate(spoilt),
        command("shoot-render", spoilt.folder, "--out", tmp_path / "pictures"),
    ):
        assert str(first_val_image(spoilt.root)) in complaint(said)


def test_missing_images_are_skipped_where_allowed(spoilt: TinyRun) -> None:
    first_val_image(spoilt.root).unlink()
    said = evaluate(spoilt, "--data.skip-bad")
    assert said.status == 0, said.err
    report = json.loads((spoilt.folder / "report.json").read_text())
    assert (report["num_samples"], report["num_bad_samples"]) == (14, 1)
    listed = json.loads((spoilt.folder / "report.left_out.json").read_text())["val"]
    assert listed["by_reason"] == {"missing image": 1}
    assert listed["list"][0]["sample"] == "scene-0003-00"
    # When the data set is mended, nothing says otherwise.
    shutil.copy(
        first_val_image(spoilt.root).with_stem("scene-0003-01"), first_val_image(spoilt.root)
    )
    assert evaluate(spoilt, "--data.skip-bad").status == 0
    assert not (spoilt.folder / "report.left_out.json").exists()


@pytest.mark.parametrize("num_workers", [0, 1])
def test_truncated_image(num_workers: int, spoilt: TinyRun, tmp_path: Path) -> None:
    image = first_val_image(spoilt.root)
    image.write_bytes(image.read_bytes()[:-300])
    said = train(spoilt, tmp_path / "new", "--num-workers", num_workers)
    assert str(image) in complaint(said)
    if num_workers == 0:
        assert str(image) in complaint(evaluate(spoilt))


def test_image_that_is_none(spoilt: TinyRun, tmp_path: Path) -> None:
    first_val_image(spoilt.root).write_text("no image")
    said = command("shoot-render", spoilt.folder, "--num", 1, "--out", tmp_path / "pictures")
    assert str(first_val_image(spoilt.root)) in complaint(said)


def test_missing_lidar_sweep(spoilt: TinyRun, tmp_path: Path) -> None:
    for sweep in (spoilt.root / "samples" / "LIDAR_TOP").glob("scene-0003-000*"):
        sweep.unlink()
    flags = ["--num", 1, "--lidar", "--out", tmp_path / "pictures"]
    assert "scene-0003-000" in complaint(command("shoot-render", spoilt.folder, *flags))


def test_unknown_token(tiny_run: TinyRun, tmp_path: Path) -> None:
    flags = ["--token", "nothing", "--out", tmp_path]
    assert "'nothing'" in complaint(command("shoot-render", tiny_run.folder, *flags))


def test_sample_without_future(tiny_run: TinyRun, tmp_path: Path) -> None:
    flags = ["--token", "scene-0003-14", "--out", tmp_path]
    assert "future" in complaint(command("shoot-render", tiny_run.folder, *flags))


# Templates


def test_more_templates_than_trajectories(tiny_run: TinyRun, tmp_path: Path) -> None:
    said = complaint(fit(tiny_run.root, tmp_path / "t.npz", "--k", 1000))
    assert "1000" in said
    assert "84" in said


def test_template_file_of_another_name(tiny_run: TinyRun, tmp_path: Path) -> None:
    assert ".npz" in complaint(fit(tiny_run.root, tmp_path / "templates.json"))


def test_template_file_missing_or_damaged(tiny_run: TinyRun, tmp_path: Path) -> None:
    missing = replace(tiny_run, templates=tmp_path / "none.npz")
    assert "none.npz" in complaint(train(missing, tmp_path / "run"))
    damaged = replace(tiny_run, templates=tmp_path / "damaged.npz")
    damaged.templates.write_bytes(tiny_run.templates.read_bytes()[:-50])
    assert "damaged.npz" in complaint(train(damaged, tmp_path / "run"))
    assert not (tmp_path / "run").exists()


def other_templates(run: TinyRun, path: Path) -> Path:
    templates = TemplateSet.load(run.templates)
    replace(templates, points=templates.points + np.float32(0.5)).save(path)
    return path


def test_checkpoint_with_other_templates(spoilt: TinyRun, tmp_path: Path) -> None:
    other = other_templates(spoilt, tmp_path / "other.npz")
    assert "other templates" in complaint(evaluate(spoilt, "--templates", other))
    steps = train_flags(spoilt.root, other, spoilt.folder, 4, 2)
    said = complaint(command("shoot-train", *steps, "--resume"))
    assert "other templates" in said
    assert str(other) in said
    # Also where the run's own copy has been replaced.
    shutil.copy(other, spoilt.folder / "templates.npz")
    assert "other templates" in complaint(evaluate(spoilt))
    assert "other templates" in complaint(command("shoot-train", *steps, "--resume"))


# Runs


@pytest.mark.parametrize("name", ["shoot-evaluate", "shoot-render"])
def test_folder_that_is_no_run(name: str, tmp_path: Path) -> None:
    said = command(name, tmp_path, "--out", tmp_path / "out")
    assert f"'{tmp_path}' is no run folder" in complaint(said)


def test_run_folder_in_use(tiny_run: TinyRun) -> None:
    assert "--resume" in complaint(train(tiny_run, tiny_run.folder))


def test_resuming_with_other_settings(tiny_run: TinyRun) -> None:
    flags = train_flags(tiny_run.root, tiny_run.templates, tiny_run.folder, 4, 2)
    said = command("shoot-train", *flags, "--resume", "--seed", "3")
    assert "seed" in complaint(said)


def test_checkpoint_missing(spoilt: TinyRun) -> None:
    (spoilt.folder / "checkpoints" / "best.ckpt").unlink()
    assert "best.ckpt" in complaint(evaluate(spoilt, "--checkpoint", "best"))


def test_weights_of_another_network(spoilt: TinyRun) -> None:
    config = spoilt.folder / "config.yaml"
    config.write_text(config.read_text().replace("plain-4-6-8", "plain-4-6-10"))
    assert "config.yaml" in complaint(evaluate(spoilt))


def test_config_that_is_none(spoilt: TinyRun) -> None:
    config = spoilt.folder / "config.yaml"
    config.write_text(config.read_text() + "stepz: 3\n")
    assert "stepz" in complaint(evaluate(spoilt))
    config.write_text("a: [1,\n")
    said = evaluate(spoilt)
    assert (said.status, "Traceback" in said.err) == (2, False)
    assert str(config) in said.err


def test_training_that_diverged(spoilt: TinyRun) -> None:
    last = spoilt.folder / "checkpoints" / "last.ckpt"
    state = torch.load(last, weights_only=True)
    for name, value in state["state_dict"].items():
        if name.startswith("model.") and value.is_floating_point():
            value.fill_(float("nan"))
    torch.save(state, last)
    assert "diverged" in complaint(evaluate(spoilt))


# Settings


def test_unknown_backbone(tiny_run: TinyRun, tmp_path: Path) -> None:
    said = train(tiny_run, tmp_path / "run", "--model.backbone", "efficientnet_b00")
    assert "efficientnet_b00" in complaint(said)
    assert "efficientnet_b0" in said.err


def test_hub_that_does_not_answer(
    tiny_run: TinyRun, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: list[str] = []

    def no_answer(url: str, **_: Any) -> None:
        asked.append(url)
        raise ConnectionError("no route to host")

    def never(*_: Any, **more: Any) -> Any:
        if more.get("pretrained"):
            raise AssertionError("the hub's own client would now try again for minutes")
        return create(*_, **more)

    create = image_encoder.timm.create_model
    monkeypatch.setenv("HF_HUB_CACHE", str(tmp_path))
    monkeypatch.setattr(image_encoder, "get_hf_file_metadata", no_answer)
    monkeypatch.setattr(image_encoder, "try_to_load_from_cache", lambda *_: None)
    monkeypatch.setattr(image_encoder.timm, "create_model", never)
    flags = ["--data.root", tiny_run.root, "--templates", tiny_run.templates]
    said = complaint(command("shoot-train", "paper", *flags, "--out", tmp_path / "run"))
    assert len(asked) == 1
    assert "timm/efficientnet_b0" in asked[0]
    assert "--model.pretrained none" in said


@pytest.mark.parametrize(
    "flags",
    [
        ["--optim.steps", 0],
        ["--val-every", 0],
        ["--optim.batch-size", -1],
        ["--model.depth.step-m", 0],
        ["--model.grid.cell-m", -1],
        ["--devices", 0],
        ["--optim.steps", "many"],
        ["--no-such-flag", 1],
    ],
)
def test_bad_settings(flags: list[object], tiny_run: TinyRun, tmp_path: Path) -> None:
    said = train(tiny_run, tmp_path / "run", *flags)
    assert said.status == 2
    assert "Traceback" not in said.err
    # Named as it was typed, or as the setting is called.
    name = str(flags[0]).strip("-").split(".")[-1]
    assert name in said.err or name.replace("-", "_") in said.err
    assert not (tmp_path / "run").exists()


@pytest.mark.parametrize(
    "flags",
    [["--image-scale", 7], ["--train-scenes", -1], ["--train-scenes", 0, "--val-scenes", 0]],
)
def test_bad_world(flags: list[object], tmp_path: Path) -> None:
    said = command("shoot-make-world", tmp_path / "world", *flags)
    assert str(flags[0]).strip("-").replace("-", "_") in complaint(said)


def test_world_over_other_data(tiny_run: TinyRun) -> None:
    assert str(tiny_run.root) in complaint(command("shoot-make-world", tiny_run.root))


# Disk


def test_output_that_cannot_be_written(tiny_run: TinyRun, tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    below = tmp_path / "file" / "below"
    for said in (
        train(tiny_run, below),
        fit(tiny_run.root, below / "t.npz"),
        command("shoot-evaluate", tiny_run.folder, "--out", below / "report.json"),
        command("shoot-render", tiny_run.folder, "--num", 1, "--out", below),
        command("shoot-make-world", below, "--train-scenes", 1, "--val-scenes", 0),
    ):
        assert str(tmp_path / "file") in complaint(said)


def test_standard_output_on_a_full_disk(capsys: pytest.CaptureFixture[str]) -> None:
    """The system's error names no file."""

    def say() -> None:
        with Path("/dev/full").open("w") as full:
            print("much", file=full, flush=True)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sys, "argv", ["shoot-something"])
        with pytest.raises(SystemExit) as ended:
            app.run(dict, lambda _: say(), "Says much.")
    assert ended.value.code == 2
    assert "No space left on device; make room" in complaint(Said(2, "", capsys.readouterr().err))


def test_console_script_ends_the_same_way(tmp_path: Path) -> None:
    program = Path(sys.executable).parent / "shoot-evaluate"
    ended = subprocess.run(
        [program, tmp_path], capture_output=True, text=True, check=False, timeout=300
    )
    said = Said(ended.returncode, ended.stdout, ended.stderr)
    assert str(tmp_path) in complaint(said)
