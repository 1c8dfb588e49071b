"""Settings that cannot be end a command in one sentence, before it has begun."""

import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from world_fixture import Said, TinyRun, command, complaint, train_flags

from lss_core.errors import DataError
from lss_core.grid import BevGrid
from shoot.cli import app
from shoot.templates import TemplateSet
from shoot.training.planning.task import check_grid

TRAIN: list[list[Any]] = [
    ["--optim.learning-rate", "nan"],
    ["--optim.weight-decay", -1],
    ["--optim.clip-norm", 0],
    ["--optim.clip-norm", -1],
    ["--optim.warmup-steps", -1],
    ["--optim.depth-weight", -1],
    ["--data.drop-cameras", -1],
    ["--data.drop-cameras", 6],
    ["--data.cameras", "CAM_FRONT", "CAM_FRONT"],
    ["--data.cameras"],
    ["--data.extrinsic-noise-m", -1],
    ["--data.image.height-px", 33],
    ["--data.image.resize", 0, 0],
    ["--data.image.resize", 1.2, 0.9],
    ["--data.image.crop-bottom", 22, 22],
    ["--data.image.rotate-rad", "nan"],
    ["--model.z-min-m", 5, "--model.z-max-m", -5],
    ["--model.decoder-channels", 1],
    ["--model.head-init-std", -1],
    ["--model.depth.step-m", 100],
    ["--model.grid.x-max-m", "inf"],
    ["--val-split", "train"],
    ["--val-samples", -1],
    ["--num-workers", -1],
    ["--num-nodes", 0],
    ["--seed", -1],
    ["--seed", 2**64],
]


def named(flag: str) -> str:
    return flag.split(".")[-1].strip("-").replace("-", "_")


@pytest.mark.parametrize("flags", TRAIN)
def test_training_is_not_begun(flags: list[Any], tiny_run: TinyRun, tmp_path: Path) -> None:
    steps = train_flags(tiny_run.root, tiny_run.templates, tmp_path / "run", 4, 2)
    assert named(flags[0]) in complaint(command("shoot-train", *steps, *flags))
    assert not (tmp_path / "run").exists()


@pytest.mark.parametrize("stride", [0, 7, 4, 32])
def test_a_stride_that_is_none(stride: int, tiny_run: TinyRun, tmp_path: Path) -> None:
    steps = train_flags(tiny_run.root, tiny_run.templates, tmp_path / "run", 4, 2)
    said = command("shoot-train", *steps, "--model.image-stride", stride)
    assert (said.status, "Traceback" in said.err) == (2, False)
    assert "--model.image-stride" in said.err


@pytest.mark.parametrize(
    ("name", "flags"),
    [
        ("shoot-fit-templates", ["--out", "t.npz", "--data.root", "x", "--seed", -1]),
        ("shoot-fit-templates", ["--out", "t.npz", "--data.root", "x", "--k", 0]),
        ("shoot-fit-templates", ["--data.root", "x", "--out", "t.npz", "--dask", ""]),
        ("shoot-fit-templates", ["--out", "t.npz", "--data.root", ""]),
        ("shoot-render", ["run", "--out", "pictures", "--num", 0]),
        ("shoot-render", ["run", "--out", "pictures", "--token", ""]),
        ("shoot-evaluate", ["run", "--split", ""]),
        ("shoot-evaluate", ["run", "--data.root", ""]),
        ("shoot-make-world", ["world", "--duration-s", "nan"]),
        ("shoot-make-world", ["world", "--workers", 0]),
        ("shoot-simulate", ["run", "--routes", 0]),
        ("shoot-view", ["run", "--out", "scene.html", "--scene", ""]),
        ("shoot-export", ["run", "--onnx", "planner.onnx", "--int8", 0]),
    ],
)
def test_other_commands_do_not_begin(name: str, flags: list[Any]) -> None:
    assert named(flags[-2]) in complaint(command(name, *flags))


def test_help_and_misspelt_flags_are_said_once() -> None:
    said = command("shoot-fit-templates", "--help")
    assert (said.status, said.err) == (0, "")
    assert said.out.count("--coverage-split") == 1
    said = command("shoot-fit-templates", "--data.root", "x", "--out", "y.npz", "--k", "many")
    assert said.status == 2
    assert said.err.count("many") == 1


# Where templates and grid meet

FAR = ["--model.grid.x-min-m", 1000, "--model.grid.x-max-m", 1080]


def test_a_grid_without_a_waypoint(tiny_run: TinyRun, tmp_path: Path) -> None:
    steps = train_flags(tiny_run.root, tiny_run.templates, tmp_path / "run", 4, 2)
    assert "No waypoint of the templates" in complaint(command("shoot-train", *steps, *FAR))
    assert not (tmp_path / "run").exists()


def test_a_grid_with_few_waypoints_is_said(caplog: pytest.LogCaptureFixture) -> None:
    ahead_m = np.arange(1.0, 21.0, dtype=np.float32)
    points = np.stack([ahead_m, np.zeros_like(ahead_m)], axis=-1)[None]
    templates = TemplateSet(points, 0.25, np.ones(1, dtype=np.int64))
    # Points at 1 m ... 20 m; the upper border is out.
    for x_max_m, said in ((6.0, "25 %"), (10.0, "45 %"), (11.0, None), (40.0, None)):
        caplog.clear()
        check_grid(templates, BevGrid(0.0, x_max_m, -2.0, 2.0, 1.0))
        assert [said in text for text in caplog.messages] == ([True] if said else [])
    with pytest.raises(DataError, match=r"x = 1\.0 to 20\.0 m"):
        check_grid(templates, BevGrid(-8.0, 1.0, -2.0, 2.0, 1.0))


def test_a_batch_that_batch_norm_cannot_do(tiny_run: TinyRun, tmp_path: Path) -> None:
    steps = train_flags(tiny_run.root, tiny_run.templates, tmp_path / "run", 2, 1)
    one_cell = ["--model.grid.x-min-m", 0, "--model.grid.x-max-m", 16]
    one_cell += ["--model.grid.y-min-m", -8, "--model.grid.y-max-m", 8, "--model.grid.cell-m", 16]
    said = command("shoot-train", *steps, *one_cell, "--optim.batch-size", 1)
    assert "batch norm" in complaint(said)


def test_too_little_memory_is_said(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sys, "argv", ["shoot-something"])
    for much in (lambda _: torch.empty(2**58), lambda _: np.empty(2**58)):
        with pytest.raises(SystemExit) as ended:
            app.run(dict, much, "Wants much.")
        assert ended.value.code == 2
        assert "memory is too small" in complaint(Said(2, "", capsys.readouterr().err))
