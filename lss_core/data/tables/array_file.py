"""Arrays in one file that is mapped into memory: opened at once, shared by all who open it.

The file starts with its length of header, then a JSON header that says type, shape, place and
checksum of each array, then the arrays as they stand in memory.
"""

import json
import math
import mmap
import zlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lss_core.files import write_atomically

_ALIGN = 64
_LENGTH_BYTES = 8


def save_arrays(path: Path, arrays: Mapping[str, NDArray[Any]]) -> None:
    """Write arrays, of numbers or fixed-width texts; the file appears whole or not at all.

    Raises:
        OSError: If the file cannot be written.
    """
    entries, start = {}, 0
    for name, array in arrays.items():
        entries[name] = {
            "dtype": array.dtype.str,
            "shape": array.shape,
            "start": start,
            "crc32": zlib.crc32(array.tobytes()),
        }
        start += _aligned(array.nbytes)
    header = json.dumps(entries).encode()
    with write_atomically(path) as stream:
        stream.write(len(header).to_bytes(_LENGTH_BYTES, "little"))
        stream.write(header)
        for array in arrays.values():
            stream.write(bytes(-stream.tell() % _ALIGN))
            stream.write(array.tobytes())


def map_arrays(path: Path) -> dict[str, NDArray[Any]]:
    """The arrays of a file, by name; they cannot be written to.

    Raises:
        OSError: If the file cannot be read.
        ValueError: If it is not as it was written.
    """
    with path.open("rb") as stream:
        whole = mmap.mmap(stream.fileno(), 0, access=mmap.ACCESS_READ)
    first = _LENGTH_BYTES + int.from_bytes(whole[:_LENGTH_BYTES], "little")
    try:
        entries = json.loads(whole[_LENGTH_BYTES:first])
        return {name: _view(whole, _aligned(first), **entry) for name, entry in entries.items()}
    except (AttributeError, TypeError) as error:
        raise ValueError(f"its header is none: {error}") from error


def _aligned(num_bytes: int) -> int:
    return -(-num_bytes // _ALIGN) * _ALIGN


def _view(
    whole: mmap.mmap, first: int, dtype: str, shape: list[int], start: int, crc32: int
) -> NDArray[Any]:
    array = np.frombuffer(whole, np.dtype(dtype), math.prod(shape), first + start).reshape(shape)
    with memoryview(whole) as view, view[first + start : first + start + array.nbytes] as own:
        if zlib.crc32(own) != crc32:
            raise ValueError("its contents have changed")
    return array
