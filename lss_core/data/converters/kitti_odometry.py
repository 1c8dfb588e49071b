"""KITTI's odometry benchmark: a path per sequence, grey and colour cameras.

    SRC/poses/00.txt
    SRC/sequences/00/calib.txt, times.txt, image_0/000000.png, image_2/000000.png

A pattern for your own recordings: nothing but poses, one camera and its calibration.
"""

from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Literal

import numpy as np
from PIL import Image

from lss_core.data.converters.drive import CameraTrack, Drive, FoundDrive
from lss_core.data.converters.kitti_raw import rect_from_projection
from lss_core.errors import DataError
from lss_core.geometry import FloatArray, invert

# By the drawing of the sensors (cvlibs.net/datasets/kitti/setup.php) camera 0 looks straight
# ahead, 1.65 m above the road and 1.68 m behind the front axle, so, at a wheel base of 2.71 m,
# 1.03 m ahead of the rear axle; x is right, y down, z forward.
EGO_FROM_CAMERA0 = np.array([[0.0, 0, 1, 1.03], [-1, 0, 0, 0], [0, -1, 0, 1.65], [0, 0, 0, 1]])

GreyOrColour = Literal[0, 2]


def find_kitti_odometry(
    src: Path, sequences: Sequence[str] = (), camera: GreyOrColour = 0
) -> list[FoundDrive]:
    """Sequences with poses.

    Args:
        src: Folder with `sequences/` and `poses/`.
        sequences: Their names, as 03; all that have poses if none is named.
        camera: 0 is the left grey camera, 2 the left colour camera.

    Raises:
        DataError: If there is none.
    """
    names = sequences or sorted(path.stem for path in (src / "poses").glob("*.txt"))
    if not names:
        raise DataError(
            f"'{src}' has no sequence of KITTI odometry: expected poses/00.txt and sequences/00/."
        )
    return [
        FoundDrive(f"kitti-{name}", partial(_read, src, name, camera), log=name) for name in names
    ]


def _read(src: Path, sequence: str, camera: GreyOrColour) -> Drive:
    folder = src / "sequences" / sequence
    images = sorted((folder / f"image_{camera}").glob("*.png"))
    time_s = np.array((folder / "times.txt").read_text().split(), dtype=float)
    global_from_ego = _poses(src / "poses" / f"{sequence}.txt")
    if not len(images) == len(time_s) == len(global_from_ego) > 0:
        counts = f"{len(images)} images, {len(time_s)} times and {len(global_from_ego)} poses"
        raise DataError(f"'{folder}' has {counts}, which must be as many.")
    intrinsics, camera0_from_camera = _calibration(folder / "calib.txt", camera)
    with Image.open(images[0]) as image:
        width, height = image.size
    mounting = EGO_FROM_CAMERA0 @ camera0_from_camera
    track = CameraTrack(intrinsics, mounting, (height, width), time_s, images)
    return Drive(time_s, global_from_ego, {"CAM_FRONT": track}, time_s)


def _calibration(path: Path, camera: GreyOrColour) -> tuple[FloatArray, FloatArray]:
    """Intrinsics [3, 3] and `camera0_from_camera` [4, 4]."""
    lines = dict(line.split(":") for line in path.read_text().splitlines() if line.strip())
    projection = np.array(lines[f"P{camera}"].split(), dtype=float).reshape(3, 4)
    return projection[:, :3], rect_from_projection(projection)


def _poses(path: Path) -> FloatArray:
    """`global_from_ego` [P, 4, 4]: in a file is camera 0 in the frame of its first image."""
    camera0 = np.array(path.read_text().split(), dtype=float).reshape(-1, 3, 4)
    first_from_camera0 = np.tile(np.eye(4), (len(camera0), 1, 1))
    first_from_camera0[:, :3] = camera0
    return EGO_FROM_CAMERA0 @ first_from_camera0 @ invert(EGO_FROM_CAMERA0)
