"""The prior of those who know how fast the ego is: template frequencies by speed."""

import logging
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Bool, Float, Int, Shaped

from shoot.baselines.folds import label_counts, scene_folds
from shoot.baselines.prior import fit_prior

Array = np.ndarray[Any, np.dtype[Any]]

logger = logging.getLogger(__name__)

STANDING_MPS = 0.2
# From the most cautious on, which ties and data that decide nothing fall to.
NUM_MOVING_BINS = (1, 2, 4, 8, 16, 32, 64, 128)
STRENGTHS = (3000.0, 1000.0, 300.0, 100.0, 30.0, 10.0, 3.0, 1.0)


@dataclass(frozen=True)
class SpeedPrior:
    """Template frequencies by speed.

    Attributes:
        edges_mps: Ascending; bin i holds speeds from edge i - 1 (in) to edge i (out). The first bin
            is standing.
        log_prob: Log-probability of each template in each bin, in nats.
        log_prior: The same whatever the speed: what is said where it is not known.
        strength: Samples of a bin that the prior weighs as much as.
        held_out_nll: NLL on training scenes left out, in nats; NaN if nothing could be left out.
    """

    edges_mps: Float[Array, " E"]
    log_prob: Float[Array, "E+1 K"]
    log_prior: Float[Array, " K"]
    strength: float
    held_out_nll: float

    def of(self, speed_mps: Float[Array, " S"], is_known: Bool[Array, " S"]) -> Float[Array, "S K"]:
        """Log-probabilities at given speeds, in nats.

        Args:
            speed_mps: Speed at each sample, from past poses only.
            is_known: Where there is a past to tell it from; elsewhere the prior is returned.
        """
        by_bin = self.log_prob[np.digitize(speed_mps, self.edges_mps)]
        log_prob: Array = np.where(is_known[:, None], by_bin, self.log_prior)
        return log_prob


def fit_speed_prior(
    speed_mps: Float[Array, " S"],
    is_known: Bool[Array, " S"],
    labels: Int[Array, " S"],
    scene: Shaped[Array, " S"],
    num_templates: int,
) -> SpeedPrior:
    """Template frequencies by speed, each bin's shrunk towards those of all samples.

    Moving samples are cut into equally full bins; standing ones (below 0.2 m/s) are a bin of their
    own. A bin of n samples says (counts + strength * prior) / (n + strength). The number of bins
    and the strength are those with the smallest NLL on training scenes left out (cross-validation
    by scene); prior, edges and counts are then taken from all training samples.

    Args:
        speed_mps: Speed at each training sample, from past poses only.
        is_known: Where there is a past to tell it from; the others count for the prior alone.
        labels: Nearest template of each training sample.
        scene: Scene of each training sample.
        num_templates: K.

    Raises:
        ValueError: If there are no labels, or one is not among the K templates.
    """
    if not len(labels):
        raise ValueError("Fitting the speed prior needs at least one training label, got none.")
    log_prior = fit_prior(labels, scene, num_templates)
    nll, num_scored = np.zeros((len(NUM_MOVING_BINS), len(STRENGTHS))), 0
    fold = scene_folds(scene)
    num_folds = int(fold.max()) + 1
    for left_out in range(num_folds if num_folds > 1 else 0):
        fitted, asked = (fold != left_out) & is_known, (fold == left_out) & is_known
        prior = np.exp(fit_prior(labels[fold != left_out], scene[fold != left_out], num_templates))
        num_scored += int(asked.sum())
        for i, num_bins in enumerate(NUM_MOVING_BINS):
            edges_mps = _bin_edges(speed_mps[fitted], num_bins)
            counts = _counts(speed_mps[fitted], labels[fitted], edges_mps, num_templates)
            row = np.digitize(speed_mps[asked], edges_mps)
            at_label, in_bin = counts[row, labels[asked]], counts.sum(1)[row]
            for j, strength in enumerate(STRENGTHS):
                prob = (at_label + strength * prior[labels[asked]]) / (in_bin + strength)
                nll[i, j] -= np.log(prob).sum()
    best = np.unravel_index(int(nll.argmin()), nll.shape)
    held_out_nll = float(nll[best]) / num_scored if num_scored else float("nan")
    edges_mps = _bin_edges(speed_mps[is_known], NUM_MOVING_BINS[best[0]])
    strength = STRENGTHS[best[1]]
    logger.info(
        "Speed prior: %d bins, prior worth %g samples, NLL %.3f on training scenes left out.",
        len(edges_mps) + 1,
        strength,
        held_out_nll,
    )
    counts = _counts(speed_mps[is_known], labels[is_known], edges_mps, num_templates)
    return SpeedPrior(
        edges_mps=edges_mps,
        log_prob=np.log(
            (counts + strength * np.exp(log_prior)) / (counts.sum(1, keepdims=True) + strength)
        ),
        log_prior=log_prior,
        strength=strength,
        held_out_nll=held_out_nll,
    )


def _bin_edges(speed_mps: Float[Array, " S"], num_moving_bins: int) -> Float[Array, " E"]:
    """Where standing ends, then quantiles of what moves; equal ones once."""
    moving_mps = speed_mps[speed_mps >= STANDING_MPS]
    shares = np.arange(1, num_moving_bins) / num_moving_bins
    quantiles_mps = np.quantile(moving_mps, shares) if len(moving_mps) else np.zeros(0)
    edges_mps: Array = np.unique(np.concatenate([[STANDING_MPS], quantiles_mps]))
    return edges_mps


def _counts(
    speed_mps: Float[Array, " S"],
    labels: Int[Array, " S"],
    edges_mps: Float[Array, " E"],
    num_templates: int,
) -> Float[Array, "E+1 K"]:
    """How often each template is the label in each bin."""
    cell = np.digitize(speed_mps, edges_mps) * num_templates + labels
    num_cells = (len(edges_mps) + 1) * num_templates
    return label_counts(cell, num_cells).reshape(-1, num_templates)
