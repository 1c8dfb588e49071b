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
from world_fixture import TinyRun, call_command, command, start_beside, train_flags

from shoot.training import precision
from shoot.training.data import TaskData
from shoot.training.loop import make_trainer
from shoot.training.planning.run_folder import PlanningRun
from shoot.training.planning.task import PlanningModule

PATIENCE_S = 400


def validate(run_folder: Path, out: Path) -> None:
    """Write the metrics of a run's last checkpoint on its validation split."""
    torch.set_num_threads(1)
    run = PlanningRun(run_folder)
    config, templates = run.config(), run.templates()
    module = PlanningModule(config, templates)
    module.load_state_dict(run.weights("last")["state_dict"])
    trainer = make_trainer(config, PlanningRun(out), module.task)
    (result,) = trainer.validate(module, datamodule=TaskData(config, module.task), verbose=False)
    if trainer.is_global_zero:
        (out / "metrics.json").write_text(json.dumps(result))


def free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port: int = probe.getsockname()[1]
    return port


def run_in(processes: int, function: Any, given: Any, out: Path) -> None:
    """Run a function of something and a folder in one process, or in several as torchrun would."""
    out.mkdir()
    # The meeting place is torchrun's own, and outlives what its processes say to each other.
    store = torch.distributed.TCPStore("127.0.0.1", 0, is_master=True, wait_for_workers=False)
    started = []
    for rank in range(processes):
        environment = {
            "RANK": rank,
            "LOCAL_RANK": rank,
            "GROUP_RANK": 0,
            "WORLD_SIZE": processes,
            "LOCAL_WORLD_SIZE": processes,
            "MASTER_ADDR": "127.0.0.1",
            "MASTER_PORT": store.port,
            "TORCHELASTIC_USE_AGENT_STORE": "True",
            "TORCHELASTIC_RUN_ID": "test",
        }
        started.append(
            start_beside(
                function,
                given,
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


def choose_precision(run_folder: Path, out: Path) -> None:
    """Write what a process trains in that finds `RANK`'s choice the fastest."""
    rank = int(os.environ["RANK"])
    precision.fastest_precision = lambda device: ("bf16-mixed", "32-true")[rank]
    chosen = precision.agreed_precision(torch.device("cpu"))
    torch.distributed.init_process_group("gloo")  # as Lightning would: it finds the same meeting
    torch.distributed.barrier()
    (out / f"precision{rank}").write_text(chosen)


def test_all_processes_train_in_the_first_ones_precision(tmp_path: Path) -> None:
    out = tmp_path / "out"
    run_in(2, choose_precision, tmp_path, out)
    assert [(out / f"precision{rank}").read_text() for rank in range(2)] == ["bf16-mixed"] * 2


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


def train_in_two(flags: Sequence[str]) -> "subprocess.CompletedProcess[str]":
    """shoot-train --devices 2, as a user would type it."""
    (said,) = run_programs([["shoot-train", *flags, "--devices", "2"]])
    return said


def run_programs(lines: Sequence[Sequence[str]]) -> "list[subprocess.CompletedProcess[str]]":
    """Run command lines at the same time; programs are those of this Python."""
    programs = Path(sys.executable).parent
    started = [
        subprocess.Popen(
            [programs / line[0], *line[1:]],
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            env={**os.environ, "OMP_NUM_THREADS": "1"},
        )
        for line in lines
    ]
    try:
        said = [process.communicate(timeout=PATIENCE_S) for process in started]
    finally:
        for process in started:
            process.kill()
    return [
        subprocess.CompletedProcess(process.args, process.returncode, *texts)
        for process, texts in zip(started, said, strict=True)
    ]


def launch(way: str, flags: Sequence[str]) -> list[list[str]]:
    """Command lines that start one run in two processes."""
    train = ["shoot-train", *flags]
    if way == "devices":
        return [[*train, "--devices", "2"]]
    train[0] = str(Path(sys.executable).parent / train[0])
    if way == "torchrun":
        return [["torchrun", "--standalone", "--nproc-per-node", "2", *train]]
    meet = f"localhost:{free_port()}"
    agent = ["--nproc-per-node", "1", "--rdzv-backend", "c10d", "--rdzv-endpoint", meet]
    return [["torchrun", "--nnodes", "2", "--node-rank", str(n), *agent, *train] for n in range(2)]


CURVE_STEPS = 6


@pytest.fixture(scope="module")
def lone_curve(tiny_run: TinyRun, tmp_path_factory: pytest.TempPathFactory) -> list[dict[str, str]]:
    """metrics.csv of a run in one process."""
    return train_curve("lone", tiny_run, tmp_path_factory.mktemp("lone"))


def train_with(flags: Sequence[str], _: Path) -> None:
    call_command("shoot-train", flags)


def train_curve(way: str, tiny_run: TinyRun, folder: Path) -> list[dict[str, str]]:
    flags = train_flags(tiny_run.root, tiny_run.templates, folder / "run", CURVE_STEPS, 1)
    # Adam's first steps follow the sign of gradients however small: differences grow with its rate.
    flags += ["--optim.batch-size", "4", "--optim.learning-rate", "2e-4"]
    if way == "lone":
        said = command("shoot-train", *flags)
        assert said.status == 0, said.err
    elif way == "as torchrun":
        run_in(2, train_with, flags, folder / "logs")
    else:
        for program in run_programs(launch(way, flags)):
            assert program.returncode == 0, program.stderr
    with (folder / "run" / "metrics.csv").open() as stream:
        return list(csv.DictReader(stream))


@pytest.mark.slow
@pytest.mark.parametrize(
    "way",
    [
        "as torchrun",
        *(
            pytest.param(way, marks=pytest.mark.full)
            for way in ("devices", "torchrun", "two agents")
        ),
    ],
)
def test_the_loss_curve_does_not_depend_on_processes(
    way: str, lone_curve: list[dict[str, str]], tiny_run: TinyRun, tmp_path: Path
) -> None:
    # Sums over two shares are rounded otherwise than sums over all, and training lets differences
    # grow: 1e-7 at the first step, 2e-5 at the sixth, as much as between one thread and two.
    # Were each share normalised by itself, it would be 4e-4 at the first step, 1e-2 at the sixth.
    ours = train_curve(way, tiny_run, tmp_path)
    assert len(ours) == len(lone_curve) == CURVE_STEPS
    for step, (row, lone) in enumerate(zip(ours, lone_curve, strict=True)):
        assert row["step"] == lone["step"] == str(step)
        tolerance = 1e-6 if step < 3 else 1e-4
        for name in ("train_loss", "val_nll"):
            assert float(row[name]) == pytest.approx(float(lone[name]), rel=tolerance), name
        assert float(row["grad_norm"]) == pytest.approx(float(lone["grad_norm"]), rel=2e-3)
        assert float(row["lr-Adam"]) == float(lone["lr-Adam"])
    if way == "devices":
        assert PlanningRun(tmp_path / "run").config().devices == 2


def train_apart(run_folder: Path, out: Path) -> None:
    """Train with batch statistics of each process's own; each leaves its weights and buffers."""
    torch.set_num_threads(1)
    run = PlanningRun(run_folder)
    config, templates = run.config(), run.templates()
    optim = replace(config.optim, steps=3, batch_size=2)
    config = replace(config, optim=optim, val_every=2, sync_batchnorm=False)
    pl.seed_everything(3, verbose=False)
    module = PlanningModule(config, templates)
    trainer = make_trainer(config, PlanningRun(out), module.task)
    trainer.fit(module, datamodule=TaskData(config, module.task))
    torch.save(module.state_dict(), out / f"weights{trainer.global_rank}.pt")


def test_two_processes_leave_one_record(tiny_run: TinyRun, tmp_path: Path) -> None:
    folder = tmp_path / "run"
    run_in(2, train_apart, tiny_run.folder, folder)
    with (folder / "metrics.csv").open() as stream:
        rows = list(csv.DictReader(stream))
    assert [int(row["step"]) for row in rows if row["val_nll"]] == [1, 2]
    assert len({row["step"] for row in rows}) == len(rows)
    state = torch.load(folder / "checkpoints" / "last.ckpt", weights_only=True)
    assert state["global_step"] == 3
    # Statistics of their own are averaged before they are used and saved.
    for rank in range(2):
        weights = torch.load(folder / f"weights{rank}.pt", weights_only=True)
        for name, value in state["state_dict"].items():
            assert torch.equal(weights[name], value), name


@pytest.mark.full
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
