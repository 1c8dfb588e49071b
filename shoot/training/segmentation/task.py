"""Segmentation as a task of a run: a channel of the map for each class, trained cell by cell."""

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import torch
from jaxtyping import Float
from torch import Tensor, nn
from torch.nn import functional as F
from torchmetrics import Metric

from lss_core.config import DataConfig
from lss_core.data.drives import KnownScene
from lss_core.errors import DataError
from shoot.training.config import RunConfig
from shoot.training.loop import fit
from shoot.training.module import TaskModule
from shoot.training.segmentation.config import SegmentConfig
from shoot.training.segmentation.data import (
    SegmentBatch,
    SegmentDataset,
    SegmentSplit,
    collate_segments,
    load_segments,
)
from shoot.training.segmentation.label_frequency import mean_labels, save_frequency
from shoot.training.segmentation.running_overlap import RunningOverlap
from shoot.training.task import Best

_MARK = "segmentation_classes"
_RARE = 0.01  # how probable every class is in every cell at the start


class _Start(nn.Module):
    """Adds to each class its log-odds where the map's network says nothing.

    At first all classes are improbable. Were they as probable as not, the network would learn what
    speaks against a rare class and nothing that speaks for it: its features, none of them negative,
    all get negative weights, and no cell can then be more probable than one without features.
    """

    def __init__(self, num_classes: int) -> None:
        super().__init__()
        self.log_odds = nn.Parameter(
            torch.full((num_classes, 1, 1), math.log(_RARE / (1.0 - _RARE)))
        )

    def forward(self, maps: Float[Tensor, "B C X Y"]) -> Float[Tensor, "B C X Y"]:
        return maps + self.log_odds


class Segmentation:
    """Says of each cell and class how sure it is; see `Task` for what is asked of it.

    Paper: section 5.
    """

    name = "segmenter"
    best = Best("iou", "max")
    fitted_on: tuple[KnownScene, ...] = ()

    def __init__(self, config: SegmentConfig) -> None:
        self.classes = config.classes
        self.out_channels = len(config.classes)
        self.marks: Mapping[str, str] = {_MARK: " ".join(config.classes)}
        by_class = ", ".join(f"{name} {{val_iou_{name}:.1f}}" for name in config.classes)
        self.progress = f"validation IoU {{val_iou:.1f}} % ({by_class})"
        self._grid, self._rule, self._pos_weights = (
            config.model.grid, config.rule, config.pos_weights,
        )  # fmt: skip

    def load_split(self, data: DataConfig, split: str, with_points: bool = False) -> SegmentSplit:
        """All keyframes that can be used, with their labels."""
        return load_segments(data, split, self._grid, self.classes, self._rule, with_points)

    def dataset(
        self, split: SegmentSplit, config: RunConfig, with_points: bool = False
    ) -> SegmentDataset:
        """Their sensors and labels."""
        return SegmentDataset(split, config.data, config.seed, with_points)

    def collate(self, samples: Sequence[SegmentBatch]) -> SegmentBatch:
        """As one batch."""
        return collate_segments(samples)

    def new_head(self) -> nn.Module:
        """What each class starts from, the map's network saying nothing."""
        return _Start(self.out_channels)

    def outputs(self, head: nn.Module, maps: Float[Tensor, "B C X Y"]) -> Float[Tensor, "B C X Y"]:
        """Log-odds of each class in each cell."""
        log_odds: Tensor = head(maps.float())
        return log_odds

    def loss(
        self, head: nn.Module, maps: Float[Tensor, "B C X Y"], batch: SegmentBatch
    ) -> Float[Tensor, ""]:
        """Binary cross-entropy, mean over samples, classes and cells."""
        outputs = self.outputs(head, maps)
        # Made where the map lies: a copy to a GPU would make the host wait.
        weights = torch.stack([outputs.new_full((1, 1), one) for one in self._pos_weights])
        return F.binary_cross_entropy_with_logits(
            outputs, batch.labels.to(outputs.dtype), pos_weight=weights
        )

    def new_metrics(self) -> RunningOverlap:
        """IoU of each class in per cent, and their mean."""
        return RunningOverlap(self.classes)

    def measure(
        self, metrics: Metric, outputs: Float[Tensor, "B C X Y"], batch: SegmentBatch
    ) -> None:
        """Add where each class is more probable than not, and where it is."""
        metrics.update(outputs > 0.0, batch.labels > 0)

    def save(self, folder: Path) -> None:
        """Nothing beside config and weights."""

    def check_folder(self, folder: Path) -> None:
        """Nothing: all of it stands in the config."""

    def check_weights(self, stored: Mapping[str, Any], name: str) -> None:
        """Check that they were trained for these classes.

        Raises:
            DataError: If not.
        """
        trained_for, wanted = stored.get(_MARK), self.marks[_MARK]
        if trained_for != wanted:
            what = f"the classes {trained_for}" if trained_for else "no segmentation"
            raise DataError(f"{name} was trained for {what}, not for the classes {wanted}.")

    def save_training(self, folder: Path, split: SegmentSplit) -> None:
        """How often each cell is of each class: the baseline that sees nothing."""
        save_frequency(mean_labels(split), folder)

    def trained_on(self, folder: Path) -> tuple[KnownScene, ...]:
        """None: there are no such runs without a list of their scenes."""
        return ()


class SegmentationModule(TaskModule):
    """Sensors to log-odds of each class in each cell."""

    task: Segmentation

    def __init__(self, config: SegmentConfig) -> None:
        super().__init__(config, Segmentation(config))


def segment(config: SegmentConfig) -> Path:
    """Train a segmentation; returns the run folder. See `loop.fit`.

    Raises:
        DataError: If data, classes or the run folder are not as they should be.
        OSError: If the run folder cannot be written, as where the disk is full.
    """
    return fit(config, Segmentation(config))
