"""A folder of numbered frames: which moments it holds, and their plans as pictures of a video."""

import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from numpy.typing import NDArray

from lss_core.errors import DataError
from shoot.moment.planning import Moment
from shoot.moment.rig_file import Rig

_ENDINGS = (".jpg", ".jpeg", ".png")
_NUMBER = re.compile(r"\d{1,18}$")
_DPI = 100.0


@dataclass(frozen=True)
class Stream:
    """Moments in the order of their numbers.

    Attributes:
        numbers: Of the frames that all its cameras have.
        moments: One each.
        num_incomplete: Numbers that some cameras have and others lack.
    """

    numbers: tuple[int, ...]
    moments: tuple[Moment, ...]
    num_incomplete: int


def find_frames(folder: Path, rig: Rig, speed_mps: float = 0.0) -> Stream:
    """The frames in a folder that has one folder per camera, named as it.

    A frame's number is what the names of its files, JPEG or PNG, end in: `FRONT/0007.jpg` and
    `LEFT/image_7.png` are one moment. Cameras of the rig without a folder are left out.

    Args:
        folder: Of the stream.
        rig: Its cameras.
        speed_mps: Of the car, in all frames.

    Raises:
        DataError: If there is no frame that all cameras have, or one camera has a number twice.
    """
    by_camera = {
        camera.name: _numbered(folder / camera.name)
        for camera in rig.cameras
        if (folder / camera.name).is_dir()
    }
    if not by_camera:
        names = ", ".join(camera.name for camera in rig.cameras)
        raise DataError(
            f"'{folder}' has no folder named as a camera of the rig; its cameras are {names}, and "
            "their images are to be in folders of these names."
        )
    numbers = [set(paths) for paths in by_camera.values()]
    whole = sorted(set.intersection(*numbers))
    if not whole:
        raise DataError(
            f"'{folder}' has no frame that all of {', '.join(by_camera)} have; the names of files "
            "must end in the frame's number, as 0001.jpg."
        )
    moments = [
        Moment.of(rig, {name: paths[number] for name, paths in by_camera.items()}, speed_mps)
        for number in whole
    ]
    return Stream(tuple(whole), tuple(moments), len(set.union(*numbers)) - len(whole))


def _numbered(folder: Path) -> dict[int, Path]:
    paths: dict[int, Path] = {}
    for path in sorted(folder.iterdir()):
        number = _NUMBER.search(path.stem)
        if path.suffix.lower() not in _ENDINGS or number is None:
            continue
        if int(number[0]) in paths:
            raise DataError(
                f"'{folder}' has two images of frame {int(number[0])}: "
                f"'{paths[int(number[0])].name}' and '{path.name}'; keep one."
            )
        paths[int(number[0])] = path
    return paths


def as_pixels(figure: Figure) -> NDArray[np.uint8]:
    """[H, W, 3] a figure as a frame of a video, its sides even."""
    figure.set_dpi(_DPI)
    canvas: Any = FigureCanvasAgg(figure)
    canvas.draw()
    rgba = np.asarray(canvas.buffer_rgba())
    height, width = (side // 2 * 2 for side in rgba.shape[:2])
    return np.ascontiguousarray(rgba[:height, :width, :3])
