"""What tests of killed and resumed trainings share: when to kill, and what must be the same."""

import csv
import time
from multiprocessing.process import BaseProcess
from pathlib import Path
from typing import Any

import torch

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
