"""Steps with numbers that are none change nothing, and too many of them end the run."""

import json
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
import torch
from torch import Tensor
from world_fixture import TinyRun, command, train_flags

from shoot.training.metrics_file import read_metrics
from shoot.training.module import TaskModule

STEPS, EVERY = 6, 3


@contextmanager
def broken(bad_steps: set[int], value: float = float("nan")) -> Iterator[list[dict[str, Tensor]]]:
    """Make the images of some steps useless; yields the weights before each step."""
    before: list[dict[str, Tensor]] = []
    real = TaskModule.training_step

    def training_step(self: TaskModule, batch: Any, batch_idx: int) -> Tensor:
        step = self.trainer.global_step
        before.append({name: t.detach().clone() for name, t in self.state_dict().items()})
        loss = real(self, batch, batch_idx)
        return loss * value if step in bad_steps else loss

    def on_after_backward(self: TaskModule) -> None:
        if self.trainer.global_step in bad_steps:
            for name, buffer in self.named_buffers():
                if "running" in name:
                    buffer.fill_(value)  # as a forward pass of such images leaves them

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(TaskModule, "on_after_backward", on_after_backward)
        patch.setattr(TaskModule, "training_step", training_step)
        yield before


def train(tiny_run: TinyRun, out: Path, *more: object) -> Any:
    flags = train_flags(tiny_run.root, tiny_run.templates, out, STEPS, EVERY)
    return command("shoot-train", *flags, *more)


# With the last one gradients are finite, their norm is not.
@pytest.mark.parametrize("value", [float("nan"), float("inf"), 1e25])
def test_a_bad_step_changes_nothing(value: float, tiny_run: TinyRun, tmp_path: Path) -> None:
    with broken({2}, value) as before:
        said = train(tiny_run, tmp_path / "run")
    assert said.status == 0, said.err
    assert len(before) == STEPS
    for name, weights in before[2].items():
        if not name.startswith("planner"):
            assert torch.equal(before[3][name], weights), name
    moved = [name for name in before[1] if not torch.equal(before[1][name], before[2][name])]
    assert any("weight" in name for name in moved)
    assert "Step 2 left out" in said.err + said.out
    assert "1 steps were left out" in said.err + said.out
    checkpoint = torch.load(tmp_path / "run" / "checkpoints" / "last.ckpt", weights_only=True)
    assert checkpoint["global_step"] == STEPS
    assert all(t.isfinite().all() for t in checkpoint["state_dict"].values())
    values = [
        row.get("val_nll", "") for row in read_metrics(tmp_path / "run" / "metrics.csv").values()
    ]
    assert sum(value not in ("", "nan") for value in values) == 2


def test_too_many_in_a_row_end_the_run(tiny_run: TinyRun, tmp_path: Path) -> None:
    with broken({3, 4, 5}):
        said = train(tiny_run, tmp_path / "run", "--optim.max-bad-steps", "2")
    assert said.status == 2
    assert "Traceback" not in said.err
    sentence = " ".join(said.err.split("error:")[-1].split())
    assert sentence.startswith("2 steps in a row had no finite gradient")
    # The samples of the batch and the checkpoint to go on from are named.
    assert sentence.count("scene-00") == 2
    assert "last.ckpt" in sentence
    checkpoint = torch.load(tmp_path / "run" / "checkpoints" / "last.ckpt", weights_only=True)
    assert checkpoint["global_step"] == EVERY
    resumed = train(tiny_run, tmp_path / "run", "--optim.max-bad-steps", "2", "--resume")
    assert resumed.status == 0, resumed.err
    assert json.loads((tmp_path / "run" / "training_time.json").read_text())["train_s"] > 0.0


def test_good_steps_between_bad_ones_start_the_count_anew(
    tiny_run: TinyRun, tmp_path: Path
) -> None:
    with broken({1, 3, 5}):
        said = train(tiny_run, tmp_path / "run", "--optim.max-bad-steps", "2")
    assert said.status == 0, said.err
    assert "3 steps were left out" in said.err + said.out
