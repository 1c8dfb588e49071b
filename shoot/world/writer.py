"""Writes the synthetic city to disk as a nuScenes data set that looks whole only when it is.

One job makes one town with its scenes. Each scene writes its files and, last, its rows into
`.parts`; when all parts are there, the tables are joined in `.parts/v1.0-trainval`, which is moved
to its place as the very last step. A kill at any moment leaves no file that is not whole.
"""

import json
import shutil
from collections.abc import Iterator
from contextlib import ExitStack
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import Annotated, Any, Literal

import cv2
import tyro

from lss_core.bounds import Bounds, Seed, SettingError, Workers, check_settings
from lss_core.data.splits import official_scenes
from lss_core.data.writing.table_rows import TABLE_NAMES, Row
from lss_core.errors import DataError
from lss_core.files import clear_leftovers, name_errors, sole_writer, write_atomically
from lss_core.progress import progress
from shoot.jobs.parallel import run_jobs
from shoot.world.looks.paint import paint_unlit
from shoot.world.nuscenes.capture import LIDAR, SceneOrder, capture_scene, texel_m
from shoot.world.nuscenes.maps import canvas_of, merge_layers, town_layers, town_mask, write_mask
from shoot.world.nuscenes.tables import fixed_tables
from shoot.world.nuscenes.tiling import LOCATIONS, TILE_M, Split, Tile, seed_of, tile_of
from shoot.world.sensing.rig import CAMERA_PLANS
from shoot.world.town.roads import make_town
from shoot.world.town.town import Town

VERSION = "v1.0-trainval"
CARD = "world.json"
# Raise it whenever the same settings would give other bytes: a resumed run must not mix two worlds.
WORLD_FORMAT = 3
_PARTS = ".parts"
# As many as the official splits name.
MAX_TRAIN_SCENES, MAX_VAL_SCENES = 700, 150
ImageScale = Annotated[float, Bounds(0.05, 1.0)]


@dataclass(frozen=True)
class MakeWorldConfig:
    """What `shoot-make-world` writes, and where.

    Attributes:
        out: Folder of the data set.
        train_scenes: Scenes of the official `train` split (at most 700).
        val_scenes: Scenes of the official `val` split (at most 150), one town each.
        seed: The same seed gives the same bytes.
        image_scale: Size of the images as a share of 1600 x 900.
        sweeps: Which lidar sweeps get files: those of keyframes, or all outside the tail (ten
            times as many; planners that read several scans need them).
        workers: Processes; changes nothing but the time it takes.
        dask: Address of a dask scheduler, as tcp://host:8786; its workers then make the scenes.
            They must see the folder under the same name.
        scenes_per_town: Training scenes that share a town.
        duration_s: Length of a scene.
        keyframe_s: Time between keyframes, on average (nuScenes: 0.5 s).
        tail_s: Time at the end of a scene whose keyframes have boxes and a sweep, but no images: it
            is the future of the keyframes before (nuScenes: 0 s).
        lidar_azimuths: Lidar firings a turn (32 beams each); 0 takes fewer for smaller images.
    """

    out: Annotated[Path, tyro.conf.Positional]
    train_scenes: Annotated[int, Bounds(0, MAX_TRAIN_SCENES)] = 40
    val_scenes: Annotated[int, Bounds(0, MAX_VAL_SCENES)] = 10
    seed: Seed = 0
    image_scale: ImageScale = 0.25
    sweeps: Literal["keyframes", "all"] = "keyframes"
    workers: Workers = 2
    dask: str | None = None
    scenes_per_town: Annotated[int, Bounds(1, MAX_TRAIN_SCENES)] = 1
    duration_s: Annotated[float, Bounds(0.5, 60.0)] = 20.0
    keyframe_s: Annotated[float, Bounds(0.2, 5.0)] = 0.5
    tail_s: Annotated[float, Bounds(0.0, 60.0)] = 0.0
    lidar_azimuths: Annotated[int, Bounds(0, 4096)] = 0

    def __post_init__(self) -> None:
        check_settings(self)
        if self.tail_s > self.duration_s - 0.1:
            raise SettingError(
                f"tail_s is {self.tail_s:g}, but must be 0.1 s less than duration_s, "
                f"{self.duration_s:g}, or shorter."
            )
        if self.train_scenes + self.val_scenes == 0:
            raise SettingError("train_scenes and val_scenes are both 0: nothing to write.")

    def card(self) -> dict[str, Any]:
        """The settings that decide what is written (where and how it is does not)."""
        settings = asdict(self)
        del settings["out"], settings["workers"], settings["dask"]
        return {"world_format": WORLD_FORMAT, **settings}

    def azimuths(self) -> int:
        """Lidar firings a turn."""
        return self.lidar_azimuths or (1024 if self.image_scale >= 0.2 else 384)


@dataclass(frozen=True)
class _TownOrder:
    """One job: a town and its scenes."""

    split: Split
    index: int
    seed: int
    tile: Tile
    scenes: tuple[SceneOrder, ...]

    @property
    def name(self) -> str:
        return f"town-{self.split}-{self.index:04d}"


def make_world(config: MakeWorldConfig) -> None:
    """Write a data set, or finish one that was begun with the same settings.

    Raises:
        DataError: If the folder holds something else, or a world with other settings.
    """
    root = config.out
    if root.exists() and not root.is_dir():
        raise DataError(f"'{root}' is a file; name a folder for the data set.")
    with sole_writer(root):
        _make_world(config, root)


