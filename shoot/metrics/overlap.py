"""How maps of probabilities meet maps of truth, cell by cell: IoU, thresholds, average precision.

Cells are counted by their probability, in bins. All that follows is read off the counts, and counts
of scenes add up: no more of a map is kept than where its probabilities lie.
"""

from typing import Any

import numpy as np
from jaxtyping import Float, Int, Shaped, UInt8
from numpy.typing import ArrayLike

Array = np.ndarray[Any, np.dtype[Any]]

# A power of two, so that also float32 finds the bin exactly, and 0.5 is an edge.
NUM_BINS = 1024
# From here on a cell is said to be of the class.
THRESHOLD = 0.5


def count_by_probability(
    prob: Float[Array, "*S"], truth: UInt8[Array, "*S"], num_bins: int = NUM_BINS
) -> Int[Array, "J 2"]:
    """Cells in each bin of probability, those not of the class (0) and those of it (1) apart.

    A bin owns its lower edge and not its upper one; the last one owns both.

    Args:
        prob: Probability of each cell, 0 to 1.
        truth: 1 where the cell is of the class, else 0.
        num_bins: Number of bins of equal width.
    """
    bins = np.minimum((prob * num_bins).astype(np.int64), num_bins - 1)
    counts: Array = np.bincount((2 * bins + truth).ravel(), minlength=2 * num_bins)
    return counts.reshape(num_bins, 2)


def count_overlap(counts: Shaped[Array, "*S J 2"]) -> Shaped[Array, "*S 3"]:
    """True positives, false positives and false negatives, where `THRESHOLD` or more is positive.

    Args:
        counts: As `count_by_probability` gives them; an even number of bins.
    """
    half = round(THRESHOLD * counts.shape[-2])
    said, not_said = counts[..., half:, :].sum(axis=-2), counts[..., :half, :].sum(axis=-2)
    overlap: Array = np.stack([said[..., 1], said[..., 0], not_said[..., 1]], axis=-1)
    return overlap


def iou(overlap: Shaped[Array, "*S 3"]) -> Float[Array, "*S"]:
    """Intersection over union in per cent: one of sums, no mean of many.

    Args:
        overlap: Sums of `count_overlap`.

    Returns:
        NaN where no cell is said or true.
    """
    return _per_cent(overlap[..., 0], overlap.sum(axis=-1))


def iou_by_threshold(counts: Shaped[Array, "*S J 2"]) -> Float[Array, "*S J"]:
    """IoU in per cent if a cell is said from the lower edge of bin j on, for each j."""
    said = _from_bin_on(counts)
    return _per_cent(said[..., 1], said[..., 0] + counts[..., 1].sum(axis=-1, keepdims=True))


def best_threshold(counts: Shaped[Array, "J 2"]) -> float:
    """The threshold with the highest IoU; the lowest of equal ones, NaN if no cell is true.

    It is chosen where it is scored, so its IoU is what a better calibrated map could reach.
    """
    if not counts[:, 1].any():
        return float("nan")
    return int(np.nanargmax(iou_by_threshold(counts))) / len(counts)


def iou_at_best(counts: Shaped[Array, "*S J 2"]) -> Float[Array, "*S"]:
    """IoU in per cent at the threshold that is best for each; NaN if no cell is true."""
    # Everything said is one of the thresholds: where a cell is true, no union is empty.
    known = counts[..., 1].sum(axis=-1) > 0
    highest = np.nan_to_num(iou_by_threshold(counts)).max(axis=-1)
    return np.asarray(np.where(known, highest, np.nan))


def average_precision(counts: Shaped[Array, "*S J 2"]) -> Float[Array, "*S"]:
    """Area under precision over recall in per cent, as steps; cells of one bin are ties.

    Of a map that says nothing of the class it is the share of true cells.

    Returns:
        NaN if no cell is true.
    """
    said = _from_bin_on(counts)
    all_said = said.sum(axis=-1)
    precision = said[..., 1] / np.maximum(all_said, 1)
    return _per_cent((counts[..., 1] * precision).sum(axis=-1), counts[..., 1].sum(axis=-1))


def share_true(counts: Shaped[Array, "*S J 2"]) -> Float[Array, "*S"]:
    """True cells in per cent of all: the IoU of saying every cell."""
    return _per_cent(counts[..., 1].sum(axis=-1), counts.sum(axis=(-2, -1)))


def _from_bin_on(counts: Shaped[Array, "*S J 2"]) -> Shaped[Array, "*S J 2"]:
    """Cells in bin j and all above."""
    summed: Array = counts[..., ::-1, :].cumsum(axis=-2)[..., ::-1, :]
    return summed


def _per_cent(part: ArrayLike, whole: ArrayLike) -> Array:
    # Sums over all axes come as numbers, not as arrays.
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.asarray(100.0 * np.asarray(part, dtype=np.float64) / whole)
