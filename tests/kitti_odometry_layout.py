"""A folder laid out as KITTI's odometry benchmark, of drives that are known."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
from filmed_drive import FilmedDrive
from numpy.typing import NDArray
from PIL import Image

from lss_core.geometry import FloatArray, invert

HEIGHT, WIDTH, FOCAL_PX, CENTRE_PX = 37, 124, 72.0, (60.9, 17.3)
INTRINSICS = np.array([[FOCAL_PX, 0, CENTRE_PX[0]], [0, FOCAL_PX, CENTRE_PX[1]], [0, 0, 1]])
BASE_M = 0.06  # camera 2 lies so far left of camera 0
AHEAD_M = 1.03  # camera 0 of the rear axle
EGO_FROM_CAMERA0 = np.array([[0.0, 0, 1, AHEAD_M], [-1, 0, 0, 0], [0, -1, 0, 1.65], [0, 0, 0, 1]])


def write_sequence(
    kitti: Path,
    name: str,
    times_s: FloatArray,
    world_from_ego: FloatArray,
    picture: Callable[[int], NDArray[np.uint8]],
) -> None:
    """Write all files that a converter may read; `picture(frame)` is [H, W, 3]."""
    folder = kitti / "sequences" / name
    for camera in (0, 2):
        (folder / f"image_{camera}").mkdir(parents=True)
    for number in range(len(times_s)):
        image = Image.fromarray(picture(number))
        image.convert("L").save(folder / "image_0" / f"{number:06d}.png")
        image.save(folder / "image_2" / f"{number:06d}.png")
    (folder / "times.txt").write_text("".join(f"{time_s:e}\n" for time_s in times_s))
    lines = []
    for camera in range(4):
        projection = np.hstack([INTRINSICS, np.zeros((3, 1))])
        projection[0, 3] = FOCAL_PX * BASE_M if camera == 2 else 0.0
        lines.append(f"P{camera}: {_text(projection)}\n")
    (folder / "calib.txt").write_text("".join(lines))
    world_from_camera0 = world_from_ego @ EGO_FROM_CAMERA0
    first_from_camera0 = invert(world_from_camera0[0]) @ world_from_camera0
    (kitti / "poses").mkdir(exist_ok=True)
    (kitti / "poses" / f"{name}.txt").write_text(
        "".join(f"{_text(pose[:3])}\n" for pose in first_from_camera0)
    )


def write_filmed(kitti: Path, name: str, drive: FilmedDrive) -> None:
    """A sequence that shows the road."""
    times_s = np.arange(0.0, drive.seconds + 1e-9, 0.1)
    ego_from_camera = EGO_FROM_CAMERA0 @ np.array(
        [[1.0, 0, 0, -BASE_M], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]
    )

    def picture(number: int) -> NDArray[np.uint8]:
        return drive.picture(INTRINSICS, ego_from_camera, (HEIGHT, WIDTH), times_s[number])

    write_sequence(kitti, name, times_s, drive.world_from_ego(times_s), picture)


def _text(numbers: FloatArray) -> str:
    return " ".join(f"{number:.12e}" for number in numbers.reshape(-1))
