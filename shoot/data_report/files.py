"""A few files of each sensor: whether they are there, of the size the tables say, and whole."""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from lss_core.data.dataset import raw_hw
from lss_core.data.samples import SampleIndex
from lss_core.data.sensors.file_checks import image_problem
from lss_core.data.sensors.images import PixelMap, load_image
from lss_core.data.sensors.lidar import load_sweep
from lss_core.errors import DataError
from shoot.data_report.facts import FileFacts


def first_middle_last(rows: NDArray[np.int64]) -> list[int]:
    """Three of them at most."""
    chosen = {0, len(rows) // 2, len(rows) - 1} if len(rows) else set()
    return [int(rows[place]) for place in sorted(chosen)]


def look_at_images(
    index: SampleIndex, root: Path, rows: NDArray[np.int64], camera: int
) -> FileFacts:
    """Of a camera: header, size, and whether the image can be decoded to its end.

    Args:
        index: Of the data set.
        root: Its folder.
        rows: Samples that have such an image in the tables.
        camera: Which.
    """
    looked_at = first_middle_last(rows)
    there = [row for row in looked_at if is_file(root / str(index.image_path[row, camera]))]
    flaws = (_image_flaw(index, root, row, camera) for row in there)
    return FileFacts(len(looked_at), len(there), tuple(filter(None, flaws)))


def _image_flaw(index: SampleIndex, root: Path, row: int, camera: int) -> str:
    path = root / str(index.image_path[row, camera])
    height, width = index.image_hw[row, camera].tolist()
    problem = image_problem(path, (height, width))
    if problem:
        return problem.what
    try:
        whole_image(index, root, row, camera)
    except DataError as error:
        return error.sentence
    return ""


def whole_image(index: SampleIndex, root: Path, row: int, camera: int) -> NDArray[np.uint8]:
    """[H, W, 3] the image at its own size, read as for training.

    Raises:
        DataError: If the file is missing, damaged or of another size than the tables say.
    """
    hw = raw_hw(index, root, row, camera)
    return load_image(
        root / str(index.image_path[row, camera]), PixelMap(hw, 0, 0, False, 0.0, hw, hw)
    )


def look_at_sweeps(index: SampleIndex, root: Path, rows: NDArray[np.int64]) -> FileFacts:
    """Of the lidar's keyframes: whether points can be read of them.

    Args:
        index: Of the data set.
        root: Its folder.
        rows: Samples that have a sweep in the tables.
    """
    looked_at = first_middle_last(rows)
    there = [row for row in looked_at if is_file(root / str(index.lidar_path[row]))]
    return FileFacts(
        len(looked_at),
        len(there),
        tuple(filter(None, (_sweep_flaw(index, root, r) for r in there))),
    )


def _sweep_flaw(index: SampleIndex, root: Path, row: int) -> str:
    try:
        load_sweep(index, root, row)
    except DataError as error:
        return error.sentence
    return ""


def is_file(path: Path) -> bool:
    """Whether there is such a file; a name that cannot be has none."""
    try:
        return path.is_file()
    except (OSError, ValueError):
        return False
