"""A hand-made drive with boxes and a road, for the checks of paths.

The driver goes straight ahead at 10 m/s for 8 s, off the axes of `global`. Places are given as the
first sample sees them (x ahead, y left), times in seconds after it.
"""

import json
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any

import numpy as np
from tiny_tables import VAL, TinyScene, write_table, write_tiny

from lss_core.config import CAMERAS, DataConfig
from lss_core.data.samples import SampleIndex, load_index, rows_of_split
from shoot.evaluation.driving_checks import CHECK_HORIZONS_S, DrivingChecks
from shoot.training.planning.data import LabelledSplit
from shoot.trajectories import mine_futures

VERSION = "v1.0-trainval"
SPEED_MPS = VAL.speed_mps
NUM_SAMPLES, NUM_TIMES = 7, 20
TIMES_S = 0.25 * np.arange(1, NUM_TIMES + 1)
WIDE_ROAD = [[(-50.0, -50.0), (150.0, -50.0), (150.0, 50.0), (-50.0, 50.0)], []]


@dataclass(frozen=True)
class Thing:
    """Somebody with a box at some keyframes (which are 0.5 s apart)."""

    pose: Callable[[float], tuple[float, float, float]]
    length_m: float = 2.0
    width_m: float = 1.0
    category: str = "vehicle.car"
    keyframes: Sequence[int] = range(17)


def standing(x_m: float, y_m: float, yaw_rad: float = 0.0, **more: Any) -> Thing:
    """Somebody who stays in a place."""
    return Thing(lambda _: (x_m, y_m, yaw_rad), **more)


def to_global(scene: TinyScene, x_m: float, y_m: float) -> tuple[float, float]:
    """A place as the scene's first sample sees it, in `global`."""
    cos, sin = math.cos(scene.yaw_rad), math.sin(scene.yaw_rad)
    return scene.x_m + cos * x_m - sin * y_m, scene.y_m + sin * x_m + cos * y_m


def write_things(root: Path, things: Sequence[Thing], scene: TinyScene = VAL) -> None:
    """Replace the tables of annotations."""
    categories = sorted({thing.category for thing in things})
    write_table(root, "category", [{"token": f"c-{name}", "name": name} for name in categories])
    instances, annotations = [], []
    for number, thing in enumerate(things):
        instances.append({"token": f"i-{number}", "category_token": f"c-{thing.category}"})
        for keyframe in thing.keyframes:
            x_m, y_m, yaw_rad = thing.pose(0.5 * keyframe)
            half_rad = 0.5 * (yaw_rad + scene.yaw_rad)
            annotations.append(
                {
                    "token": f"a-{number}-{keyframe}",
                    "sample_token": f"{scene.name}-{keyframe:02d}",
                    "instance_token": f"i-{number}",
                    "translation": [*to_global(scene, x_m, y_m), 0.8],
                    "size": [thing.width_m, thing.length_m, 1.6],
                    "rotation": [math.cos(half_rad), 0.0, 0.0, math.sin(half_rad)],
                }
            )
    write_table(root, "instance", instances)
    # Tables need not be in the order of time.
    write_table(root, "sample_annotation", annotations[::-1])


def write_road(
    root: Path,
    areas: Sequence[tuple[Sequence[tuple[float, float]], Sequence[Sequence[tuple[float, float]]]]],
    location: str = "boston-seaport",
    scene: TinyScene = VAL,
) -> None:
    """Write a map expansion with drivable polygons: an outline and holes each."""
    layers: dict[str, Any] = {"version": "1.3", "node": [], "polygon": [], "drivable_area": []}

    def nodes(ring: Sequence[tuple[float, float]]) -> list[str]:
        tokens = []
        for place_m in ring:
            x_m, y_m = to_global(scene, *place_m)
            tokens.append(f"n-{len(layers['node'])}")
            layers["node"].append({"token": tokens[-1], "x": x_m, "y": y_m})
        return tokens

    for number, (outline, holes) in enumerate(areas):
        layers["polygon"].append(
            {
                "token": f"p-{number}",
                "exterior_node_tokens": nodes(outline),
                "holes": [{"node_tokens": nodes(hole)} for hole in holes],
            }
        )
        layers["drivable_area"].append({"token": f"d-{number}", "polygon_tokens": [f"p-{number}"]})
    folder = root / "maps" / "expansion"
    folder.mkdir(exist_ok=True, parents=True)
    (folder / f"{location}.json").write_text(json.dumps(layers))


def write_drive(
    root: Path, things: Sequence[Thing] = (), scenes: Sequence[TinyScene] = (VAL,)
) -> Path:
    """Write the data set, things in the scene `VAL`; returns `root`."""
    write_tiny(root, scenes, cameras=CAMERAS[:1], image_hw=(9, 16))
    write_things(root, things)
    return root


def config_of(root: Path, version: str = VERSION) -> DataConfig:
    """Where the data set is."""
    return DataConfig(root=str(root), version=version, cameras=CAMERAS[:1])


def label_split(
    data: DataConfig,
    split: str = "val",
    change: Callable[[SampleIndex], SampleIndex] | None = None,
    **times: float,
) -> LabelledSplit:
    """The split, all labels 0; its index may be changed after futures are mined."""
    index = load_index(data.root, data.version, data.cameras)
    rows = rows_of_split(index, data.root, data.version, split)
    futures = mine_futures(index, rows, "keyframes", **times)
    if change is not None:
        index = change(index)
    return LabelledSplit(index, futures, np.zeros(len(futures.sample), dtype=np.int64))


def keep_samples(index: SampleIndex, num: int) -> SampleIndex:
    """Only the first samples: the keyframes end before the poses do."""
    arrays = {
        field.name: getattr(index, field.name)[:num]
        for field in fields(SampleIndex)
        if len(getattr(index, field.name)) == len(index.sample_token)
    }
    return replace(index, **arrays)


def straight(speed_mps: float, direction_rad: float = 0.0, offset_m: float = 0.0) -> np.ndarray:
    """[T, 2] a path at constant speed; aside of the origin by `offset_m` from its start on."""
    way_m = speed_mps * TIMES_S
    return np.stack(
        [way_m * math.cos(direction_rad), way_m * math.sin(direction_rad) + offset_m], axis=-1
    )


def replace_first(split: LabelledSplit, path_m: np.ndarray) -> np.ndarray:
    """The driven paths, but another one for the first sample."""
    paths_m = split.futures.xy_m.copy()
    paths_m[0] = path_m
    return paths_m


def values_of_first(
    checks: DrivingChecks, split: LabelledSplit, path_m: np.ndarray, kind: str
) -> list:
    """Values of the first sample by horizon; those of the others are of the driven paths."""
    values = checks(replace_first(split, path_m))
    return [float(values[f"{kind}_{horizon_s}s"][0]) for horizon_s in CHECK_HORIZONS_S]
