"""Samples of a run's data as inputs of the exported planner."""

from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lss_core.batch import Batch
from shoot.export.numpy_inputs import make_splat_index
from shoot.prediction.run import TrainedRun, batches
from shoot.training.planning.data import LabelledSplit


def inputs_of(card: dict[str, Any], sensors: Batch, position: int) -> dict[str, NDArray[Any]]:
    """The exported planner's inputs by name, of one sample of a batch on the host."""
    index = make_splat_index(
        card,
        sensors.pixel_from_camera[position].numpy(),
        sensors.ego_from_camera[position].numpy(),
        sensors.camera_mask[position].numpy(),
    )
    return {"images": sensors.images[position : position + 1].numpy(), "splat_index": index}


def read_inputs(
    run: TrainedRun, card: dict[str, Any], split: LabelledSplit, num: int
) -> Iterator[dict[str, NDArray[Any]]]:
    """Inputs of some samples of a split, evenly spread; all of them if there are no more.

    Raises:
        DataError: If an image is missing or damaged.
    """
    spread = np.linspace(0, len(split) - 1, min(num, len(split))).round().astype(np.int64)
    for batch in batches(run, split, spread):
        sensors = batch.sensors.to("cpu")
        for position in range(len(sensors.sample_idx)):
            yield inputs_of(card, sensors, position)
