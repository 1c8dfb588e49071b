"""Samples with what is around the car: Batch, and the cells of each class."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from jaxtyping import UInt8
from numpy.typing import NDArray
from torch import Tensor
from torch.utils.data import Dataset

from lss_core.batch import Batch, collate
from lss_core.config import DataConfig
from lss_core.data.dataset import open_sensors
from lss_core.data.padding import check_padding
from lss_core.data.samples import SampleIndex, load_index, rows_of_split
from lss_core.data.usable import LeftOut, Needs, usable_rows
from lss_core.grid import BevGrid
from lss_core.labels import LabelReader
from shoot.training.split import SampleSplit


@dataclass(frozen=True)
class SegmentBatch:
    """What a network sees, and what is around the car.

    Attributes:
        sensors: Images and calibration; nothing in it knows the labels.
        labels: 1 where a cell is of a class, on the map's cells (X forward, Y left, in `ego`).
    """

    sensors: Batch
    labels: UInt8[Tensor, "*B C X Y"]

    def to(self, device: torch.device | str, non_blocking: bool = False) -> "SegmentBatch":
        """The same on another device."""
        return SegmentBatch(
            self.sensors.to(device, non_blocking),
            self.labels.to(device, non_blocking=non_blocking),
        )

    def pin_memory(self) -> "SegmentBatch":
        """The same in page-locked memory."""
        return SegmentBatch(self.sensors.pin_memory(), self.labels.pin_memory())


def collate_segments(samples: Sequence[SegmentBatch]) -> SegmentBatch:
    """Stack single samples into one batch."""
    return SegmentBatch(
        collate([sample.sensors for sample in samples]),
        torch.stack([sample.labels for sample in samples]),
    )


@dataclass(frozen=True)
class SegmentSplit(SampleSplit):
    """The keyframes of a split that have all their files; none needs a future.

    Attributes:
        index: Of the data set.
        samples: [S] their rows in the index.
        labels: Reads what is around the car at a row.
        num_unseen: Keyframes that no camera has seen.
        left_out: Keyframes that cannot be used.
    """

    index: SampleIndex
    samples: NDArray[np.int64]
    labels: LabelReader
    num_unseen: int = 0
    left_out: tuple[LeftOut, ...] = ()

    @property
    def rows(self) -> NDArray[np.int64]:
        """[S] theirs in the index."""
        return self.samples

    @property
    def num_left_out(self) -> int:
        """Keyframes that no camera has seen, and those that cannot be used."""
        return self.num_unseen + len(self.left_out)


def load_segments(
    data: DataConfig,
    split: str,
    grid: BevGrid,
    classes: tuple[str, ...],
    rule: str = "centre",
    with_points: bool = False,
) -> SegmentSplit:
    """The keyframes of a split, and their labels.

    Args:
        data: Which data set.
        split: Which scenes.
        grid: Cells of the labels.
        classes: Which labels, in this order.
        rule: Which cells are of a class, see `SegmentConfig`.
        with_points: A model that sees images needs the keyframes' sweeps, too.

    Raises:
        DataError: If the split is unknown or empty, samples cannot be used and are not to be left
            out, or what a class is made of is not there.
    """
    index = load_index(data.root, data.version, data.cameras)
    rows = rows_of_split(index, data.root, data.version, split)
    return label_segments(index, rows, data, grid, classes, rule, with_points)


def label_segments(
    index: SampleIndex,
    rows: NDArray[np.int64],
    data: DataConfig,
    grid: BevGrid,
    classes: tuple[str, ...],
    rule: str = "centre",
    with_points: bool = False,
) -> SegmentSplit:
    """Those of some samples that can be used, and their labels.

    Args:
        index: Of the data set.
        rows: Its samples, in the order of `rows_of_split`.
        data: Where it is, and whether bad samples are left out.
        grid: As for `load_segments`, and so is all that follows.
        classes: The same.
        rule: The same.
        with_points: The same.

    Raises:
        DataError: As `load_segments`.
    """
    root, needs = Path(data.root), Needs.of_planner(data.lidar_scans, with_points)
    seen = _seen(index, rows)
    usable = usable_rows(index, root, seen, data.skip_bad, needs)
    labels = LabelReader(index, root, data.version, usable.rows, grid, classes, rule)
    if needs.images:
        check_padding(index, data, usable.rows)
    num_unseen = len(rows) - len(seen)
    return SegmentSplit(index, usable.rows, labels, num_unseen, usable.left_out)


def _seen(index: SampleIndex, rows: NDArray[np.int64]) -> NDArray[np.int64]:
    """Samples with an image in the tables; all of them in data without cameras.

    So models that see lidar are trained and measured on the samples of those that see images.
    """
    has_image: NDArray[np.bool_] = index.has_camera[rows].any(axis=1)
    return rows[has_image] if has_image.any() else rows


class SegmentDataset(Dataset[SegmentBatch]):
    """Items are asked for as (position, draw), see `CameraDataset`."""

    def __init__(
        self, split: SegmentSplit, data: DataConfig, seed: int, with_points: bool = False
    ) -> None:
        self.split = split
        self.sensors = open_sensors(split.index, split.rows, data, seed, with_points)

    def __len__(self) -> int:
        return len(self.split)

    def __getitem__(self, item: tuple[int, int]) -> SegmentBatch:
        """One sample, without batch dimension."""
        labels = self.split.labels.read(int(self.split.rows[item[0]]))
        return SegmentBatch(self.sensors[item], torch.from_numpy(labels))
