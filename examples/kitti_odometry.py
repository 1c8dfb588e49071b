"""Turn sequences of the KITTI odometry benchmark into a data set that `shoot` reads.

    python examples/kitti_odometry.py KITTI OUT --sequences 03 04 --val 04

KITTI is the folder with `sequences/` and `poses/` (https://www.cvlibs.net/datasets/kitti, its terms
are non-commercial). Poses are public for sequences 00 to 10. A pattern for your own recordings.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
import tyro
from PIL import Image

from lss_core.data import TablesWriter
from lss_core.errors import DataError
from lss_core.geometry import invert
from shoot.cli.app import run

# KITTI's cameras look straight ahead, 1.65 m above the road; x is right, y down, z forward. The ego
# frame here is x forward, y left, z up, on the road below the left grey camera, camera 0.
EGO_FROM_CAMERA0 = np.array([[0.0, 0, 1, 0], [-1, 0, 0, 0], [0, -1, 0, 1.65], [0, 0, 0, 1]])
SCENE_S = 20.0
FRAMES_A_KEYFRAME = 5  # of 10 a second


@dataclass(frozen=True)
class KittiConfig:
    """What is converted.

    Attributes:
        kitti: Folder with `sequences/` and `poses/`.
        out: Folder of the data set.
        sequences: Names, as 03.
        val: Those of them that are for validation; the others are for training.
        camera: 0 is the left grey camera, 2 the left colour camera.
    """

    kitti: Annotated[Path, tyro.conf.Positional]
    out: Annotated[Path, tyro.conf.Positional]
    sequences: tuple[str, ...]
    val: tuple[str, ...]
    camera: Literal[0, 2] = 0


def read_calibration(path: Path, camera: int) -> tuple[np.ndarray, np.ndarray]:
    """Intrinsics [3, 3] and `camera0_from_camera` [4, 4] from the projection P = K [I | t]."""
    lines = dict(line.split(":") for line in path.read_text().splitlines() if line.strip())
    projection = np.array(lines[f"P{camera}"].split(), dtype=float).reshape(3, 4)
    camera0_from_camera = np.eye(4)
    camera0_from_camera[:3, 3] = -np.linalg.solve(projection[:, :3], projection[:, 3])
    return projection[:, :3], camera0_from_camera


def add_sequence(writer: TablesWriter, config: KittiConfig, sequence: str) -> list[str]:
    """Cut a sequence into scenes of about 20 s; returns their names."""
    folder = config.kitti / "sequences" / sequence
    images = sorted((folder / f"image_{config.camera}").glob("*.png"))
    times_s = np.array((folder / "times.txt").read_text().split(), dtype=float)
    poses = np.tile(np.eye(4), (len(times_s), 1, 1))
    rows = (config.kitti / "poses" / f"{sequence}.txt").read_text().split()
    poses[:, :3] = np.array(rows, dtype=float).reshape(-1, 3, 4)
    # The first camera frame is the world of KITTI's poses, the first ego frame is ours.
    global_from_ego = EGO_FROM_CAMERA0 @ poses @ invert(EGO_FROM_CAMERA0)
    intrinsics, camera0_from_camera = read_calibration(folder / "calib.txt", config.camera)
    width, height = Image.open(images[0]).size
    num_scenes = max(1, round((times_s[-1] - times_s[0]) / SCENE_S))
    names = [f"kitti-{sequence}-{number:02d}" for number in range(num_scenes)]
    for name, rows_of_scene in zip(names, np.array_split(np.arange(len(images)), num_scenes)):
        scene = writer.add_scene(
            name, times_s[rows_of_scene], global_from_ego[rows_of_scene], log=f"kitti-{sequence}"
        )
        mounting = EGO_FROM_CAMERA0 @ camera0_from_camera
        scene.add_camera("CAM_FRONT", intrinsics, mounting, (height, width))
        for row in rows_of_scene[::FRAMES_A_KEYFRAME]:
            scene.add_keyframe(times_s[row], {"CAM_FRONT": images[row]})
    return names


def convert(config: KittiConfig) -> None:
    """Write the data set."""
    writer = TablesWriter(config.out)
    splits: dict[str, list[str]] = {"train": [], "val": []}
    for sequence in config.sequences:
        try:
            names = add_sequence(writer, config, sequence)
        except (ValueError, LookupError) as error:
            raise DataError(f"Sequence {sequence} is not as KITTI's are: {error}.") from error
        splits["val" if sequence in config.val else "train"] += names
    print(f"Wrote {writer.write(splits)}; cameras: CAM_FRONT.")


if __name__ == "__main__":
    run(KittiConfig, convert, "Turn KITTI odometry sequences into a data set.")
