"""The data set of the long experiments: a synthetic city, its scenes dealt out."""

import json
from pathlib import Path
from typing import Literal

from lss_core.data.splits import official_scenes
from lss_core.files import write_atomically
from shoot.world.config import VERSION, MakeWorldConfig
from shoot.world.writer import make_world

HALF = "train_half"  # a split of half the training scenes
HALF_SCENES = 350  # a data set of half the size, for runs that are compared with each other only


def make_data(
    root: Path,
    train_scenes: int,
    val_scenes: int,
    workers: int,
    sweeps: Literal["keyframes", "all"] = "all",
) -> None:
    """Make it and its splits, unless they are there.

    Args:
        root: Where to.
        train_scenes: Scenes to train on.
        val_scenes: Scenes to evaluate on.
        workers: Processes.
        sweeps: Which sweeps get files; what reads several scans needs all.
    """
    make_world(
        MakeWorldConfig(
            out=root,
            train_scenes=train_scenes,
            val_scenes=val_scenes,
            image_scale=0.11,
            scenes_per_town=2,
            tail_s=5.0,
            sweeps=sweeps,
            lidar_azimuths=128,
            workers=workers,
        )
    )
    train = official_scenes(VERSION, "train")[:train_scenes]
    splits = {
        "train": train,
        "val": official_scenes(VERSION, "val")[:val_scenes],
        HALF: train[: -(-train_scenes // 2)],
    }
    with write_atomically(root / VERSION / "splits.json") as stream:
        stream.write(json.dumps(splits).encode())
