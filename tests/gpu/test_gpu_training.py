"""On a GPU every precision trains, runs repeat to the bit if asked to, and a step waits once."""

import json
import math
import statistics
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
import torch
from torch import Tensor
from world_fixture import TinyRun, command, train_flags

from shoot.training.bad_steps import SkipBadSteps
from shoot.training.data import TaskData
from shoot.training.metrics_file import read_metrics
from shoot.training.module import TaskModule
from shoot.training.planning.run_folder import PlanningRun
from shoot.training.planning.task import Planning

PRECISIONS = ("32-true", "bf16-mixed", "16-mixed")


@pytest.fixture(autouse=True)
def _as_before() -> Iterator[None]:
    yield
    torch.use_deterministic_algorithms(False)
    torch.backends.cudnn.benchmark = False


def train(
    tiny_run: TinyRun, out: Path, steps: int, every: int, precision: str, *more: object
) -> None:
    flags = train_flags(tiny_run.root, tiny_run.templates, out, steps, every)
    flags[flags.index("32-true")] = precision
    said = command("shoot-train", *flags, "--accelerator", "gpu", *more)
    assert said.status == 0, said.err


def logged(folder: Path, name: str) -> list[float]:
    rows = read_metrics(folder / "metrics.csv").values()
    return [float(row[name]) for row in rows if row.get(name)]


@pytest.fixture(scope="module")
def runs(tiny_run: TinyRun, tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """A run of 60 steps at each precision."""
    folders = {}
    for precision in PRECISIONS:
        folders[precision] = tmp_path_factory.mktemp("gpu") / precision
        train(tiny_run, folders[precision], 60, 5, precision)
    return folders


@pytest.mark.parametrize("precision", PRECISIONS)
def test_the_loss_falls(precision: str, runs: dict[str, Path]) -> None:
    losses = logged(runs[precision], "train_loss")
    assert statistics.mean(losses[-4:]) < statistics.mean(losses[:4])


@pytest.mark.parametrize("precision", PRECISIONS[1:])
def test_norms_are_those_of_float32(precision: str, runs: dict[str, Path]) -> None:
    # Float16 looks for its scale by steps whose norm is infinite.
    norms = [norm for norm in logged(runs[precision], "grad_norm") if math.isfinite(norm)]
    assert len(norms) >= 6
    expected = statistics.median(logged(runs["32-true"], "grad_norm"))
    assert expected / 3 < statistics.median(norms) < expected * 3


def test_what_was_trained_on_a_gpu_is_evaluated(runs: dict[str, Path], tmp_path: Path) -> None:
    said = command("shoot-evaluate", runs["16-mixed"], "--out", tmp_path / "report.json")
    assert said.status == 0, said.err
    report = json.loads((tmp_path / "report.json").read_text())
    assert 0.0 < report["methods"]["model"]["nll"]["value"] < 10.0


@contextmanager
def ending_at(step: int) -> Iterator[None]:
    """Training steps that stop working at one."""
    real = TaskModule.training_step

    def training_step(self: TaskModule, batch: Any, batch_idx: int) -> Tensor:
        if self.trainer.global_step == step:
            raise ArithmeticError("the power fails")
        return real(self, batch, batch_idx)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(TaskModule, "training_step", training_step)
        yield


@pytest.mark.parametrize("precision", PRECISIONS)
def test_a_deterministic_run_repeats_and_resumes_to_the_bit(
    precision: str, tiny_run: TinyRun, tmp_path: Path
) -> None:
    flags = (9, 3, precision, "--deterministic")
    for name in ("first", "second"):
        train(tiny_run, tmp_path / name, *flags)
    with ending_at(5), pytest.raises(ArithmeticError):
        train(tiny_run, tmp_path / "resumed", *flags)
    train(tiny_run, tmp_path / "resumed", *flags, "--resume")
    first = PlanningRun(tmp_path / "first").weights("last")["state_dict"]
    for name in ("second", "resumed"):
        again = PlanningRun(tmp_path / name).weights("last")["state_dict"]
        assert first.keys() == again.keys()
        for key, value in first.items():
            assert torch.equal(value, again[key]), (name, key)
        for column in ("train_loss", "grad_norm", "val_nll"):
            assert logged(tmp_path / name, column) == logged(tmp_path / "first", column)


def test_a_step_waits_for_the_device_once(
    tiny_run: TinyRun, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    keep, look = SkipBadSteps.on_train_batch_start, SkipBadSteps.on_before_optimizer_step
    waits: list[int] = []

    def watched(*arguments: Any) -> None:
        torch.cuda.set_sync_debug_mode("error")
        try:
            keep(*arguments)
        finally:
            torch.cuda.set_sync_debug_mode("default")

    def counted(*arguments: Any) -> None:
        with warnings.catch_warnings(record=True) as said:
            warnings.simplefilter("always")
            torch.cuda.set_sync_debug_mode("warn")
            try:
                look(*arguments)
            finally:
                torch.cuda.set_sync_debug_mode("default")
        waits.append(sum("called a synchronizing" in str(one.message) for one in said))

    monkeypatch.setattr(SkipBadSteps, "on_train_batch_start", watched)
    monkeypatch.setattr(SkipBadSteps, "on_before_optimizer_step", counted)
    train(tiny_run, tmp_path / "run", 4, 4, "32-true")
    assert waits == [1, 1, 1, 1]


def test_a_batch_is_copied_while_the_host_goes_on(tiny_run: TinyRun) -> None:
    run = PlanningRun(tiny_run.folder)
    data = TaskData(run.config(), Planning(run.config(), run.templates()))
    batch = next(iter(data.train_dataloader())).pin_memory()
    torch.zeros(1, device="cuda")  # sets the device up
    torch.cuda.set_sync_debug_mode("error")
    try:
        moved = data.transfer_batch_to_device(batch, torch.device("cuda"), 0)
    finally:
        torch.cuda.set_sync_debug_mode("default")
    assert torch.equal(moved.sensors.images.cpu(), batch.sensors.images)
    assert torch.equal(moved.template_idx.cpu(), batch.template_idx)
