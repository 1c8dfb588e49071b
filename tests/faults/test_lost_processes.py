"""A helper process that is killed ends the run, with a sentence, instead of leaving it to wait."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from tally import throw
from world_fixture import TinyRun, train_flags

# A hang lasts half an hour, gloo's patience. On a busy machine a minute can pass.
PATIENCE_S = 180
ENDS = "ends within a minute, with status 2 and one sentence; the checkpoint is whole"
TORCHRUN = ["torchrun", "--standalone", "--nproc-per-node", "2"]


def children(pid: int) -> list[int]:
    listed = Path(f"/proc/{pid}/task/{pid}/children").read_text().split()
    return [int(child) for child in listed]


def is_training(pid: int) -> bool:
    return b"shoot-train" in Path(f"/proc/{pid}/cmdline").read_bytes()


@pytest.mark.parametrize(
    ("way", "more"),
    [
        ("a loader process", ["--num-workers", "2"]),
        pytest.param("a process of --devices 2", ["--devices", "2"], marks=pytest.mark.full),
        pytest.param("a process of torchrun", [], marks=pytest.mark.full),
    ],
)
def test_killed_helper(way: str, more: list[str], tiny_run: TinyRun, tmp_path: Path) -> None:
    out, log = tmp_path / "run", tmp_path / "log"
    programs = Path(sys.executable).parent
    flags = train_flags(tiny_run.root, tiny_run.templates, out, 100_000, 4)
    launcher = [programs / TORCHRUN[0], *TORCHRUN[1:]] if "torchrun" in way else []
    with log.open("wb") as stream:
        process = subprocess.Popen(
            [*launcher, programs / "shoot-train", *flags, *more],
            stdout=stream,
            stderr=stream,
            env={**os.environ, "OMP_NUM_THREADS": "1"},
        )
    helpers: list[int] = []
    try:
        last = out / "checkpoints" / "last.ckpt"
        while not last.exists():
            assert process.poll() is None, log.read_text()
            time.sleep(0.1)
        helpers = [child for child in children(process.pid) if is_training(child)]
        assert helpers
        with throw(f"SIGKILL of {way}", ENDS) as figures:
            os.kill(helpers[-1], signal.SIGKILL)
            started = time.monotonic()
            status = process.wait(PATIENCE_S)
            figures["seconds to the end"] = f"{time.monotonic() - started:.0f}"
            said = log.read_text()
            assert status == (1 if launcher else 2), said  # torchrun has a status of its own
            assert said.count("error: ") == 1
            assert "--resume" in said
            if not launcher:
                assert "Traceback" not in said
            assert not [child for child in helpers if Path(f"/proc/{child}").exists()]
    finally:
        process.kill()
        for child in helpers:
            if Path(f"/proc/{child}").exists():
                os.kill(child, signal.SIGKILL)
