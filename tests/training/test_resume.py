"""A killed training goes on as if nothing had happened."""

import json
import random
import signal
import time
from pathlib import Path

import pytest
from resumption import EVERY, STEPS, assert_same_run, checkpoint, metrics, wait_for
from world_fixture import TinyRun, command, start_command, train_flags


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
