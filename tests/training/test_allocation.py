"""Freed memory stays with the process."""

import multiprocessing
import platform
from pathlib import Path

import pytest
import torch

from shoot.training.allocation import keep_freed_memory


def _resident_mb_after_freeing(keep: bool) -> float:
    if keep:
        assert keep_freed_memory()
    tensor = torch.ones(50_000_000)
    del tensor
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * 4096 / 1e6


@pytest.mark.skipif(platform.libc_ver()[0] != "glibc", reason="a setting of glibc")
def test_memory_stays_only_if_told_so() -> None:
    with multiprocessing.get_context("spawn").Pool(1, maxtasksperchild=1) as pool:
        gone, kept = pool.map(_resident_mb_after_freeing, [False, True], chunksize=1)
    assert kept - gone > 150.0  # of 200


def test_other_libraries_are_left_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("platform.libc_ver", lambda: ("musl", "1.2"))
    assert not keep_freed_memory()
