"""A CUDA GPU is taken where there is one, Apple's never."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from pytorch_lightning.accelerators import CPUAccelerator, MPSAccelerator
from world_fixture import TinyRun, command, train_flags

from lss_core.errors import DataError
from shoot.templates import TemplateSet
from shoot.training.device import Accelerator, choose_device
from shoot.training.loop import make_trainer
from shoot.training.planning.config import DEMO
from shoot.training.planning.run_folder import PlanningRun
from shoot.training.planning.task import Planning

TEMPLATES = TemplateSet(np.zeros((1, 20, 2), np.float32), 0.25, np.ones(1, np.int64))


def machine(monkeypatch: pytest.MonkeyPatch, has_cuda: bool) -> None:
    """One with Apple's GPU, or so Lightning is told."""
    monkeypatch.setattr(torch.cuda, "is_available", lambda: has_cuda)
    monkeypatch.setattr(MPSAccelerator, "is_available", staticmethod(lambda: True))


@pytest.mark.parametrize(
    ("accelerator", "has_cuda", "expected"),
    [
        ("auto", False, "cpu"),
        ("auto", True, "cuda"),
        ("cpu", True, "cpu"),
        ("gpu", True, "cuda"),
        ("cuda", True, "cuda"),
    ],
)
def test_the_device(
    accelerator: Accelerator, has_cuda: bool, expected: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    machine(monkeypatch, has_cuda)
    assert choose_device(accelerator) == torch.device(expected)


def test_training_leaves_apples_gpu_alone(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    machine(monkeypatch, has_cuda=False)
    config = replace(DEMO, accelerator="auto", precision="32-true")
    trainer = make_trainer(config, PlanningRun(tmp_path), Planning(config, TEMPLATES))
    assert isinstance(trainer.accelerator, CPUAccelerator)


@pytest.mark.parametrize("accelerator", ["gpu", "cuda"])
def test_a_gpu_that_is_not_there(accelerator: Accelerator, monkeypatch: pytest.MonkeyPatch) -> None:
    machine(monkeypatch, has_cuda=False)
    with pytest.raises(DataError, match="no CUDA GPU here; use --accelerator cpu"):
        choose_device(accelerator)


def test_what_is_no_accelerator_is_refused(tiny_run: TinyRun, tmp_path: Path) -> None:
    flags = train_flags(tiny_run.root, tiny_run.templates, tmp_path / "run", 2, 1)
    said = command("shoot-train", *flags, "--accelerator", "mps")
    assert said.status == 2
    assert "Traceback" not in said.err
    assert "cuda" in said.err + said.out
    assert not (tmp_path / "run").exists()
