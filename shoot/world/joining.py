"""The parts of a world joined into its tables and maps."""

import json
import shutil
from contextlib import ExitStack
from pathlib import Path
from typing import Any

from lss_core.data.writing.table_rows import TABLE_NAMES, Row
from lss_core.files import name_errors, write_atomically
from shoot.world.config import VERSION
from shoot.world.nuscenes.capture import LIDAR
from shoot.world.nuscenes.map_layers import canvas_of, merge_layers
from shoot.world.nuscenes.map_masks import write_mask
from shoot.world.nuscenes.tables import fixed_tables
from shoot.world.nuscenes.tiling import LOCATIONS
from shoot.world.orders import TownOrder
from shoot.world.sensing.rig_plans import RigPlan

PARTS = ".parts"


def write_json(path: Path, content: Any) -> None:
    """Write a value as JSON, whole or not at all."""
    with write_atomically(path) as stream:
        # Not json.dump: writing piece by piece it is ten times slower.
        stream.write(json.dumps(content, separators=(",", ":")).encode())


def join_parts(root: Path, towns: list[TownOrder], rig: RigPlan) -> None:
    """Make tables and maps of the parts of all towns; the tables get their place as the last step.

    Args:
        root: Folder of the data set.
        towns: All of it, in order.
        rig: The car that drove there.
    """
    joined = root / PARTS / VERSION
    shutil.rmtree(joined, ignore_errors=True)
    joined.mkdir()
    with ExitStack() as stack:
        tables = {name: _Table(joined / f"{name}.json", stack) for name in TABLE_NAMES}
        _fill(tables, root, towns, rig)
        for table in tables.values():
            table.end()
    joined.replace(root / VERSION)


def _fill(tables: dict[str, "_Table"], root: Path, towns: list[TownOrder], rig: RigPlan) -> None:
    """Add the rows of all parts, and write the maps, whose files have rows too."""
    parts = root / PARTS
    channels = (*(camera.channel for camera in rig.cameras), LIDAR)
    logs: dict[int, list[str]] = {}
    for name, rows in fixed_tables(channels).items():
        tables[name].add(rows)
    for town in towns:
        for scene in town.scenes:
            part: dict[str, list[Row]] = json.loads(
                (parts / f"{scene.name}.json").read_text("utf-8")
            )
            for name, rows in part.items():
                tables[name].add(rows)
            logs.setdefault(town.tile.location, []).extend(row["token"] for row in part["log"])
    for number in sorted(logs):
        tables["map"].add([{
            "token": LOCATIONS[number].mask_name,
            "category": "semantic_prior",
            "filename": f"maps/{LOCATIONS[number].mask_name}.png",
            "log_tokens": logs[number],
        }])  # fmt: skip
        _join_map(root, number, [town for town in towns if town.tile.location == number])


def _join_map(root: Path, number: int, towns: list[TownOrder]) -> None:
    location, parts = LOCATIONS[number], root / PARTS
    (root / "maps" / "expansion").mkdir(parents=True, exist_ok=True)
    columns = max(town.tile.column for town in towns) + 1
    rows = max(town.tile.row for town in towns) + 1
    layers = [json.loads((parts / f"{town.name}.json").read_text("utf-8")) for town in towns]
    expansion = merge_layers(layers, canvas_of(location, columns, rows))
    write_json(root / "maps" / "expansion" / f"{location.name}.json", expansion)
    tiles = {(town.tile.column, town.tile.row): parts / f"{town.name}.png" for town in towns}
    write_mask(root / "maps" / f"{location.mask_name}.png", tiles, columns, rows)


class _Table:
    """Writes a JSON list row by row: the tables of a large world do not fit into memory."""

    def __init__(self, path: Path, stack: ExitStack) -> None:
        self._path = path
        self._stream = stack.enter_context(write_atomically(path))
        self._stream.write(b"[")
        self._is_empty = True

    def add(self, rows: list[Row]) -> None:
        with name_errors(self._path):  # all tables are open, and each would give its own name
            for row in rows:
                self._stream.write(b"\n" if self._is_empty else b",\n")
                self._is_empty = False
                self._stream.write(json.dumps(row).encode())

    def end(self) -> None:
        with name_errors(self._path):
            self._stream.write(b"\n]\n")
            self._stream.flush()
