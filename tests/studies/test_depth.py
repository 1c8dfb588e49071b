"""Depth told by the lidar: where points fall, what becomes of the distribution, and the study."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from world_fixture import TinyRun

from lss_core.errors import DataError
from shoot.metrics.ranks import negative_log_likelihood
from shoot.prediction.run import open_run, predict
from shoot.studies.depth import (
    DEPTHS,
    format_depth_study,
    study_depth,
    tell_depth,
)
from shoot.training.planning.data import load_split
from shoot.training.planning.task import PlanningModule

DEPTHS_M = (4.0, 6.0, 8.0, 10.0)


def test_known_depths_take_all_the_mass():
    own = torch.full((1, 4, 1, 5), 0.25)
    true_m = torch.tensor([[[4.9, 7.1, 10.9, 11.1, float("nan")]]])
    told = tell_depth(own, true_m, DEPTHS_M)
    assert told[0, :, 0, 0].tolist() == [1.0, 0.0, 0.0, 0.0]
    assert told[0, :, 0, 1].tolist() == [0.0, 0.0, 1.0, 0.0]
    assert told[0, :, 0, 2].tolist() == [0.0, 0.0, 0.0, 1.0]
    for unknown in (3, 4):
        assert told[0, :, 0, unknown].tolist() == [0.25] * 4


def test_the_study_of_a_run(tiny_run: TinyRun, tmp_path: Path):
    run = open_run(tiny_run.folder)
    split = load_split(run.config.data, "val", run.templates)
    study = study_depth(run, split, num_samples=6)
    assert (study.num_samples, study.num_scenes) == (6, 3)
    assert set(study.nll) == set(DEPTHS)
    for name, change in study.nll_change.items():
        assert change.value == pytest.approx(study.nll[name].value - study.nll["own"].value)
    # Its own depths give what it says anyway.
    own = negative_log_likelihood(predict(run, split), split.labels)
    asked = np.linspace(0, len(own) - 1, 6).round().astype(int)
    assert study.nll["own"].value == pytest.approx(own[asked].mean(), abs=1e-4)
    study.save(tmp_path / "study.json")
    assert json.loads((tmp_path / "study.json").read_text())["num_samples"] == 6
    text = format_depth_study(study)
    assert all(name in text for name in (*DEPTHS, "4-10 m"))


def test_planners_that_learn_no_depth_are_refused(tiny_run: TinyRun):
    run = open_run(tiny_run.folder)
    split = load_split(run.config.data, "val", run.templates)
    uniform = replace(run.config, model=replace(run.config.model, lift="uniform"))
    module = PlanningModule(uniform, run.templates)
    with pytest.raises(DataError, match="that learn it"):
        study_depth(replace(run, module=module), split)


def test_lidar_planners_are_refused(tiny_run: TinyRun, monkeypatch: pytest.MonkeyPatch):
    run = open_run(tiny_run.folder)
    split = load_split(run.config.data, "val", run.templates)
    monkeypatch.setattr(run.module, "model", torch.nn.Identity())
    with pytest.raises(DataError, match="camera planners"):
        study_depth(run, split)
