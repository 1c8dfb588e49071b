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
from lss_core.geometry import FloatArray, invert
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


def read_calibration(path: Path, camera: int) -> tuple[FloatArray, FloatArray]:
    """Intrinsics [3, 3] and `camera0_from_camera` [4, 4] from the projection P = K [I | t]."""
    lines = dict(line.split(":") for line in path.read_text().splitlines() if line.strip())
    projection = np.array(lines[f"P{camera}"].split(), dtype=float).reshape(3, 4)
    camera0_from_camera = np.eye(4)
    camera0_from_camera[:3, 3] = -np.linalg.solve(projection[:, :3], projection[:, 3])
    return projection[:, :3], camera0_from_camera


def read_poses(path: Path) -> FloatArray:
    """`global_from_ego` [P, 4, 4]: in a file is camera 0 in the frame of its first image."""
    camera0 = np.array(path.read_text().split(), dtype=float).reshape(-1, 3, 4)
    first_from_camera0 = np.tile(np.eye(4), (len(camera0), 1, 1))
    first_from_camera0[:, :3] = camera0
    return EGO_FROM_CAMERA0 @ first_from_camera0 @ invert(EGO_FROM_CAMERA0)


def add_sequence(writer: TablesWriter, config: KittiConfig, sequence: str) -> list[str]:
    """Cut a sequence into scenes of about 20 s; returns their names."""
    folder = config.kitti / "sequences" / sequence
    images = sorted((folder / f"image_{config.camera}").glob("*.png"))
    times_s = np.array((folder / "times.txt").read_text().split(), dtype=float)
    global_from_ego = read_poses(config.kitti / "poses" / f"{sequence}.txt")
    if not len(images) == len(times_s) == len(global_from_ego) > 0:
        counts = f"{len(images)} images, {len(times_s)} times and {len(global_from_ego)} poses"
        raise DataError(f"'{folder}' has {counts}, which must be as many.")
    intrinsics, camera0_from_camera = read_calibration(folder / "calib.txt", config.camera)
    width, height = Image.open(images[0]).size
    num_scenes = max(1, round((times_s[-1] - times_s[0]) / SCENE_S))
    names = []
    for number, frames in enumerate(np.array_split(np.arange(len(images)), num_scenes)):
        names.append(f"kitti-{sequence}-{number:02d}")
        scene = writer.add_scene(
            names[-1], times_s[frames], global_from_ego[frames], log=f"kitti-{sequence}"
        )
        mounting = EGO_FROM_CAMERA0 @ camera0_from_camera
        scene.add_camera("CAM_FRONT", intrinsics, mounting, (height, width))
        for frame in frames[::FRAMES_A_KEYFRAME]:
            scene.add_keyframe(times_s[frame], {"CAM_FRONT": images[frame]})
    return names


def convert(config: KittiConfig) -> None:
    """Write the data set."""
    unknown = set(config.val) - set(config.sequences)
    if unknown:
        raise DataError(f"--val {' '.join(sorted(unknown))} must be among --sequences, too.")
    writer = TablesWriter(config.out)
    splits: dict[str, list[str]] = {"train": [], "val": []}
    for sequence in config.sequences:
        try:
            names = add_sequence(writer, config, sequence)
        except (ValueError, LookupError) as error:
            raise DataError(f"Sequence {sequence} is not as KITTI's are: {error}.") from error
        splits["val" if sequence in config.val else "train"] += names
    print(f"Wrote {writer.write(splits)}; its camera is CAM_FRONT.")


if __name__ == "__main__":
    run(KittiConfig, convert, "Turn KITTI odometry sequences into a data set.")
