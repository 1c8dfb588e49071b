"""Run a trained segmentation over samples: checkpoint and data in, probabilities per cell out."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Float
from numpy.typing import NDArray
from torch import Tensor

from lss_core.errors import DataError
from lss_core.progress import progress
from shoot.prediction.disturbance import UNDISTURBED, Disturbance
from shoot.prediction.opening import load_module, read_batches, to_read_now
from shoot.training.run_folder import RunFolder
from shoot.training.segmentation.config import SegmentConfig
from shoot.training.segmentation.data import SegmentBatch, SegmentSplit
from shoot.training.segmentation.task import Segmentation, SegmentationModule


@dataclass(frozen=True)
class TrainedSegmenter:
    """A run ready to predict.

    Attributes:
        config: What it was told, with the data it is to read now.
        module: In evaluation mode.
        folder: Where it is.
        disturbance: What is done to its cameras before it sees them.
    """

    config: SegmentConfig
    module: SegmentationModule
    folder: RunFolder
    disturbance: Disturbance = UNDISTURBED

    @property
    def task(self) -> Segmentation:
        """What it was trained for."""
        return self.module.task

    @property
    def device(self) -> torch.device:
        """Where the module is."""
        return self.module.device


def open_segmenter(
    folder: str | Path,
    checkpoint: str = "last",
    root: str | None = None,
    version: str | None = None,
    skip_bad: bool = False,
    cameras: tuple[str, ...] | None = None,
) -> TrainedSegmenter:
    """Load a run's config and weights.

    Args:
        folder: Run folder.
        checkpoint: `last`, or `best` by mean IoU in validation.
        root: Data root, if not the one it was trained on.
        version: Version, if not the one it was trained on.
        skip_bad: Leave out samples that cannot be used, also if the run did not.
        cameras: Channels, if not those it was trained on.

    Raises:
        DataError: If something is missing or does not fit together, or it is a run of another task.
    """
    run = RunFolder(Path(folder))
    config = to_read_now(run.read_config(SegmentConfig), root, version, skip_bad, cameras)
    return TrainedSegmenter(
        config, load_module(run, checkpoint, lambda: SegmentationModule(config)), run
    )


def segment_batches(
    run: TrainedSegmenter, split: SegmentSplit, positions: NDArray[np.int64]
) -> Iterator[SegmentBatch]:
    """Batches of the samples at the given positions, in order, without augmentation."""
    return read_batches(run.task, run.config, split, positions, run.device, run.disturbance)


def predict_maps(
    run: TrainedSegmenter, split: SegmentSplit
) -> Iterator[tuple[SegmentBatch, Float[Tensor, "B C X Y"]]]:
    """Batches of all samples of a split, in order, each with the probability of class and cell.

    Args:
        run: Trained segmentation.
        split: What to predict, as `run.task.load_split` gives it.

    Raises:
        DataError: If they are not finite, or an image is missing or damaged.
    """
    with progress("Predicting samples", len(split)) as advance:
        for batch in segment_batches(run, split, np.arange(len(split))):
            # Here, not around what is yielded: that is the caller's.
            with torch.no_grad():
                prob = run.module(batch.sensors).sigmoid()
            if not prob.isfinite().all():
                raise DataError(
                    "The network gives no finite map: its training has diverged; train it with a "
                    "lower --optim.learning-rate."
                )
            yield batch, prob
            advance(len(prob))
