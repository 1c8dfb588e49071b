"""How often each cell is of each class: what a map says that sees nothing, kept with the run."""

from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from lss_core.errors import DataError
from lss_core.files import write_atomically
from lss_core.npz import UNREADABLE, read_npz
from shoot.training.segmentation.data import SegmentSplit

Array = np.ndarray[Any, np.dtype[Any]]

FILE = "label_frequency.npz"
# Enough for a mean of cells; reading all labels of a large data set would take minutes.
_NUM_SAMPLES = 1000
_MAX_BYTES = 1 << 28


def mean_labels(split: SegmentSplit, num_samples: int = _NUM_SAMPLES) -> Float[Array, "C X Y"]:
    """Share of samples in which a cell is of a class.

    Args:
        split: Whose labels.
        num_samples: So many of them, evenly spread; all if there are fewer.
    """
    positions = np.linspace(0, len(split) - 1, min(num_samples, len(split))).round().astype(int)
    total: Array = np.zeros((), dtype=np.int64)
    for position in positions:
        total = total + split.labels.read(int(split.rows[position]))
    return (total / len(positions)).astype(np.float32)


def save_frequency(frequency: Float[Array, "C X Y"], folder: Path) -> None:
    """Write it into a run folder.

    Raises:
        OSError: If it cannot be written.
    """
    with write_atomically(folder / FILE) as stream:
        np.savez_compressed(stream, frequency=frequency)


def load_frequency(folder: Path, shape: tuple[int, int, int]) -> Float[Array, "C X Y"] | None:
    """Read what `save_frequency` wrote; None where there is no such file.

    Args:
        folder: Of the run.
        shape: Of its maps.

    Raises:
        DataError: If it cannot be read, or is of other maps.
    """
    path = folder / FILE
    if not path.exists():
        return None
    try:
        frequency = read_npz(path, _MAX_BYTES)["frequency"].astype(np.float32)
    except UNREADABLE as error:
        raise DataError(f"'{path}' cannot be read: {error}; train the run again.") from error
    # Also where it is not a number.
    if frequency.shape != shape or not ((frequency >= 0.0) & (frequency <= 1.0)).all():
        raise DataError(f"'{path}' holds no shares of cells of {shape}; train the run again.")
    return frequency
