"""Sensor files put where tables name them, without overwriting what is there."""

import filecmp
import os
import shutil
from pathlib import Path

from lss_core.data.tables.file_names import leads_astray
from lss_core.errors import DataError
from lss_core.files import write_atomically


def place_file(source: Path, root: Path, name: str) -> str:
    """Put a file into a data root by a hard link, or a copy where there can be none.

    A file that already lies inside the root stays where it is.

    Args:
        source: The file.
        root: Of the data set.
        name: Wanted for it, relative to the root.

    Returns:
        Its name there, relative to the root.

    Raises:
        DataError: If another file has the name, or it has one that tables cannot give.
        OSError: If it cannot be written.
    """
    inside = Path(os.path.abspath(source))  # noqa: PTH100 (links are the user's own and stay)
    base = Path(os.path.abspath(root))  # noqa: PTH100
    if inside.is_relative_to(base):
        name = inside.relative_to(base).as_posix()
        if leads_astray(name):
            raise DataError(f"'{source}' has characters that no file name should have.")
        return name
    target = root / name
    if target.exists():
        if not (target.samefile(source) or filecmp.cmp(source, target, shallow=False)):
            raise _taken(target, str(source))
        return name
    target.parent.mkdir(parents=True, exist_ok=True)
    try:
        # A link to a link would break where the first leads from another folder.
        target.hardlink_to(source.resolve())
    except OSError:  # another disk, or a file system without links
        with source.open("rb") as stream, write_atomically(target, one_of_many=True) as copy:
            shutil.copyfileobj(stream, copy, 1 << 20)
    return name


def place_bytes(content: bytes, root: Path, name: str) -> str:
    """Write a file of a data set, unless it is there already; returns its name.

    Raises:
        DataError: If another file has the name.
        OSError: If it cannot be written.
    """
    target = root / name
    if target.exists():
        if target.read_bytes() != content:
            raise _taken(target, "what is to be written")
        return name
    with write_atomically(target, one_of_many=True) as stream:
        stream.write(content)
    return name


def _taken(target: Path, other: str) -> DataError:
    return DataError(
        f"'{target}' is there already and differs from {other}; remove it, or name another folder "
        "for the data set."
    )
