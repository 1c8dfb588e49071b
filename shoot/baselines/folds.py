"""Training scenes dealt out into folds, to choose by those left out; and their labels counted."""

from typing import Any

import numpy as np
from jaxtyping import Float, Int, Shaped

Array = np.ndarray[Any, np.dtype[Any]]

NUM_FOLDS = 5


def scene_folds(
    scene: Shaped[Array, " S"], num_folds: int = NUM_FOLDS, seed: int = 0
) -> Int[Array, " S"]:
    """Fold of each sample, such that a scene lies in one fold whole.

    Args:
        scene: Scene of each sample, any labels.
        num_folds: Number of folds; with fewer scenes, as many as there are scenes.
        seed: Seed of the order in which scenes are dealt out.
    """
    names, row = np.unique(scene, return_inverse=True)
    dealt = np.arange(len(names)) % max(1, min(num_folds, len(names)))
    fold: Array = np.random.default_rng(seed).permutation(dealt)[row]
    return fold


def label_counts(labels: Int[Array, " S"], num_templates: int) -> Float[Array, " K"]:
    """How often each template is the label.

    Raises:
        ValueError: If a label is not one of the K templates.
    """
    if len(labels) and not (labels.min() >= 0 and labels.max() < num_templates):
        raise ValueError(
            f"Labels must lie in 0..{num_templates - 1}, got {labels.min()}..{labels.max()}; "
            "were they made with other templates?"
        )
    return np.bincount(labels, minlength=num_templates).astype(np.float64)
