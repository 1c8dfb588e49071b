import errno
import fcntl
import os
import pickle
import resource
import signal
import stat
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from lss_core.errors import DataError
from lss_core.files import clear_leftovers, sole_writer, write_atomically, write_from

HOLD = """
import sys, time
from pathlib import Path
from lss_core.files import clear_leftovers, sole_writer, write_atomically, write_from
with sole_writer(Path(sys.argv[1])), write_atomically(Path(sys.argv[1]) / "file.bin") as stream:
    stream.write(b"half")
    stream.flush()
    print("has it", flush=True)
    time.sleep(600)
"""


@pytest.fixture
def holder(tmp_path: Path) -> "subprocess.Popen[str]":
    """Another process that is writing into the folder."""
    process = subprocess.Popen(
        [sys.executable, "-c", HOLD, str(tmp_path)], stdout=subprocess.PIPE, text=True
    )
    assert process.stdout is not None
    assert process.stdout.readline() == "has it\n"
    return process


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


def test_what_a_killed_process_left_is_cleared_away(
    holder: "subprocess.Popen[str]", tmp_path: Path
) -> None:
    path = tmp_path / "file.bin"
    (half,) = tmp_path.iterdir()
    assert half.name.startswith(".file.bin.")
    # As long as it lives its file is left alone.
    with write_atomically(path) as stream:
        stream.write(b"ours")
    assert set(tmp_path.iterdir()) == {half, path}
    holder.send_signal(signal.SIGKILL)
    holder.wait()
    with write_atomically(path) as stream:
        stream.write(b"ours again")
    assert list(tmp_path.iterdir()) == [path]
    assert path.read_bytes() == b"ours again"


def test_one_process_writes_into_a_folder_at_a_time(
    holder: "subprocess.Popen[str]", tmp_path: Path
) -> None:
    with pytest.raises(DataError, match="Another process is writing into"), sole_writer(tmp_path):
        raise AssertionError("let in")
    holder.send_signal(signal.SIGKILL)
    holder.wait()
    before = set(tmp_path.iterdir())
    for _ in range(2):
        with sole_writer(tmp_path):
            assert set(tmp_path.iterdir()) == before  # the lock is no file


def test_folders_without_locks_are_written_all_the_same(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def none(*_: object) -> None:
        raise OSError(95, "Operation not supported")

    monkeypatch.setattr(fcntl, "flock", none)
    with sole_writer(tmp_path), write_atomically(tmp_path / "f") as stream:
        stream.write(b"x")
    assert (tmp_path / "f").read_bytes() == b"x"


@contextmanager
def no_file_larger_than(num_bytes: int) -> Iterator[None]:
    """Have the system refuse longer files, as a full disk does: in the middle of a write."""
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (num_bytes, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))


@pytest.mark.parametrize("one_of_many", [False, True])
def test_errors_of_writing_name_the_file(one_of_many: bool, tmp_path: Path) -> None:
    path = tmp_path / "file.bin"
    path.write_bytes(b"old")
    with (
        pytest.raises(OSError, match="too large") as raised,
        no_file_larger_than(1000),
        write_atomically(path, one_of_many) as stream,
    ):
        stream.write(bytes(2000))
    assert raised.value.filename == str(path)
    assert path.read_bytes() == b"old"
    assert list(tmp_path.iterdir()) == [path]
    # A worker process hands it on.
    passed_on = pickle.loads(pickle.dumps(raised.value))
    assert (passed_on.filename, passed_on.errno) == (str(path), errno.EFBIG)


def test_errors_name_no_scrap(tmp_path: Path) -> None:
    path = tmp_path / "folder"
    (path / "full").mkdir(parents=True)
    with pytest.raises(IsADirectoryError) as raised, write_atomically(path):
        pass
    assert (raised.value.filename, raised.value.filename2) == (str(path), None)
    assert list(tmp_path.iterdir()) == [path]


def test_what_does_not_fit_leaves_what_was_before_it(tmp_path: Path) -> None:
    path = tmp_path / "rows"
    path.write_bytes(b"first\nsecond, which goes\n")
    with pytest.raises(OSError, match="rows") as raised, no_file_larger_than(1000):
        write_from(path, 6, bytes(2000))
    assert raised.value.errno == errno.EFBIG
    assert path.read_bytes() == b"first\n"
    write_from(path, 6, b"2nd\n")
    assert path.read_bytes() == b"first\n2nd\n"


def test_leftovers_of_a_whole_folder(holder: "subprocess.Popen[str]", tmp_path: Path) -> None:
    (tmp_path / "below").mkdir()
    (tmp_path / "below" / ".best.ckpt.abcd.part").touch()
    (alive,) = tmp_path.glob(".*")
    clear_leftovers(tmp_path)
    assert {path for path in tmp_path.rglob("*") if path.is_file()} == {alive}
    holder.send_signal(signal.SIGKILL)
    holder.wait()
    clear_leftovers(tmp_path)
    assert not any(path.is_file() for path in tmp_path.rglob("*"))


FORKS = """
import os, sys, time
from pathlib import Path
from lss_core.files import sole_writer
with sole_writer(Path(sys.argv[1])):
    if os.fork() == 0:  # as a loader's worker, it may outlive its parent
        print(os.getpid(), flush=True)
        time.sleep(600)
    time.sleep(600)
"""


def test_lock_ends_with_its_process_not_with_those_it_forked(tmp_path: Path) -> None:
    process = subprocess.Popen(
        [sys.executable, "-c", FORKS, str(tmp_path)], stdout=subprocess.PIPE, text=True
    )
    assert process.stdout is not None
    child = int(process.stdout.readline())
    try:
        with pytest.raises(DataError, match="Another process"), sole_writer(tmp_path):
            raise AssertionError("let in")
        process.kill()
        process.wait()
        os.kill(child, 0)  # it lives
        with sole_writer(tmp_path):
            pass
    finally:
        process.kill()
        os.kill(child, signal.SIGKILL)
