"""Two processes compute what one computes."""

import csv
import json
import os
import shutil
import socket
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import pytorch_lightning as pl
import torch
from torch import nn
from world_fixture import TinyRun, command, start_beside, train_flags

from shoot.datamodule import PlanningData
from shoot.run_folder import RunFolder
from shoot.training import PlanningModule, make_trainer

PATIENCE_S = 400


def freeze_statistics(module: nn.Module) -> None:
    """Normalise by stored statistics, so that a sample does not see the others of its batch."""
    for part in module.modules():
        if isinstance(part, nn.BatchNorm2d):
            part.eval()


def validate(run_folder: Path, out: Path) -> None:
    """Write the metrics of a run's last checkpoint on its validation split."""
    torch.set_num_threads(1)
    run = RunFolder(run_folder)
    config, templates = run.config(), run.templates()
    module = PlanningModule(config, templates)
    module.load_state_dict(run.checkpoint("last")["state_dict"])
    trainer = make_trainer(config, RunFolder(out))
    (result,) = trainer.validate(module, datamodule=PlanningData(config, templates), verbose=False)
    if trainer.is_global_zero:
        (out / "metrics.json").write_text(json.dumps(result))


def step_once(run_folder: Path, out: Path) -> None:
    """Write loss, gradient norm and weights of one step with frozen statistics."""
    torch.set_num_threads(1)
    run = RunFolder(run_folder)
    config, templates = run.config(), run.templates()
    optim = replace(config.optim, steps=1, batch_size=4)
    config = replace(config, optim=optim, val_every=1, val_samples=3)
    pl.seed_everything(3, verbose=False)
    module = PlanningModule(config, templates)
    freeze_statistics(module)
    trainer = make_trainer(config, RunFolder(out))
    trainer.fit(module, datamodule=PlanningData(config, templates))
    if trainer.is_global_zero:
        torch.save(module.state_dict(), out / "weights.pt")


def run_in(processes: int, function: Any, run_folder: Path, out: Path) -> None:
    """Run a function in one process, or in several as torchrun would."""
    out.mkdir()
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    started = []
    for rank in range(processes):
        environment = {
            "RANK": rank,
            "LOCAL_RANK": rank,
            "GROUP_RANK": 0,
            "WORLD_SIZE": processes,
            "LOCAL_WORLD_SIZE": processes,
            "MASTER_ADDR": "127.0.0.1",
            "MASTER_PORT": port,
            "TORCHELASTIC_RUN_ID": "test",
        }
        started.append(
            start_beside(
                function,
                run_folder,
                out,
                log=out / f"log{rank}",
                environment={name: str(value) for name, value in environment.items()}
                if processes > 1
                else {},
            )
        )
    for rank, process in enumerate(started):
        process.join(timeout=PATIENCE_S)
        hangs = process.is_alive()
        process.kill()
        assert not hangs, "hangs: " + (out / f"log{rank}").read_text()
        assert process.exitcode == 0, (out / f"log{rank}").read_text()


def test_validation_metrics_do_not_depend_on_processes(tiny_run: TinyRun, tmp_path: Path) -> None:
    # 15 samples: the shares of two processes differ by one, and so do their last batches.
    results = []
    for processes in (1, 2):
        out = tmp_path / str(processes)
        run_in(processes, validate, tiny_run.folder, out)
        results.append(json.loads((out / "metrics.json").read_text()))
    assert results[0].keys() == results[1].keys() >= {"val_nll", "val_top10"}
    for name, value in results[0].items():
        assert results[1][name] == pytest.approx(value, rel=1e-5), name
    assert results[0]["val_top10"] * 15 / 100 == pytest.approx(
        round(results[0]["val_top10"] * 15 / 100), abs=1e-4
    )


def test_a_step_does_not_depend_on_processes(tiny_run: TinyRun, tmp_path: Path) -> None:
    # With batch statistics it does a little: each process normalises by its own share.
    rows, weights = [], []
    for processes in (1, 2):
        out = tmp_path / str(processes)
        run_in(processes, step_once, tiny_run.folder, out)
        with (out / "metrics.csv").open() as stream:
            rows.append(next(csv.DictReader(stream)))
        weights.append(torch.load(out / "weights.pt", weights_only=True))
    for name in ("train_loss", "grad_norm"):
        assert float(rows[1][name]) == pytest.approx(float(rows[0][name]), rel=1e-4), name
    # Adam's first step is the sign of the gradient, so only tiny gradients may come out otherwise.
    same = [
        torch.isclose(weights[1][key], value, rtol=1e-4, atol=1e-6).flatten()
        for key, value in weights[0].items()
        if value.is_floating_point()
    ]
    assert torch.cat(same).float().mean() > 0.99


def train_in_two(flags: Sequence[str]) -> "subprocess.CompletedProcess[str]":
    """shoot-train --devices 2, as a user would type it."""
    program = Path(sys.executable).parent / "shoot-train"
    return subprocess.run(
        [program, *flags, "--devices", "2"],
        capture_output=True,
        text=True,
        check=False,
        timeout=PATIENCE_S,
        env={**os.environ, "OMP_NUM_THREADS": "1"},
    )


def test_two_processes_train_and_leave_one_record(tiny_run: TinyRun, tmp_path: Path) -> None:
    folder = tmp_path / "run"
    flags = train_flags(tiny_run.root, tiny_run.templates, folder, 3, 2)
    said = train_in_two(flags)
    assert said.returncode == 0, said.stderr
    with (folder / "metrics.csv").open() as stream:
        rows = list(csv.DictReader(stream))
    assert [int(row["step"]) for row in rows if row["val_nll"]] == [1, 2]
    assert len({row["step"] for row in rows}) == len(rows)
    state = torch.load(folder / "checkpoints" / "last.ckpt", weights_only=True)
    assert state["global_step"] == 3
    assert RunFolder(folder).config().devices == 2


@pytest.mark.parametrize("sample", ["scene-0003-00", "scene-0003-01"])
def test_one_sentence_for_all_processes(sample: str, tiny_run: TinyRun, tmp_path: Path) -> None:
    # The first sample is validated by the first process, the second one by the other.
    root = tmp_path / "data"
    shutil.copytree(tiny_run.root, root)
    image = root / "samples" / "CAM_BACK" / f"{sample}.jpg"
    image.write_bytes(image.read_bytes()[:-300])
    said = train_in_two(train_flags(root, tiny_run.templates, tmp_path / "run", 2, 1))
    assert said.returncode == 2, said.stderr
    assert "Traceback" not in said.stderr
    sentences = [line for line in said.stderr.splitlines() if line.startswith("error: ")]
    assert len(sentences) == 1, said.stderr
    assert str(image) in sentences[0]


def test_batch_that_cannot_be_shared(tiny_run: TinyRun, tmp_path: Path) -> None:
    # Said before any process is started.
    flags = train_flags(tiny_run.root, tiny_run.templates, tmp_path / "run", 2, 1)
    said = command("shoot-train", *flags, "--optim.batch-size", 3, "--devices", 2)
    assert said.status == 2
    assert said.err.startswith("error: A batch of 3 cannot be shared by 2 processes")
    assert not (tmp_path / "run").exists()
