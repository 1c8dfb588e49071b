"""Which template is driven, of a distribution over them."""

from typing import Any, Literal

import numpy as np
from jaxtyping import Float

Array = np.ndarray[Any, np.dtype[Any]]
Choose = Literal["most_probable", "expected"]


def mean_distances(templates: Float[Array, "K T 2"]) -> Float[Array, "K K"]:
    """Distance between each two templates in metres, mean over their points."""
    points_m = templates.astype(np.float64)
    total_m = np.zeros((len(points_m), len(points_m)))
    for t in range(points_m.shape[1]):
        x, y = points_m[:, t, 0], points_m[:, t, 1]
        total_m += np.hypot(x[:, None] - x, y[:, None] - y)
    return total_m / points_m.shape[1]


def most_probable(log_prob: Float[Array, " K"]) -> int:
    """The first of the most probable templates."""
    return int(np.argmax(log_prob))


def least_far(log_prob: Float[Array, " K"], distance_m: Float[Array, "K K"]) -> int:
    """The template least far on average from one drawn from the distribution.

    Args:
        log_prob: In nats; templates of -inf are not chosen.
        distance_m: Between each two, see `mean_distances`.
    """
    far_m = distance_m @ np.exp(log_prob.astype(np.float64))
    return int(np.argmin(np.where(np.isfinite(log_prob), far_m, np.inf)))
