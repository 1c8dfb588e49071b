"""Arrays from a `.npz` file that may come from strangers: no pickle, no more than is expected."""

import zlib
from pathlib import Path
from typing import Any
from zipfile import BadZipFile, ZipFile

import numpy as np
from numpy.typing import NDArray

# What numpy and zip raise on files that are cut off, damaged, or something else altogether.
UNREADABLE = (
    OSError,
    EOFError,
    ValueError,
    LookupError,
    TypeError,
    AttributeError,
    RuntimeError,
    ArithmeticError,
    MemoryError,
    BadZipFile,
    zlib.error,
)


def read_npz(path: Path, max_bytes: int) -> dict[str, NDArray[Any]]:
    """The arrays of a file, by name.

    Args:
        path: Of the file.
        max_bytes: What unpacks to more is not meant well.

    Raises:
        Exception: One of `UNREADABLE`, if it cannot be read.
    """
    with ZipFile(path) as archive:
        unpacked = sum(entry.file_size for entry in archive.infolist())
    if unpacked > max_bytes:
        raise ValueError(f"it would unpack to {unpacked >> 20} MB")
    with np.load(path, allow_pickle=False) as stored:
        # A member that is no array comes as bytes.
        return {name: np.asarray(stored[name]) for name in stored.files}
