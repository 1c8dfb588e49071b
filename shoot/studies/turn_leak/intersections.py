"""Finds the samples of a synthetic data set before an intersection where the ego has a choice.

The data set does not say: its towns and their traffic are made again from the seed in `world.json`.
"""

import json
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from joblib import Parallel, delayed

from lss_core.data.splits import official_scenes
from lss_core.errors import DataError
from lss_core.geometry import FloatArray
from shoot.studies.turn_leak.answers import Question
from shoot.training.planning.data import LabelledSplit
from shoot.world.config import CARD, VERSION, WORLD_FORMAT
from shoot.world.nuscenes.tiling import Split, seed_of, tile_of
from shoot.world.sensing.rig_plans import LIDAR_PERIOD_S
from shoot.world.town.roads import make_town
from shoot.world.traffic.approaches import find_approaches, way_ahead


@dataclass(frozen=True)
class SceneOrigin:
    """What a scene of the synthetic city was made from.

    Attributes:
        town_seed: Of `make_town`.
        scene_seed: Of `make_scenario`.
        origin_m: [2] of the town in `global`.
    """

    town_seed: int
    scene_seed: int
    origin_m: FloatArray


def scene_origin(root: Path, name: str) -> SceneOrigin:
    """Look up what a scene was made from.

    Args:
        root: Folder of the data set.
        name: Of the scene.

    Raises:
        DataError: If this is no synthetic data set, or one made by another version.
    """
    path = root / CARD
    if not path.is_file():
        raise DataError(
            f"'{root}' has no {CARD}: only worlds of shoot-make-world can be made again."
        )
    card = json.loads(path.read_text(encoding="utf-8"))
    if card.get("world_format") != WORLD_FORMAT:
        raise DataError(
            f"'{root}' is a world of format {card.get('world_format')}, this version makes "
            f"{WORLD_FORMAT}; make it anew."
        )
    splits: tuple[tuple[Split, int], ...] = (("train", card["scenes_per_town"]), ("val", 1))
    for split, per_town in splits:
        names = official_scenes(VERSION, split)
        if name in names:
            index = names.index(name)
            town = index // per_town
            return SceneOrigin(
                seed_of(card["seed"], split, "town", town),
                seed_of(card["seed"], split, "scene", index),
                tile_of(split, town).origin_m,
            )
    raise DataError(f"Scene '{name}' is in neither of the splits that worlds have.")


def find_questions(split: LabelledSplit, root: Path, workers: int = 1) -> list[Question]:
    """All samples of a split before intersections where the ego has a choice.

    Args:
        split: Of a synthetic data set.
        root: Folder of the data set.
        workers: Processes; a scene takes each several seconds.

    Raises:
        DataError: If the data set is none that this version makes.
    """
    scenes = list(dict.fromkeys(split.futures.scene.tolist()))
    jobs = [delayed(_ask_scene)(split, root, scene) for scene in scenes]
    found: list[list[Question]] = Parallel(n_jobs=workers)(jobs)
    return [question for questions in found for question in questions]


def _ask_scene(split: LabelledSplit, root: Path, scene: int) -> list[Question]:
    index = split.index
    name = str(index.scene_name[scene])
    origin = scene_origin(root, name)
    track = index.track(scene)
    # The first pose is that of the first turn of the lidar.
    zero_s = float(index.track_time_s[track][0]) - LIDAR_PERIOD_S
    town = make_town(origin.town_seed)
    try:
        approaches = find_approaches(
            town,
            origin.scene_seed,
            index.track_time_s[track] - zero_s,
            index.track_xy_m[track] - origin.origin_m,
        )
    except ValueError as error:
        raise DataError(
            f"'{root}' was made by another version of the synthetic city ({name}: {error}); "
            "make it anew."
        ) from error

    def ask() -> Iterator[Question]:
        for position in np.flatnonzero(split.futures.scene == scene).tolist():
            sample = int(split.futures.sample[position])
            time_s = float(index.time_s[sample]) - zero_s
            ego_from_global = np.linalg.inv(index.global_from_ego[sample])
            xy_m = index.global_from_ego[sample, :2, 3] - origin.origin_m
            for number, approach in enumerate(approaches):
                if not approach.start_s <= time_s < approach.end_s:
                    continue
                ahead = [way_ahead(town, approach, way, xy_m) for way in approach.ways]
                yield Question(
                    position=position,
                    scene=name,
                    approach=number,
                    directions=approach.directions(town),
                    ways_m=tuple(
                        (way_m + origin.origin_m) @ ego_from_global[:2, :2].T
                        + ego_from_global[:2, 3]
                        for way_m, _ in ahead
                    ),
                    taken=approach.taken,
                    distance_m=ahead[0][1],
                    is_single_lane=approach.is_single_lane,
                    stage=approach.stage(time_s),
                )

    return list(ask())
