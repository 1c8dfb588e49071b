"""The prior: how often each template was driven in training."""

from typing import Any

import numpy as np
from jaxtyping import Float, Int, Shaped

from shoot.baselines.folds import label_counts, scene_folds

Array = np.ndarray[Any, np.dtype[Any]]

SMOOTHINGS = (3.0, 1.0, 0.3, 0.1, 0.03, 0.01)


def prior_log_prob(
    labels: Int[Array, " S"], num_templates: int, smoothing: float = 1.0
) -> Float[Array, " K"]:
    """Log-frequency of each template among the training labels, in nats.

    Args:
        labels: Nearest template of each training sample.
        num_templates: K.
        smoothing: Added to each count, so that a template never driven in training costs a finite
            NLL. Must be above 0.

    Raises:
        ValueError: If `smoothing` is not above 0 or a label is not one of the K templates.
    """
    if not smoothing > 0.0:
        raise ValueError(f"The prior's smoothing must be above 0, got {smoothing}.")
    counts = label_counts(labels, num_templates) + smoothing
    log_prob: Array = np.log(counts / counts.sum())
    return log_prob


def fit_prior(
    labels: Int[Array, " S"], scene: Shaped[Array, " S"], num_templates: int
) -> Float[Array, " K"]:
    """The prior with the smoothing that predicts training scenes left out best.

    Chosen by cross-validation over training scenes: a prior that is smoothed badly would make any
    model look good in NLL.

    Args:
        labels: Nearest template of each training sample.
        scene: Scene of each training sample.
        num_templates: K.

    Returns:
        Log-probabilities in nats; the same for every sample.
    """
    fold = scene_folds(scene)
    num_folds = int(fold.max()) + 1
    if num_folds < 2:
        return prior_log_prob(labels, num_templates)
    nll = [
        -sum(
            prior_log_prob(labels[fold != left_out], num_templates, smoothing)[
                labels[fold == left_out]
            ].sum()
            for left_out in range(num_folds)
        )
        for smoothing in SMOOTHINGS
    ]
    return prior_log_prob(labels, num_templates, SMOOTHINGS[int(np.argmin(nll))])
