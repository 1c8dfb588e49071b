"""The norm of a gradient is the true one at every precision, and is what is clipped."""

import math
from dataclasses import replace
from pathlib import Path

import pytest
import pytorch_lightning as pl
import torch
from pytorch_lightning.plugins import MixedPrecision
from world_fixture import TinyRun

from shoot.training.bad_steps import clip_gradients
from shoot.training.data import TaskData
from shoot.training.loop import make_trainer
from shoot.training.metrics_file import read_metrics
from shoot.training.planning.run_folder import PlanningRun
from shoot.training.planning.task import PlanningModule

pytestmark = pytest.mark.trains

SCALE = 1024.0


def fused_adam(*weights: torch.Tensor) -> torch.optim.Optimizer:
    return torch.optim.Adam(weights, lr=0.1, fused=True)


def scaler_of(scale: float) -> torch.amp.GradScaler:
    scaler = torch.amp.GradScaler("cpu", init_scale=scale)
    scaler.scale(torch.zeros(()))  # its tensors are made on first use
    return scaler


@pytest.mark.parametrize("clip_norm", [1.0, 100.0])
@pytest.mark.parametrize("scale", [None, SCALE])
def test_what_is_clipped_is_not_scaled(clip_norm: float, scale: float | None) -> None:
    weights = torch.zeros(2, requires_grad=True), torch.zeros(1, requires_grad=True)
    optimizer = fused_adam(*weights)
    factor = scale or 1.0
    weights[0].grad = torch.tensor([3.0, 4.0]) * factor
    weights[1].grad = torch.tensor([-12.0]) * factor
    scaler = scaler_of(scale) if scale else None
    assert clip_gradients(optimizer, clip_norm, scaler).item() == pytest.approx(13.0)
    shrunk = min(1.0, clip_norm / 13.0)
    torch.testing.assert_close(weights[0].grad, torch.tensor([3.0, 4.0]) * shrunk)
    torch.testing.assert_close(weights[1].grad, torch.tensor([-12.0]) * shrunk)


def test_a_scaled_step_is_the_plain_step() -> None:
    plain, scaled = (torch.zeros(3, requires_grad=True) for _ in range(2))
    scaler = scaler_of(SCALE)
    of_plain, of_scaled = fused_adam(plain), fused_adam(scaled)
    for gradient in ([1e-9, 2e-9, -3e-9], [5.0, -7.0, 0.5]):  # Adam's epsilon counts in the first
        plain.grad = torch.tensor(gradient)
        scaled.grad = torch.tensor(gradient) * SCALE
        clip_gradients(of_plain, 1.0)
        clip_gradients(of_scaled, 1.0, scaler)
        of_plain.step()
        scaler.step(of_scaled)
        scaler.update()
        torch.testing.assert_close(plain, scaled)
    assert plain.abs().min() > 0.0


def test_an_overflow_in_float16_moves_nothing_and_lowers_the_scale() -> None:
    weight = torch.ones(2, requires_grad=True)
    optimizer, scaler = fused_adam(weight), scaler_of(SCALE)
    weight.grad = torch.tensor([1.0, torch.inf])
    assert not clip_gradients(optimizer, 1.0, scaler).isfinite()
    optimizer.zero_grad(set_to_none=True)
    scaler.step(optimizer)
    scaler.update()
    assert weight.tolist() == [1.0, 1.0]
    assert scaler.get_scale() == SCALE / 2


@pytest.mark.parametrize("value", [torch.nan, torch.inf, 1e25])
def test_a_norm_says_whether_gradients_can_be_used(value: float) -> None:
    # The last one is finite, its square is not.
    weight = torch.zeros(3, requires_grad=True)
    weight.grad = torch.tensor([1.0, value, 1.0])
    assert not clip_gradients(fused_adam(weight), 1.0).isfinite()


def trained(
    tiny_run: TinyRun, folder: Path, precision: MixedPrecision | None, steps: int
) -> list[float]:
    """The gradient's norm at each step of a run."""
    run = PlanningRun(tiny_run.folder)
    config, templates = run.config(), run.templates()
    config = replace(config, val_every=1, optim=replace(config.optim, steps=steps))
    pl.seed_everything(0, verbose=False)
    module = PlanningModule(config, templates)
    trainer = make_trainer(config, PlanningRun(folder), module.task)
    if precision is not None:
        # By its name Lightning takes float16 on GPUs only.
        trainer.strategy.precision_plugin = precision
    trainer.fit(module, datamodule=TaskData(config, module.task))
    rows = read_metrics(folder / "metrics.csv")
    return [float(rows[step]["grad_norm"]) for step in range(steps)]


def test_all_precisions_log_the_same_norm(tiny_run: TinyRun, tmp_path: Path) -> None:
    (expected,) = trained(tiny_run, tmp_path / "float32", None, 1)
    scaler = torch.amp.GradScaler("cpu", init_scale=SCALE)
    for precision in (
        MixedPrecision("bf16-mixed", "cpu"),
        MixedPrecision("16-mixed", "cpu", scaler),
    ):
        (norm,) = trained(tiny_run, tmp_path / precision.precision, precision, 1)
        assert norm == pytest.approx(expected, rel=0.05), precision.precision


def test_float16_finds_its_scale(tiny_run: TinyRun, tmp_path: Path) -> None:
    (expected,) = trained(tiny_run, tmp_path / "float32", None, 1)
    # Times 65536, as torch begins, these gradients are beyond float16: a step changes nothing.
    (first,) = trained(tiny_run, tmp_path / "one", MixedPrecision("16-mixed", "cpu"), 1)
    assert math.isinf(first)
    for name, value in PlanningRun(tmp_path / "one").weights("last")["state_dict"].items():
        if name.endswith(("running_mean", "num_batches_tracked")):
            assert not value.any(), name
    precision = MixedPrecision("16-mixed", "cpu")
    *_, last = trained(tiny_run, tmp_path / "six", precision, 6)
    assert last == pytest.approx(expected, rel=0.8)
    assert precision.scaler is not None
    assert precision.scaler.get_scale() < 65536.0
