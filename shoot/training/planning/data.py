"""Samples with what the driver did next: Batch, future and template label."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Float, Int
from numpy.typing import NDArray
from torch import Tensor
from torch.utils.data import Dataset

from lss_core.batch import Batch, collate
from lss_core.config import DataConfig
from lss_core.data.dataset import open_sensors
from lss_core.data.padding import check_padding
from lss_core.data.samples import SampleIndex, load_index, rows_of_split
from lss_core.data.usable import LeftOut, Needs, usable_rows, usable_scenes
from lss_core.errors import DataError
from shoot.templates import TemplateSet
from shoot.training.split import SampleSplit
from shoot.trajectories import Futures, mine_futures


@dataclass(frozen=True)
class PlanBatch:
    """What a planner sees, and what the driver did.

    Attributes:
        sensors: Images and calibration; nothing in it knows the future.
        future: Driven positions in `ego`, metres.
        template_idx: The template nearest to `future`.
    """

    sensors: Batch
    future: Float[Tensor, "*B T 2"]
    template_idx: Int[Tensor, "*B"]

    def to(self, device: torch.device | str, non_blocking: bool = False) -> "PlanBatch":
        """The same on another device."""
        return PlanBatch(
            self.sensors.to(device, non_blocking),
            self.future.to(device, non_blocking=non_blocking),
            self.template_idx.to(device, non_blocking=non_blocking),
        )

    def pin_memory(self) -> "PlanBatch":
        """The same in page-locked memory."""
        return PlanBatch(
            self.sensors.pin_memory(), self.future.pin_memory(), self.template_idx.pin_memory()
        )


def collate_plans(samples: Sequence[PlanBatch]) -> PlanBatch:
    """Stack single samples into one batch."""
    return PlanBatch(
        collate([sample.sensors for sample in samples]),
        torch.stack([sample.future for sample in samples]),
        torch.stack([sample.template_idx for sample in samples]),
    )


@dataclass(frozen=True)
class LabelledSplit(SampleSplit):
    """The keyframes of a split that have a whole future and all their files.

    Attributes:
        index: Of the data set.
        futures: Theirs; `futures.sample` are the rows.
        labels: [S] nearest templates.
        left_out: Keyframes that cannot be used.
    """

    index: SampleIndex
    futures: Futures
    labels: NDArray[np.int64]
    left_out: tuple[LeftOut, ...] = ()

    @property
    def rows(self) -> NDArray[np.int64]:
        """[S] theirs in the index."""
        return self.futures.sample

    @property
    def num_left_out(self) -> int:
        """Keyframes without a whole future, and those that cannot be used."""
        return self.futures.num_left_out


def load_split(
    data: DataConfig,
    split: str,
    templates: TemplateSet,
    need_files: bool = True,
    with_points: bool = False,
) -> LabelledSplit:
    """Mine and label the keyframes of a split.

    Args:
        data: Which data set.
        split: Which scenes.
        templates: To label with; futures have their horizon and step.
        need_files: Look at calibrations, and whether the files of images or sweeps are there.
        with_points: A camera planner needs the keyframes' sweeps, too.

    Raises:
        DataError: If the split is unknown or empty, samples cannot be used and are not to be left
            out, or no sample has a whole future.
    """
    index = load_index(data.root, data.version, data.cameras)
    rows = rows_of_split(index, data.root, data.version, split)
    needs = Needs.of_planner(data.lidar_scans, with_points) if need_files else None
    return label_rows(index, rows, data, templates, needs, f"of split '{split}' ")


def label_rows(
    index: SampleIndex,
    rows: NDArray[np.int64],
    data: DataConfig,
    templates: TemplateSet,
    needs: Needs | None,
    whose: str = "",
) -> LabelledSplit:
    """Mine and label samples.

    Args:
        index: Of the data set.
        rows: Its samples, in the order of `rows_of_split`.
        data: Where it is, and whether bad samples are left out.
        templates: To label with.
        needs: Which sensors they need; none if not given.
        whose: Words for the samples.

    Raises:
        DataError: As `load_split`.
    """
    in_scenes = usable_scenes(index, rows, data.skip_bad)
    horizon_s, dt_s = templates.horizon_s, templates.dt_s
    futures = mine_futures(index, in_scenes.rows, "keyframes", horizon_s=horizon_s, dt_s=dt_s)
    if not len(futures.sample):
        raise DataError(
            f"No sample {whose}in {Path(data.root) / data.version} has a whole future, of "
            f"{horizon_s:g} s."
        )
    left_out = in_scenes.left_out
    if needs is not None:
        usable = usable_rows(index, Path(data.root), futures.sample, data.skip_bad, needs)
        futures = futures.select(np.isin(futures.sample, usable.rows))
        left_out += usable.left_out
        if needs.images:
            check_padding(index, data, futures.sample)
    return LabelledSplit(index, futures, templates.nearest(futures.xy_m), left_out)


class PlanningDataset(Dataset[PlanBatch]):
    """Items are asked for as (position, draw), see `CameraDataset`."""

    def __init__(
        self, split: LabelledSplit, data: DataConfig, seed: int, with_points: bool = False
    ) -> None:
        self.split = split
        self.sensors = open_sensors(split.index, split.rows, data, seed, with_points)

    def __len__(self) -> int:
        return len(self.split.labels)

    def __getitem__(self, item: tuple[int, int]) -> PlanBatch:
        """One sample, without batch dimension."""
        position = item[0]
        return PlanBatch(
            self.sensors[item],
            torch.from_numpy(self.split.futures.xy_m[position]).float(),
            torch.tensor(self.split.labels[position]),
        )
