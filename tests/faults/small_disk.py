"""A disk of its own that is small, can be filled, and can be had for reading only."""

import os
import shutil
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest


@contextmanager
def small_disk(folder: Path, num_bytes: int = 64 * 2**20) -> Iterator[Path]:
    """Mount one at a folder, which is made; the test is skipped where that is not allowed."""
    folder.mkdir(parents=True)
    if shutil.which("mount") is None or os.geteuid() != 0:
        pytest.skip("Only root may mount a small disk.")
    if problem := _mount("-t", "tmpfs", "-o", f"size={num_bytes}", "tmpfs", str(folder)):
        pytest.skip(f"This process may not mount a small disk: {problem}")
    try:
        yield folder
    finally:
        subprocess.run(["umount", "--lazy", folder], check=True)


@contextmanager
def filled(disk: Path, room_bytes: int) -> Iterator[None]:
    """Leave so much room on it."""
    state = os.statvfs(disk)
    filler = disk / "filler"
    with filler.open("wb") as stream:
        os.posix_fallocate(stream.fileno(), 0, state.f_bavail * state.f_frsize - room_bytes)
    try:
        yield
    finally:
        filler.unlink()


@contextmanager
def read_only(disk: Path) -> Iterator[None]:
    """Have it for reading only."""
    assert _mount("-o", "remount,ro", str(disk)) == ""
    try:
        yield
    finally:
        assert _mount("-o", "remount,rw", str(disk)) == ""


def _mount(*arguments: str) -> str:
    """What is wrong; empty if all went well."""
    done = subprocess.run(["mount", *arguments], capture_output=True, text=True, check=False)
    return (done.stderr.strip() or "unknown") if done.returncode else ""
