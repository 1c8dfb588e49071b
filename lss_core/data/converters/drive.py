"""A recorded drive, as every converter reads it: poses, cameras, and sweeps and boxes if any."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lss_core.geometry import FloatArray


@dataclass(frozen=True)
class CameraTrack:
    """A camera and its images.

    Attributes:
        rawpixel_from_camera: [3, 3] intrinsics.
        ego_from_camera: [4, 4] mounting; x right, y down, z forward.
        image_hw: Height and width of the images.
        time_s: [I] when each was taken, increasing.
        files: I images.
    """

    rawpixel_from_camera: FloatArray
    ego_from_camera: FloatArray
    image_hw: tuple[int, int]
    time_s: FloatArray
    files: Sequence[Path]


@dataclass(frozen=True)
class SweepTrack:
    """A lidar and its sweeps.

    Attributes:
        ego_from_lidar: [4, 4] mounting.
        time_s: [S] time of each, increasing.
        load: Points [P, 4 or 5] of one, by its number: metres in the lidar's frame, intensity 0 to
            255, ring.
    """

    ego_from_lidar: FloatArray
    time_s: FloatArray
    load: Callable[[int], NDArray[Any]]


@dataclass(frozen=True)
class SeenBox:
    """An object at one moment.

    Attributes:
        time_s: One of the drive's `moments_s`, or it is left out.
        instance: Its name, the same all along.
        category: Its kind.
        size_m: [3] length, width, height.
        ego_from_box: [4, 4] its centre, seen from the car at that moment; x along its length.
    """

    time_s: float
    instance: str
    category: str
    size_m: FloatArray
    ego_from_box: FloatArray


@dataclass(frozen=True)
class Drive:
    """What is known of one drive. All times have one origin, which may be any.

    Attributes:
        time_s: [P] of its poses, increasing.
        global_from_ego: [P, 4, 4] the car at these times; ego's origin is on the road under the
            middle of the rear axle, x forward, y left, z up.
        cameras: By channel.
        moments_s: Times that may become keyframes, increasing; those of the sweeps if there are
            some, else best those of a camera or of the boxes.
        sweeps: Of the lidar.
        boxes: Of objects.
    """

    time_s: FloatArray
    global_from_ego: FloatArray
    cameras: Mapping[str, CameraTrack]
    moments_s: FloatArray
    sweeps: SweepTrack | None = None
    boxes: Sequence[SeenBox] = ()


@dataclass(frozen=True)
class FoundDrive:
    """A drive that is there to be read.

    Attributes:
        name: Its scenes are called after it.
        read: Reads it.
        log: What it is a part of; parts of one log go to one split. The drive itself if not given.
        split: Where its publishers put it, if they did.
    """

    name: str
    read: Callable[[], Drive] = field(repr=False)
    log: str = ""
    split: str = ""

    @property
    def whole(self) -> str:
        """The log that it is from."""
        return self.log or self.name


def nearest(times_s: FloatArray, wanted_s: FloatArray) -> NDArray[np.int64]:
    """Which of `times_s` [T], increasing and not empty, is nearest to each of `wanted_s` [Q]."""
    after = np.clip(np.searchsorted(times_s, wanted_s), 1, max(1, len(times_s) - 1))
    before = after - 1
    after = np.minimum(after, len(times_s) - 1)
    is_before = wanted_s - times_s[before] <= times_s[after] - wanted_s
    return np.where(is_before, before, after)
