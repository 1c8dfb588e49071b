"""Planners that see lidar scans instead of images."""

import json
from pathlib import Path

import numpy as np
import pytest
import torch
from ring_sweeps import write_sweeps
from tiny_tables import VERSION, copy_tiny
from viewer_case import data_of, decoded
from world_fixture import SMALL_FLAGS, TinyRun, command

from lss_core.config import CAMERAS
from lss_core.data.samples import load_index
from shoot.prediction import fast
from shoot.prediction.fast import FastPlanner
from shoot.prediction.run import batches, open_run, predict
from shoot.training.planning.data import load_split


def test_a_lidar_planner_from_training_to_pictures(
    tiny_run: TinyRun, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    root = copy_tiny(tiny_run.root, tmp_path / "data")
    write_sweeps(load_index(root, VERSION, CAMERAS), root)
    run = tmp_path / "run"
    said = command(
        "shoot-train", "lidar10", "--data.root", root, "--templates", tiny_run.templates,
        "--out", run, "--optim.steps", 2, "--val-every", 2, *SMALL_FLAGS,
    )  # fmt: skip
    assert said.status == 0, said.err
    report = tmp_path / "report.json"
    assert command("shoot-evaluate", run, "--out", report).status == 0
    assert json.loads(report.read_text())["num_samples"] == 15
    said = command("shoot-render", run, "--num", 1, "--out", tmp_path / "pictures")
    assert said.status == 0, said.err
    page = tmp_path / "scene.html"
    assert command("shoot-view", run, "--out", page).status == 0
    data = data_of(page.read_text())
    assert (data["cameras"], data["samples"][2]["images"]) == ([], [])
    assert np.asarray(decoded(data["samples"][2]["points"])).any()

    trained = open_run(run)
    split = load_split(trained.config.data, "val", trained.templates)
    assert np.ptp(predict(trained, split), axis=0).max() > 0.0
    monkeypatch.setattr(fast, "fastest_precision", lambda _: "32-true")
    sensors = next(iter(batches(trained, split, np.arange(3)))).sensors
    with torch.no_grad():
        expected = trained.module(sensors)
    scores = FastPlanner(trained.module, compiled=False)(sensors)
    torch.testing.assert_close(scores, expected, rtol=1e-4, atol=1e-4)
