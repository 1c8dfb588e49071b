import json
import subprocess
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from lss_core.errors import DataError
from shoot.templates import TemplateSet
from shoot.training.planning.config import DEMO, TrainConfig
from shoot.training.planning.run_folder import PlanningRun
from shoot.training.planning.task import Planning


def templates(shift_m: float = 0.0) -> TemplateSet:
    points = np.full((3, 20, 2), shift_m, dtype=np.float32)
    return TemplateSet(points, 0.25, np.zeros(3, dtype=np.int64))


def planning(shift_m: float = 0.0) -> Planning:
    return Planning(DEMO, templates(shift_m))


@pytest.fixture
def run(tmp_path: Path) -> PlanningRun:
    return PlanningRun(tmp_path / "runs" / "one")


@pytest.fixture
def config(run: PlanningRun) -> TrainConfig:
    return replace(DEMO, out=str(run.folder), data=replace(DEMO.data, root="/data/nuscenes"))


def begin_and_save(run: PlanningRun, config: TrainConfig) -> None:
    """A run that came to its first checkpoint."""
    assert run.begin(config, planning()) is None
    torch.save({"state_dict": {}, "templates_sha256": "0"}, run.checkpoints / "last.ckpt")


def test_new_run_says_what_it_is(run: PlanningRun, config: TrainConfig) -> None:
    assert run.begin(config, planning(2.0)) is None
    assert run.config() == config
    assert run.templates().sha256 == templates(2.0).sha256
    environment = json.loads((run.folder / "environment.json").read_text())
    assert torch.__version__.startswith(environment["libraries"]["torch"])
    assert run.checkpoints.is_dir()


def test_second_run_in_the_same_folder_is_refused(run: PlanningRun, config: TrainConfig) -> None:
    begin_and_save(run, config)
    with pytest.raises(DataError, match="holds a run already; go on with --resume"):
        run.begin(config, planning())


def test_run_without_a_checkpoint_may_begin_again(run: PlanningRun, config: TrainConfig) -> None:
    run.begin(config, planning())
    other = replace(config, seed=7)
    assert run.begin(other, planning()) is None
    assert run.config() == other


def test_resuming_gives_the_last_checkpoint(run: PlanningRun, config: TrainConfig) -> None:
    begin_and_save(run, config)
    resumed = run.begin(replace(config, resume=True), planning())
    assert resumed == run.checkpoints / "last.ckpt"


def test_resuming_nothing_begins(run: PlanningRun, config: TrainConfig) -> None:
    assert run.begin(replace(config, resume=True), planning()) is None
    assert run.config_file.is_file()


def test_what_is_run_where_may_change(run: PlanningRun, config: TrainConfig) -> None:
    begin_and_save(run, config)
    moved = replace(
        config,
        resume=True,
        num_workers=7,
        accelerator="cpu",
        devices=2,
        templates="elsewhere.npz",
        data=replace(config.data, root="elsewhere"),
    )
    assert run.begin(moved, planning()) is not None


@pytest.mark.parametrize(
    ("change", "named"),
    [
        ({"seed": 5}, "seed"),
        ({"optim": replace(DEMO.optim, learning_rate=0.5)}, "optim"),
        ({"model": replace(DEMO.model, context_channels=3), "val_every": 9}, "model, val_every"),
        ({"data": replace(DEMO.data, version="v1.0-mini")}, "data"),
    ],
)
def test_resuming_with_other_settings_names_them(
    run: PlanningRun, config: TrainConfig, change: dict[str, Any], named: str
) -> None:
    begin_and_save(run, config)
    with pytest.raises(DataError, match=f"with other settings of {named}; resume"):
        run.begin(replace(config, resume=True, **change), planning())
    assert run.config() == config


def test_resuming_with_other_templates_is_refused(run: PlanningRun, config: TrainConfig) -> None:
    begin_and_save(run, config)
    with pytest.raises(DataError, match="trained with other templates"):
        run.begin(replace(config, resume=True), planning(1.0))
    assert run.templates().sha256 == templates().sha256


def test_folder_that_cannot_be_made(tmp_path: Path, config: TrainConfig) -> None:
    (tmp_path / "file").write_text("in the way")
    with pytest.raises(OSError, match="file"):
        PlanningRun(tmp_path / "file" / "run").begin(config, planning())


def test_no_git_is_no_hindrance(
    run: PlanningRun, config: TrainConfig, monkeypatch: pytest.MonkeyPatch
) -> None:
    def no_git(*_: Any, **__: Any) -> None:
        raise FileNotFoundError("git")

    monkeypatch.setattr(subprocess, "run", no_git)
    run.begin(config, planning())
    assert json.loads((run.folder / "environment.json").read_text())["git"] is None


def test_no_run_folder(run: PlanningRun) -> None:
    with pytest.raises(DataError, match="is no run folder"):
        run.config()
    with pytest.raises(DataError, match="no template file"):
        run.templates()
