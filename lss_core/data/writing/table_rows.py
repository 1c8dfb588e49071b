"""Rows of the nuScenes tables as they are written: names of tables, tokens, order in time."""

import hashlib
import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from lss_core.files import write_atomically

Row = dict[str, Any]

# Those without which the official devkit does not open a version.
TABLE_NAMES = (
    "category", "attribute", "visibility", "instance", "sensor", "calibrated_sensor", "ego_pose",
    "log", "scene", "sample", "sample_data", "sample_annotation", "map",
)  # fmt: skip


def token(*parts: object) -> str:
    """A nuScenes token (32 hexadecimal digits) that depends on `parts` alone."""
    text = "/".join(str(part) for part in parts)
    return hashlib.blake2b(text.encode(), digest_size=16).hexdigest()


def chain(rows: Sequence[Row]) -> None:
    """Set `prev` and `next` of rows in order, in place."""
    for index, row in enumerate(rows):
        row["prev"] = rows[index - 1]["token"] if index else ""
        row["next"] = rows[index + 1]["token"] if index + 1 < len(rows) else ""


def write_tables(folder: Path, tables: Mapping[str, Sequence[Row]]) -> None:
    """Write all tables of a version, a row a line; those without rows are empty lists.

    Raises:
        OSError: If they cannot be written.
    """
    for name in TABLE_NAMES:
        rows = ",\n".join(json.dumps(row) for row in tables.get(name, ()))
        with write_atomically(folder / f"{name}.json") as stream:
            stream.write(f"[\n{rows}\n]\n".encode())
