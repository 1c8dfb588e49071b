"""Writes the synthetic city to disk as a nuScenes data set that looks whole only when it is.

One job makes one town with its scenes. Each scene writes its files and, last, its rows into
`.parts`; when all parts are there, the tables are joined in `.parts/v1.0-trainval`, which is moved
to its place as the very last step. A kill at any moment leaves no file that is not whole.
"""

import json
import shutil
from functools import partial
from pathlib import Path

import cv2

from lss_core.errors import DataError
from lss_core.files import clear_leftovers, sole_writer, write_atomically
from lss_core.progress import progress
from shoot.jobs.parallel import run_jobs
from shoot.world.config import CARD, VERSION, MakeWorldConfig
from shoot.world.joining import PARTS, join_parts, write_json
from shoot.world.looks.paint import paint_unlit
from shoot.world.nuscenes.capture import capture_scene, texel_m
from shoot.world.nuscenes.map_layers import town_layers
from shoot.world.nuscenes.map_masks import town_mask
from shoot.world.nuscenes.tiling import TILE_M, seed_of
from shoot.world.orders import TownOrder, town_orders
from shoot.world.sensing.rig_plans import RIG_PLANS
from shoot.world.town.roads import make_town
from shoot.world.town.town import Town


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
        shutil.rmtree(root / PARTS, ignore_errors=True)
        return
    clear_leftovers(root)
    parts = root / PARTS
    parts.mkdir(parents=True, exist_ok=True)
    towns = list(town_orders(config))
    open_towns = [town for town in towns if not _is_done(town, parts)]
    total = sum(len(town.scenes) for town in towns)
    done = total - sum(len(town.scenes) for town in open_towns)
    with progress("Scenes", total, done) as advance:
        # Workers of a cluster have working directories of their own.
        make = partial(_make_town, root=root.absolute())
        for count in run_jobs(make, open_towns, config.workers, config.dask, parts):
            advance(count)
    join_parts(root, towns, RIG_PLANS[config.rig])
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
        write_json(card_path, config.card())
        return False
    try:
        card = json.loads(card_path.read_text(encoding="utf-8"))
    except ValueError as error:
        raise DataError(
            f"'{card_path}' cannot be read ({error}); choose an empty folder."
        ) from error
    now = config.card()
    for name in {**now, **card}:
        if card.get(name) != now.get(name):
            raise DataError(
                f"'{root}' was begun with {name} = {card.get(name)}, now it is {now.get(name)}: "
                "use the same settings to go on, or another folder."
            )
    return tables.exists()


def _is_done(order: TownOrder, parts: Path) -> bool:
    names = [order.name, *(scene.name for scene in order.scenes)]
    return all((parts / f"{name}.json").exists() for name in names)


def _make_town(order: TownOrder, root: Path) -> int:
    cv2.setNumThreads(1)
    parts = root / PARTS
    town = make_town(seed_of(order.seed, order.split, "town", order.index))
    if town.size_m > TILE_M:
        raise AssertionError(f"a town of {town.size_m} m does not fit its tile of {TILE_M} m")
    _write_town(order, town, parts)
    paint = paint_unlit(town, texel_m(order.scenes[0].image_scale))
    for scene in order.scenes:
        part = parts / f"{scene.name}.json"
        if not part.exists():
            write_json(part, capture_scene(scene, town, paint, root))
    return len(order.scenes)


def _write_town(order: TownOrder, town: Town, parts: Path) -> None:
    part = parts / f"{order.name}.json"
    if part.exists():
        return
    # Not cv2.imwrite: it says nothing when the disk is full.
    _, mask = cv2.imencode(".png", town_mask(town), [cv2.IMWRITE_PNG_BILEVEL, 1])
    with write_atomically(parts / f"{order.name}.png") as stream:
        stream.write(mask.tobytes())
    write_json(part, town_layers(town, f"{order.seed}/{order.name}", order.tile.origin_m))
