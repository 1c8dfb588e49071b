"""What is learned from sensors through a map: all that loop, data and run folder know of it."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Literal, NamedTuple, Protocol, TypeVar, runtime_checkable

import torch
from jaxtyping import Float
from torch import Tensor, nn
from torch.utils.data import Dataset
from torchmetrics import Metric

from lss_core.batch import Batch
from lss_core.config import DataConfig
from lss_core.data.drives import KnownScene
from shoot.training.config import RunConfig
from shoot.training.split import SampleSplit


class Best(NamedTuple):
    """Which checkpoint of a run is its best.

    Attributes:
        metric: Name of a validation metric.
        mode: Whether more of it is better, or less.
    """

    metric: str
    mode: Literal["max", "min"]


@runtime_checkable
class TaskBatch(Protocol):
    """Sensors, with the targets of a task beside them: the sensors do not know them."""

    @property
    def sensors(self) -> Batch:
        """What the network sees."""
        ...

    def to(self, device: torch.device | str, non_blocking: bool = False) -> "TaskBatch":
        """The same on another device."""
        ...


SplitT = TypeVar("SplitT", bound=SampleSplit)
BatchT = TypeVar("BatchT", bound=TaskBatch)


@runtime_checkable
class Task(Protocol[SplitT, BatchT]):
    """A task of a run.

    Attributes:
        name: Under which its own weights stand beside those of the map's network.
        out_channels: Of the map.
        best: Which checkpoint is kept as the best.
        progress: A line about a validation, with the names of metrics in braces.
        marks: What weights are worth nothing without, by name; kept with them.
        fitted_on: Scenes that something of it was fitted on beforehand, as far as they are known.
    """

    name: str
    out_channels: int
    best: Best
    progress: str
    marks: Mapping[str, str]
    fitted_on: tuple[KnownScene, ...]

    # What a sample's target is

    def load_split(self, data: DataConfig, split: str, with_points: bool = False) -> SplitT:
        """The samples of a split that have a target; keyframes' sweeps with them if asked for."""
        ...

    def dataset(self, split: SplitT, config: RunConfig, with_points: bool) -> Dataset[BatchT]:
        """Single samples; items are asked for as (position, draw), see `CameraDataset`."""
        ...

    def collate(self, samples: Sequence[BatchT]) -> BatchT:
        """Single samples as one batch."""
        ...

    # What is learned

    def new_head(self) -> nn.Module:
        """Its own weights at their start, made after the run's seed is set; may have none."""
        ...

    def outputs(self, head: nn.Module, maps: Float[Tensor, "B C X Y"]) -> Tensor:
        """What the task reads off the map with its weights, first dimension B."""
        ...

    def loss(
        self, head: nn.Module, maps: Float[Tensor, "B C X Y"], batch: BatchT
    ) -> Float[Tensor, ""]:
        """What training lowers, of the map and its weights."""
        ...

    def new_metrics(self) -> Metric:
        """Running metrics of a validation; `compute` gives numbers by name."""
        ...

    def measure(self, metrics: Metric, outputs: Tensor, batch: BatchT) -> None:
        """Add a batch to running metrics."""
        ...

    # What a run folder keeps

    def save(self, folder: Path) -> None:
        """Write what the run needs beside config and weights."""
        ...

    def check_folder(self, folder: Path) -> None:
        """Check that a run in the folder was begun with the same.

        Raises:
            DataError: If not.
        """
        ...

    def check_weights(self, stored: Mapping[str, Any], name: str) -> None:
        """Check that weights were trained for this; `stored` has their marks, `name` is theirs.

        Raises:
            DataError: If not.
        """
        ...

    def save_training(self, folder: Path, split: SplitT) -> None:
        """Write what later comparisons need of the samples trained on."""
        ...

    def trained_on(self, folder: Path) -> tuple[KnownScene, ...]:
        """Scenes that a run of before there were lists of them was trained on; none if unknown."""
        ...
