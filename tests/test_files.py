import os
import stat
from pathlib import Path

import pytest

from lss_core.files import write_atomically


def test_makes_folders_and_writes_bytes(tmp_path: Path) -> None:
    path = tmp_path / "a" / "b" / "file.bin"
    with write_atomically(path) as stream:
        stream.write(b"whole")
        assert not path.exists()
    assert path.read_bytes() == b"whole"


def _write_half(path: Path, error: BaseException) -> None:
    with write_atomically(path) as stream:
        stream.write(b"new")
        raise error


def test_error_leaves_the_old_file_and_no_scraps(tmp_path: Path) -> None:
    path = tmp_path / "file.bin"
    path.write_bytes(b"old")
    with pytest.raises(RuntimeError, match="half way"):
        _write_half(path, RuntimeError("half way"))
    assert path.read_bytes() == b"old"
    assert list(tmp_path.iterdir()) == [path]


def test_interrupt_leaves_nothing(tmp_path: Path) -> None:
    with pytest.raises(KeyboardInterrupt):
        _write_half(tmp_path / "f", KeyboardInterrupt())
    assert list(tmp_path.iterdir()) == []


def test_others_may_read_it_as_the_umask_says(tmp_path: Path) -> None:
    before = os.umask(0o027)
    try:
        with write_atomically(tmp_path / "f") as stream:
            stream.write(b"x")
    finally:
        os.umask(before)
    assert stat.S_IMODE((tmp_path / "f").stat().st_mode) == 0o640