def _make_world(config: MakeWorldConfig, root: Path) -> None:
    if _is_finished(root, config):
        shutil.rmtree(root / _PARTS, ignore_errors=True)
        return
    clear_leftovers(root)
    parts = root / _PARTS
    parts.mkdir(parents=True, exist_ok=True)
    towns = list(_town_orders(config))
    open_towns = [town for town in towns if not _is_done(town, parts)]
    total = sum(len(town.scenes) for town in towns)
    done = total - sum(len(town.scenes) for town in open_towns)
    with progress("Scenes", total, done) as advance:
        # Workers of a cluster have working directories of their own.
        make = partial(_make_town, root=root.absolute())
        for count in run_jobs(make, open_towns, config.workers, config.dask, parts):
            advance(count)
    _join(root, towns)
    shutil.rmtree(parts)


def _is_finished(root: Path, config: MakeWorldConfig) -> bool:
    """Compare the folder with the settings; note them in a new one."""
    card_path, tables = root / CARD, root / VERSION
    if not card_path.exists():
        if tables.exists():
            raise DataError(
                f"'{root}' already holds another data set in '{VERSION}'; choose an empty folder."
            )
        root.mkdir(parents=True, exist_ok=True)
        _write_json(card_path, config.card())
        return False
    try:
        card = json.loads(card_path.read_text(encoding="utf-8"))
    except ValueError as error:
        raise DataError(
            f"'{card_path}' cannot be read ({error}); choose an empty folder."
        ) from error
    for name, value in config.card().items():
        if card.get(name) != value:
            raise DataError(
                f"'{root}' was begun with {name} = {card.get(name)}, now it is {value}: "
                "use the same settings to go on, or another folder."
            )
    return tables.exists()


def _town_orders(config: MakeWorldConfig) -> Iterator[_TownOrder]:
    counts: tuple[tuple[Split, int, int], ...] = (
        ("train", config.train_scenes, config.scenes_per_town),
        ("val", config.val_scenes, 1),
    )
    for split, num_scenes, per_town in counts:
        names = official_scenes(VERSION, split)
        for first in range(0, num_scenes, per_town):
            town = first // per_town
            tile = tile_of(split, town)
            scenes = tuple(
                SceneOrder(
                    names[index], split, index, town, config.seed,
                    config.duration_s, config.keyframe_s, config.tail_s, config.image_scale,
                    config.azimuths(), config.sweeps, tile,
                )
                for index in range(first, min(first + per_town, num_scenes))
            )  # fmt: skip
            yield _TownOrder(split, town, config.seed, tile, scenes)


def _is_done(order: _TownOrder, parts: Path) -> bool:
    names = [order.name, *(scene.name for scene in order.scenes)]
    return all((parts / f"{name}.json").exists() for name in names)


def _make_town(order: _TownOrder, root: Path) -> int:
    cv2.setNumThreads(1)
    parts = root / _PARTS
    town = make_town(seed_of(order.seed, order.split, "town", order.index))
    if town.size_m > TILE_M:
        raise AssertionError(f"a town of {town.size_m} m does not fit its tile of {TILE_M} m")
    _write_town(order, town, parts)
    paint = paint_unlit(town, texel_m(order.scenes[0].image_scale))
    for scene in order.scenes:
        part = parts / f"{scene.name}.json"
        if not part.exists():
            _write_json(part, capture_scene(scene, town, paint, root))
    return len(order.scenes)


def _write_town(order: _TownOrder, town: Town, parts: Path) -> None:
    part = parts / f"{order.name}.json"
    if part.exists():
        return
    # Not cv2.imwrite: it says nothing when the disk is full.
    _, mask = cv2.imencode(".png", town_mask(town), [cv2.IMWRITE_PNG_BILEVEL, 1])
    with write_atomically(parts / f"{order.name}.png") as stream:
        stream.write(mask.tobytes())
    _write_json(part, town_layers(town, f"{order.seed}/{order.name}", order.tile.origin_m))


def _write_json(path: Path, content: Any) -> None:
    with write_atomically(path) as stream:
        # Not json.dump: writing piece by piece it is ten times slower.
        stream.write(json.dumps(content, separators=(",", ":")).encode())


def _join(root: Path, towns: list[_TownOrder]) -> None:
    joined = root / _PARTS / VERSION
    shutil.rmtree(joined, ignore_errors=True)
    joined.mkdir()
    with ExitStack() as stack:
        tables = {name: _Table(joined / f"{name}.json", stack) for name in TABLE_NAMES}
        _fill(tables, root, towns)
        for table in tables.values():
            table.end()
    joined.replace(root / VERSION)


def _fill(tables: dict[str, "_Table"], root: Path, towns: list[_TownOrder]) -> None:
    """Add the rows of all parts, and write the maps, whose files have rows too."""
    parts = root / _PARTS
    channels = (*(plan.channel for plan in CAMERA_PLANS), LIDAR)
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


def _join_map(root: Path, number: int, towns: list[_TownOrder]) -> None:
    location, parts = LOCATIONS[number], root / _PARTS
    (root / "maps" / "expansion").mkdir(parents=True, exist_ok=True)
    columns = max(town.tile.column for town in towns) + 1
    rows = max(town.tile.row for town in towns) + 1
    layers = [json.loads((parts / f"{town.name}.json").read_text("utf-8")) for town in towns]
    expansion = merge_layers(layers, canvas_of(location, columns, rows))
    _write_json(root / "maps" / "expansion" / f"{location.name}.json", expansion)
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
