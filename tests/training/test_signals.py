"""A run that gets a signal ends its step, writes a checkpoint, and loses nothing."""

import os
import signal
from pathlib import Path

import pytest
from resumption import EVERY, STEPS, assert_same_run, checkpoint, wait_for
from world_fixture import TinyRun, command, start_command, train_flags


@pytest.mark.parametrize(("number", "status"), [(signal.SIGINT, 130), (signal.SIGTERM, 143)])
def test_the_step_ends_with_a_checkpoint(
    number: signal.Signals, status: int, tiny_run: TinyRun, tmp_path: Path
) -> None:
    folder, log = tmp_path / "run", tmp_path / "log"
    many = train_flags(tiny_run.root, tiny_run.templates, folder, 100_000, 50_000)
    process = start_command("shoot-train", *many, log=log)
    wait_for(folder / "metrics.csv", process)
    assert process.pid is not None
    os.kill(process.pid, number)
    process.join(timeout=120)
    assert process.exitcode == status
    said = log.read_text()
    assert "Traceback" not in said
    assert "--resume goes on there" in " ".join(said.split())
    # In the middle of a round of 50,000 steps: only the signal can have written it.
    step = checkpoint(folder)["global_step"]
    assert 0 < step < 50_000


@pytest.mark.parametrize(
    ("stop_at", "number", "status"), [(2, signal.SIGTERM, 143), (9, signal.SIGINT, 130)]
)
def test_what_was_ended_goes_on_as_if_undisturbed(
    stop_at: int, number: int, status: int, tiny_run: TinyRun, undisturbed: Path, tmp_path: Path
) -> None:
    """Ended within a round, not at its end, where a checkpoint is written anyway."""
    folder = tmp_path / "run"
    flags = train_flags(tiny_run.root, tiny_run.templates, folder, STEPS, EVERY)
    with pytest.MonkeyPatch.context() as patch:
        from shoot.training.module import TaskModule

        real = TaskModule.training_step

        def training_step(self, batch, batch_idx):  # type: ignore[no-untyped-def]
            if self.trainer.global_step == stop_at:
                os.kill(os.getpid(), number)
            return real(self, batch, batch_idx)

        patch.setattr(TaskModule, "training_step", training_step)
        said = command("shoot-train", *flags)
    assert said.status == status, said.err
    assert checkpoint(folder)["global_step"] == stop_at + 1
    said = command("shoot-train", *flags, "--resume")
    assert said.status == 0, said.err
    assert_same_run(folder, undisturbed)


def test_a_second_signal_ends_at_once(tiny_run: TinyRun, tmp_path: Path) -> None:
    folder, log = tmp_path / "run", tmp_path / "log"
    flags = train_flags(tiny_run.root, tiny_run.templates, folder, 100_000, 50_000)
    process = start_command("shoot-train", *flags, log=log)
    wait_for(folder / "metrics.csv", process)
    assert process.pid is not None
    os.kill(process.pid, signal.SIGSTOP)
    os.kill(process.pid, signal.SIGINT)
    os.kill(process.pid, signal.SIGTERM)  # both wait for it when it goes on
    os.kill(process.pid, signal.SIGCONT)
    process.join(timeout=60)
    assert process.exitcode in (130, 143)
    assert not (folder / "checkpoints" / "last.ckpt").exists()


def test_a_second_run_into_the_folder_is_refused(tiny_run: TinyRun, tmp_path: Path) -> None:
    folder = tmp_path / "run"
    flags = train_flags(tiny_run.root, tiny_run.templates, folder, 100_000, 50_000)
    process = start_command("shoot-train", *flags, log=tmp_path / "log")
    try:
        wait_for(folder / "metrics.csv", process)
        said = command("shoot-train", *flags, "--resume")
        assert said.status == 2
        sentence = " ".join(said.err.split("error:")[-1].split())
        assert sentence.startswith("Another process is writing into")
        assert process.is_alive()
    finally:
        process.kill()
        process.join()
