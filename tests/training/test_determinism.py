"""`--deterministic` asks PyTorch for it; on CPUs it trains the bits that are trained anyway."""

import os
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from resumption import assert_same_run
from world_fixture import TinyRun, command, train_flags

from shoot.templates import TemplateSet
from shoot.training.loop import make_trainer
from shoot.training.planning.config import DEMO
from shoot.training.planning.run_folder import PlanningRun
from shoot.training.planning.task import Planning

TEMPLATES = TemplateSet(np.zeros((1, 20, 2), np.float32), 0.25, np.ones(1, np.int64))


@pytest.fixture(autouse=True)
def _as_before(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    monkeypatch.setenv("CUBLAS_WORKSPACE_CONFIG", "")  # so that it is put back
    yield
    torch.use_deterministic_algorithms(False)


@pytest.mark.parametrize("deterministic", [True, False])
def test_the_trainer_asks_for_it(deterministic: bool, tmp_path: Path) -> None:
    torch.use_deterministic_algorithms(not deterministic)
    torch.backends.cudnn.benchmark = True
    config = replace(DEMO, precision="32-true", deterministic=deterministic)
    make_trainer(config, PlanningRun(tmp_path), Planning(config, TEMPLATES))
    assert torch.are_deterministic_algorithms_enabled() == deterministic
    assert not torch.backends.cudnn.benchmark  # on a CPU
    assert bool(os.environ["CUBLAS_WORKSPACE_CONFIG"]) == deterministic


def test_on_a_cpu_nothing_changes(tiny_run: TinyRun, tmp_path: Path) -> None:
    for name, more in (("plain", ()), ("first", ("--deterministic",))):
        flags = train_flags(tiny_run.root, tiny_run.templates, tmp_path / name, 4, 2)
        said = command("shoot-train", *flags, *more)
        assert said.status == 0, said.err
        assert torch.are_deterministic_algorithms_enabled() == bool(more)
    assert_same_run(tmp_path / "first", tmp_path / "plain")
    assert PlanningRun(tmp_path / "first").config().deterministic
