"""Annotated boxes at the times of the samples' paths, where the samples' ego frames see them."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Bool, Float, Int

from lss_core.data.annotations.boxes import Boxes
from lss_core.data.samples import TIME_TOLERANCE_S
from lss_core.geometry import FloatArray
from shoot.footprint import (
    EGO_LENGTH_M,
    EGO_WIDTH_M,
    footprint_centres,
    rectangles_overlap,
    turn,
)

Array = np.ndarray[Any, np.dtype[Any]]

_EGO_SIZE_M = np.array([EGO_LENGTH_M, EGO_WIDTH_M], dtype=np.float32)


@dataclass(frozen=True)
class BoxMoments:
    """M moments of boxes, each at one time of one sample's path.

    Attributes:
        sample: Position of the sample among the S samples.
        step: Which of the T times of its path.
        box: Row of the object in its `Boxes`.
        xy_m: Centre in the sample's `ego`.
        yaw_rad: Heading in the sample's `ego`.
        size_m: Length and width.
    """

    sample: Int[Array, " M"]
    step: Int[Array, " M"]
    box: Int[Array, " M"]
    xy_m: Float[Array, "M 2"]
    yaw_rad: Float[Array, " M"]
    size_m: Float[Array, "M 2"]

    def select(self, kept: Bool[Array, " M"]) -> "BoxMoments":
        """Only some of them."""
        return BoxMoments(
            self.sample[kept],
            self.step[kept],
            self.box[kept],
            self.xy_m[kept],
            self.yaw_rad[kept],
            self.size_m[kept],
        )


def find_moments(
    boxes: Boxes,
    scene: Int[Array, " S"],
    time_s: Float[Array, " S"],
    xy_m: Float[Array, "S 2"],
    yaw_rad: Float[Array, " S"],
    ahead_s: Float[Array, " T"],
) -> BoxMoments:
    """All boxes of the samples' scenes at some times after the samples.

    Between two annotations of an object its position is interpolated linearly, its heading along
    the shorter way. Before the first and after the last annotation it is not there.

    Args:
        boxes: Of the scenes.
        scene: Row of each sample's scene in the index.
        time_s: Of the samples' ego frames.
        xy_m: Their origin in `global`.
        yaw_rad: Their heading in `global`.
        ahead_s: Times after the sample.
    """
    parts = [_no_moments()]
    for number in np.unique(scene).tolist():
        own = np.flatnonzero(scene == number)
        for box in boxes.of_scene(number):
            track = boxes.track(box)
            # Subtracting first keeps microseconds exact.
            known_s = boxes.time_s[track] - boxes.time_s[track][0]
            asked_s = (time_s[own] - boxes.time_s[track][0])[:, None] + ahead_s
            there = (asked_s >= -TIME_TOLERANCE_S) & (asked_s <= known_s[-1] + TIME_TOLERANCE_S)
            row, step = np.nonzero(there)
            sample, at_s = own[row], asked_s[row, step]
            pose = _interpolate(known_s, boxes.xy_m[track], boxes.yaw_rad[track], at_s)
            centre_m = turn(pose[:, :2] - xy_m[sample], -yaw_rad[sample])
            parts.append(
                BoxMoments(
                    sample.astype(np.int32),
                    step.astype(np.int32),
                    np.full(len(row), box, dtype=np.int32),
                    centre_m.astype(np.float32),
                    (pose[:, 2] - yaw_rad[sample]).astype(np.float32),
                    np.tile(boxes.size_m[box].astype(np.float32), (len(row), 1)),
                )
            )
    return BoxMoments(
        sample=np.concatenate([part.sample for part in parts]),
        step=np.concatenate([part.step for part in parts]),
        box=np.concatenate([part.box for part in parts]),
        xy_m=np.concatenate([part.xy_m for part in parts]),
        yaw_rad=np.concatenate([part.yaw_rad for part in parts]),
        size_m=np.concatenate([part.size_m for part in parts]),
    )


def touched(
    moments: BoxMoments, paths_m: Float[Array, "S T 2"], heading_rad: Float[Array, "S T"]
) -> Bool[Array, " M"]:
    """At which moments the ego's footprint overlaps the box.

    Args:
        moments: Of S samples and T times.
        paths_m: One path for each sample, in metres in its `ego`.
        heading_rad: Where the car points on it, see `headings`.
    """
    centres_m = footprint_centres(paths_m, heading_rad).astype(np.float32)
    between_m = moments.xy_m - centres_m[moments.sample, moments.step]
    # Most boxes are farther than their circle and the ego's reach.
    reach_m = (np.hypot(*_EGO_SIZE_M) + np.hypot(*moments.size_m.T)) / 2
    near = np.flatnonzero((between_m**2).sum(-1) < reach_m**2)
    hit = np.zeros(len(moments.sample), dtype=bool)
    hit[near] = rectangles_overlap(
        np.zeros(2, dtype=np.float32),
        heading_rad[moments.sample[near], moments.step[near]],
        _EGO_SIZE_M,
        between_m[near],
        moments.yaw_rad[near],
        moments.size_m[near],
    )
    return hit


def _interpolate(
    known_s: FloatArray, xy_m: FloatArray, yaw_rad: FloatArray, at_s: FloatArray
) -> FloatArray:
    """[Q, 3] x, y and heading."""
    columns = (xy_m[:, 0], xy_m[:, 1], np.unwrap(yaw_rad))
    return np.stack([np.interp(at_s, known_s, column) for column in columns], axis=-1)


def _no_moments() -> BoxMoments:
    whole, numbers = np.zeros(0, dtype=np.int32), np.zeros(0, dtype=np.float32)
    return BoxMoments(whole, whole, whole, numbers.reshape(0, 2), numbers, numbers.reshape(0, 2))
