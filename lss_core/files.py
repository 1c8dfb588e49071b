"""Files that appear whole or not at all, and folders that one process writes at a time."""

import errno
import fcntl
import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import IO

from lss_core.errors import DataError

_ENDING = ".part"


@contextmanager
def write_atomically(path: str | Path, one_of_many: bool = False) -> Iterator[IO[bytes]]:
    """Open a file for writing that takes its name only when everything is written and on disk.

    The folder is made if needed. An error or a kill leaves an older file of that name as it was;
    what a killed process has left beside it is cleared away by the next that writes the file.

    Args:
        path: Its name.
        one_of_many: Neither wait for the disk nor look for what killed processes have left, which
            takes too long for files by the thousand; who writes them calls `clear_leftovers` first.

    Raises:
        OSError: If it cannot be written; `filename` is `path`.
    """
    path = Path(path)
    with name_errors(path):
        path.parent.mkdir(parents=True, exist_ok=True)
        if not one_of_many:
            for leftover in path.parent.glob(f".{path.name}.*{_ENDING}"):
                _clear(leftover)
        aside, handle = _open_aside(path)
        try:
            with os.fdopen(handle, "wb") as stream:
                yield stream
                stream.flush()
                if not one_of_many:
                    os.fsync(stream.fileno())
                umask = os.umask(0)
                os.umask(umask)
                aside.chmod(0o666 & ~umask)
                aside.replace(path)
        except BaseException:
            aside.unlink(missing_ok=True)
            raise


def check_writable(path: str | Path) -> None:
    """See whether a file can be written, before the work that it is to hold; its folder is made.

    Raises:
        OSError: If it cannot; `filename` is `path`.
    """
    path = Path(path)
    with name_errors(path):
        path.parent.mkdir(parents=True, exist_ok=True)
        if path.is_dir():
            raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR), str(path))
        aside, handle = _open_aside(path)
        os.close(handle)
        aside.unlink(missing_ok=True)


def write_from(path: Path, start: int, content: bytes) -> None:
    """Put bytes in place of all that a file holds from a position on.

    Raises:
        OSError: If they cannot be written; the file then ends at `start`.
    """
    with name_errors(path), path.open("r+b", buffering=0) as stream:
        stream.truncate(start)
        stream.seek(start)
        rest = memoryview(content)
        try:
            while rest:
                rest = rest[stream.write(rest) :]
        except OSError:
            stream.truncate(start)
            raise


@contextmanager
def name_errors(path: Path) -> Iterator[None]:
    """Let the system's errors name a file: those of writing name none, or a scrap beside it."""
    try:
        yield
    except OSError as error:
        of_scrap = str(error.filename).endswith(_ENDING)
        if error.errno is not None and (error.filename is None or of_scrap):
            error.filename, error.filename2 = str(path), None
        raise


def clear_leftovers(folder: Path) -> None:
    """Remove what killed processes had begun to write in a folder and in all below it."""
    for leftover in folder.rglob(f".*{_ENDING}"):
        _clear(leftover)


def _open_aside(path: Path) -> tuple[Path, int]:
    """A new file beside `path`, open and locked."""
    while True:
        handle, name = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}.", suffix=_ENDING)
        try:
            # While it is held, nobody takes the file for a leftover; before, somebody might have.
            is_ours = _lock(handle) and os.fstat(handle).st_nlink > 0
        except OSError:  # no locks here, so nobody can take it
            is_ours = True
        if is_ours:
            return Path(name), handle
        os.close(handle)


def _clear(leftover: Path) -> None:
    """Remove a file unless a living process writes it."""
    with suppress(OSError), leftover.open("rb") as stream:
        if _lock(stream.fileno()):
            leftover.unlink()


_held: set[int] = set()


def _let_go() -> None:
    """A forked process may outlive the one that has the lock, and does not write."""
    for handle in _held:
        os.close(handle)
    _held.clear()


os.register_at_fork(after_in_child=_let_go)


@contextmanager
def sole_writer(folder: Path) -> Iterator[None]:
    """Keep all other processes that ask for it from writing into a folder meanwhile.

    The lock is the kernel's: it leaves no file behind and ends with the process, however that ends.
    The folder is made if needed. On file systems without such locks nobody is kept out.

    Raises:
        DataError: If another process has the folder.
    """
    folder.mkdir(parents=True, exist_ok=True)
    handle = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
    _held.add(handle)
    try:
        with suppress(OSError):
            if not _lock(handle):
                raise DataError(
                    f"Another process is writing into '{folder}' now; wait until it has ended, or "
                    "choose another folder."
                )
        yield
    finally:
        if handle in _held:  # else this is a forked process
            _held.remove(handle)
            os.close(handle)


def _lock(handle: int) -> bool:
    """Whether the lock could be had.

    Raises:
        OSError: If there are no locks here.
    """
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    return True
