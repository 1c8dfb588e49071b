"""Files that appear whole or not at all, and folders that one process writes at a time."""

import fcntl
import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import IO

from lss_core.errors import DataError


@contextmanager
def write_atomically(path: str | Path) -> Iterator[IO[bytes]]:
    """Open a file for writing that takes its name only when everything is written and on disk.

    The folder is made if needed. An error or a kill leaves an older file of that name as it was;
    what a killed process has left beside it is cleared away by the next that writes the file.
    """
    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    _clear_leftovers(path)
    handle, name = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}.", suffix=".part")
    aside = Path(name)
    try:
        with os.fdopen(handle, "wb") as stream:
            _lock(stream.fileno())  # while it is held, nobody takes the file for a leftover
            yield stream
            stream.flush()
            os.fsync(stream.fileno())
            umask = os.umask(0)
            os.umask(umask)
            aside.chmod(0o666 & ~umask)
            aside.replace(path)
    except BaseException:
        aside.unlink(missing_ok=True)
        raise


def _clear_leftovers(path: Path) -> None:
    """Remove what processes that were killed had begun to write."""
    for leftover in path.parent.glob(f".{path.name}.*.part"):
        with suppress(OSError), leftover.open("rb") as stream:
            if _lock(stream.fileno()):
                leftover.unlink()


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
    try:
        if not _lock(handle):
            raise DataError(
                f"Another process is writing into '{folder}' now; wait until it has ended, or "
                "choose another folder."
            )
        yield
    finally:
        os.close(handle)


def _lock(handle: int) -> bool:
    """Whether the lock could be had; True where there are none."""
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    except OSError:
        return True
    return True
