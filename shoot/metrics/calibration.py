"""Whether probabilities mean what they say: Brier score, calibration error, reliability."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float, Int

Array = np.ndarray[Any, np.dtype[Any]]

NUM_BINS = 10


@dataclass(frozen=True)
class Reliability:
    """How often the top template is the label, by how probable it was said to be.

    Attributes:
        confidence: Mean probability of the top template over the samples of each bin, ascending.
        accuracy: Share of the bin's samples where the top template is the label.
        count: Samples of the bin.
    """

    confidence: Float[Array, " J"]
    accuracy: Float[Array, " J"]
    count: Int[Array, " J"]

    def to_json(self) -> dict[str, list[float]]:
        """Plain lists."""
        return {
            "confidence": self.confidence.tolist(),
            "accuracy": self.accuracy.tolist(),
            "count": self.count.tolist(),
        }


def brier_score(prob: Float[Array, "R K"], label: Int[Array, " S"]) -> Float[Array, " S"]:
    """Squared distance of each distribution from the one that is sure of the label: 0 to 2.

    The sum over all K templates, as Brier has it, not its mean and not the label's term alone. It
    is small only for a planner that is sure of one template: with K near-duplicates it says little
    beside NLL.

    Args:
        prob: Probabilities of the templates; R is S, or 1 where they are the same for all samples.
        label: Index of the template nearest to the driven path.

    Raises:
        ValueError: If there are other numbers of rows, or a label that is none.
    """
    if len(prob) not in (1, len(label)):
        raise ValueError(f"There must be 1 or {len(label)} rows of probabilities, got {len(prob)}.")
    if label.size and not 0 <= label.min() <= label.max() < prob.shape[1]:
        raise ValueError(f"Labels must lie in 0..{prob.shape[1] - 1}, got others.")
    every = np.broadcast_to(prob, (len(label), prob.shape[1]))
    at_label = np.take_along_axis(every, label[:, None], axis=1)[:, 0].astype(np.float64)
    # Squared in float64: the squares of one certain and many small probabilities nearly cancel.
    squares = np.square(prob, dtype=np.float64).sum(axis=1)
    score: Array = np.square(1.0 - at_label) + (squares - np.square(at_label))
    return score


def equal_mass_bins(confidence: Float[Array, " S"], num_bins: int = NUM_BINS) -> Int[Array, " S"]:
    """Bin of each sample, such that bins hold about the same number of samples.

    Bins are numbered from 0 by ascending confidence. Equal confidences are never parted, so that
    the order of samples does not matter: with ties, bins differ in size and there may be fewer of
    them, down to one for a method that is equally sure of all samples. With fewer samples than
    bins each sample has its own.

    Args:
        confidence: Probability of the top template.
        num_bins: Number of bins wanted.

    Raises:
        ValueError: If `num_bins` is below 1.
    """
    if num_bins < 1:
        raise ValueError(f"The number of bins must be at least 1, got {num_bins}.")
    ordered = np.sort(confidence)
    lower_edges = ordered[np.arange(num_bins) * len(ordered) // num_bins]
    above = np.searchsorted(lower_edges, confidence, side="right")
    bins: Array = np.unique(above, return_inverse=True)[1]
    return bins


def measure_reliability(
    confidence: Float[Array, " S"], hit: Float[Array, " S"], num_bins: int = NUM_BINS
) -> Reliability:
    """Confidence beside accuracy, in bins of equal mass.

    Args:
        confidence: Probability of the top template of each sample.
        hit: 1 where that template is the label, else 0; a share where several are as probable.
        num_bins: Number of bins; fewer where confidences are equal or samples few, see
            `equal_mass_bins`.
    """
    bins = equal_mass_bins(confidence, num_bins)
    count = np.bincount(bins)
    return Reliability(
        confidence=np.bincount(bins, weights=confidence) / count,
        accuracy=np.bincount(bins, weights=hit) / count,
        count=count,
    )


def calibration_terms(
    confidence: Float[Array, " S"], hit: Float[Array, " S"], num_bins: int = NUM_BINS
) -> Float[Array, "S J"]:
    """What `calibration_error` needs of each sample; sum it over the samples.

    The bins are fixed here, from these samples, and not made anew for each draw of scenes.

    Args:
        confidence: Probability of the top template of each sample.
        hit: 1 where that template is the label, else 0; a share where several are as probable.
        num_bins: Number of bins, see `equal_mass_bins`.

    Returns:
        Hit minus confidence in the column of the sample's bin, 0 in the others'; 1 in the last
        column, which counts samples.
    """
    bins = equal_mass_bins(confidence, num_bins)
    terms = np.zeros((len(bins), bins.max() + 2))
    terms[np.arange(len(bins)), bins] = hit - confidence.astype(np.float64)
    terms[:, -1] = 1.0
    return terms


def calibration_error(sums: Float[Array, "D J"]) -> Float[Array, " D"]:
    """Expected calibration error of the top template (ECE), in per cent.

    The mean over samples of |accuracy - confidence| of their bin. Noise makes it larger, never
    smaller: with n samples a bin, a perfectly calibrated planner still shows some 40 / sqrt(n) per
    cent.

    Args:
        sums: Sums of `calibration_terms` over samples, one row for each draw of them.
    """
    error: Array = 100.0 * np.abs(sums[:, :-1]).sum(axis=1) / sums[:, -1]
    return error
