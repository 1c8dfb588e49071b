"""A recording, as people have one: a car on an arc, one camera, an image at each keyframe."""

from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from lss_core.data import SceneWriter, TablesWriter
from lss_core.geometry import FloatArray, rigid_from_yaw

VERSION = "v1.0-trainval"
HEIGHT, WIDTH = 18, 32
INTRINSICS = [[25.0, 0.0, 15.0], [0.0, 25.0, 9.0], [0.0, 0.0, 1.0]]
AHEAD = np.array([[0.0, 0, 1, 1.7], [-1, 0, 0, 0.2], [0, -1, 0, 1.5], [0, 0, 0, 1]])
TIMES_S = np.arange(0.0, 8.05, 0.1) + 1_600_000_000.0
KEYFRAMES = range(0, 81, 5)


def arc(times_s: FloatArray = TIMES_S, x_m: float = 600_000.0) -> FloatArray:
    """A car at 5 m/s on a circle of 50 m radius, in coordinates as large as UTM's."""
    yaw = 0.3 + 0.1 * (times_s - times_s[0])
    xy_m = np.stack([x_m + 50.0 * np.sin(yaw), 5_400_000.0 - 50.0 * np.cos(yaw)], axis=-1)
    return rigid_from_yaw(xy_m, yaw)


def write_images(folder: Path) -> list[Path]:
    """One image for each of `KEYFRAMES`, in a new folder."""
    rng = np.random.default_rng(0)
    folder.mkdir()
    paths = [folder / f"{number}.png" for number in KEYFRAMES]
    for path in paths:
        Image.fromarray(rng.integers(0, 256, (HEIGHT, WIDTH, 3), dtype=np.uint8)).save(path)
    return paths


def add_ride(writer: TablesWriter, name: str, images: list[Path], **settings: Any) -> SceneWriter:
    scene = writer.add_scene(name, TIMES_S, arc(), **settings)
    scene.add_camera("FRONT", INTRINSICS, AHEAD, (HEIGHT, WIDTH))
    for row, image in zip(KEYFRAMES, images, strict=True):
        scene.add_keyframe(TIMES_S[row], {"FRONT": image})
    return scene
