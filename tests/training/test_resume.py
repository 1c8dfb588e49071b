"""A killed training goes on as if nothing had happened; its record of metrics, too."""

import csv
import json
import random
import signal
import time
from multiprocessing.process import BaseProcess
from pathlib import Path
from typing import Any

import pytest
import torch
from world_fixture import TinyRun, command, start_command, train_flags

from shoot.training.metrics_file import MetricsFile, read_metrics

STEPS, EVERY = 23, 4  # the last round is shorter


def checkpoint(folder: Path, name: str = "last") -> dict[str, Any]:
    loaded: dict[str, Any] = torch.load(folder / "checkpoints" / f"{name}.ckpt", weights_only=True)
    return loaded


def metrics(folder: Path) -> list[dict[str, str]]:
    with (folder / "metrics.csv").open() as stream:
        return list(csv.DictReader(stream))


def wait_for(path: Path, process: BaseProcess) -> None:
    for _ in range(3000):
        if path.exists():
            return
        assert process.is_alive(), "ended before its first checkpoint"
        time.sleep(0.1)
    raise AssertionError(f"{path} has not come")


def assert_same_run(folder: Path, expected: Path) -> None:
    for name in ("last", "best"):
        ours, theirs = checkpoint(folder, name), checkpoint(expected, name)
        assert ours["global_step"] == theirs["global_step"]
        assert ours["state_dict"].keys() == theirs["state_dict"].keys()
        for key, value in theirs["state_dict"].items():
            assert torch.equal(ours["state_dict"][key], value), key
        moments = (state["optimizer_states"][0]["state"] for state in (ours, theirs))
        for mine, its in zip(*(list(m.values()) for m in moments), strict=True):
            assert all(torch.equal(mine[key], its[key]) for key in its)
    assert metrics(folder) == metrics(expected)


@pytest.fixture(scope="module")
def undisturbed(tiny_run: TinyRun, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("undisturbed") / "run"
    flags = train_flags(tiny_run.root, tiny_run.templates, folder, STEPS, EVERY)
    said = command("shoot-train", *flags)
    assert said.status == 0, said.err
    return folder


@pytest.mark.trains
@pytest.mark.parametrize("num_workers", [0, 1])
def test_killed_run_ends_as_an_undisturbed_one(
    num_workers: int, tiny_run: TinyRun, undisturbed: Path, tmp_path: Path
) -> None:
    folder, log = tmp_path / "run", tmp_path / "log"
    flags = train_flags(tiny_run.root, tiny_run.templates, folder, STEPS, EVERY)
    flags += ["--num-workers", str(num_workers), "--resume"]
    moment = random.Random(num_workers)
    for attempt in range(2):
        process = start_command("shoot-train", *flags, log=log)
        wait_for(folder / "checkpoints" / "last.ckpt", process)
        # After the resumption, somewhere between loading and the last round.
        time.sleep(moment.uniform(0.0, 0.4 + attempt))
        process.kill()
        process.join()
        if attempt == 0:
            assert process.exitcode == -signal.SIGKILL
            assert checkpoint(folder)["global_step"] < STEPS
    said = command("shoot-train", *flags)
    assert said.status == 0, said.err
    assert_same_run(folder, undisturbed)


def test_every_step_is_recorded_once(undisturbed: Path) -> None:
    rows = metrics(undisturbed)
    steps = [int(row["step"]) for row in rows]
    assert steps == sorted(set(steps))
    assert [int(row["step"]) for row in rows if row["val_top10"]] == [3, 7, 11, 15, 19, 22]
    losses = [float(row["train_loss"]) for row in rows if row["train_loss"]]
    assert len(losses) >= 5
    assert all(0.5 < loss < 6.0 for loss in losses)


def test_resuming_what_is_finished_changes_nothing(tiny_run: TinyRun, undisturbed: Path) -> None:
    files = [p for p in undisturbed.rglob("*") if p.suffix in (".ckpt", ".csv")]
    before = {path: path.read_bytes() for path in files}
    flags = train_flags(tiny_run.root, tiny_run.templates, undisturbed, STEPS, EVERY)
    said = command("shoot-train", *flags, "--resume")
    assert said.status == 0, said.err
    assert before == {path: path.read_bytes() for path in files}


def test_time_is_written_though_a_kill_came_before_it(tiny_run: TinyRun, undisturbed: Path) -> None:
    file = undisturbed / "training_time.json"
    whole_s = json.loads(file.read_text())["train_s"]
    file.unlink()
    flags = train_flags(tiny_run.root, tiny_run.templates, undisturbed, STEPS, EVERY)
    said = command("shoot-train", *flags, "--resume")
    assert said.status == 0, said.err
    # The last checkpoint knows it but for what came after.
    assert 0.0 < json.loads(file.read_text())["train_s"] <= whole_s


# The record of metrics


def test_metrics_of_a_step_share_a_row(tmp_path: Path) -> None:
    path = tmp_path / "metrics.csv"
    record = MetricsFile(path, resume=False)
    record.log_metrics({"loss": 2.5}, 0)
    record.log_metrics({"rate": 0.25}, 0)
    record.log_metrics({"loss": 1.5}, 10)
    record.log_metrics({"rate": 0.125, "loss": 1.25}, 10)
    assert path.read_text() == "step,loss,rate\n0,2.5,0.25\n10,1.25,0.125\n"


def test_resumed_record_forgets_what_is_done_again(tmp_path: Path) -> None:
    path = tmp_path / "metrics.csv"
    record = MetricsFile(path, resume=False)
    for step in (0, 10, 20, 30):
        record.log_metrics({"loss": float(step)}, step)
    record.log_metrics({"top10": 7.0}, 30)
    resumed = MetricsFile(path, resume=True)
    assert len(read_metrics(path)) == 4  # nothing is lost before something comes
    resumed.log_metrics({"rate": 0.5, "loss": -1.0}, 20)
    assert read_metrics(path) == {
        0: {"loss": "0"},
        10: {"loss": "10"},
        20: {"loss": "-1", "rate": "0.5"},
    }
    MetricsFile(path, resume=False).log_metrics({"loss": 3.0}, 0)
    assert path.read_text() == "step,loss\n0,3\n"


def test_line_cut_off_by_a_kill_is_dropped(tmp_path: Path) -> None:
    path = tmp_path / "metrics.csv"
    path.write_text("step,loss,rate\n0,2,0.5\n10,1")
    MetricsFile(path, resume=True).log_metrics({"loss": 4.0}, 20)
    assert path.read_text() == "step,loss,rate\n0,2,0.5\n20,4,\n"
    assert read_metrics(tmp_path / "none.csv") == {}
