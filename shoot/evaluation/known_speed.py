"""What a planner would say if it were told the speed that its cameras do not show."""

from typing import Any

import numpy as np
from jaxtyping import Float
from scipy.special import logsumexp

Array = np.ndarray[Any, np.dtype[Any]]


def tell_speed(
    log_prob: Float[Array, "S K"],
    log_speed_prior: Float[Array, "S K"],
    log_prior: Float[Array, " K"],
) -> Float[Array, "S K"]:
    """A planner's distributions after it was told the speed.

    p(template | image, speed) is proportional to p(template | image) p(template | speed) /
    p(template). This is Bayes' rule if, given the template that will be driven, image and speed say
    nothing more of each other; they do share some of what they know (that the ego stands, for one),
    so it is a simple answer, not the best. It is no baseline: it uses the planner, and tells how
    much of what the planner misses is speed.

    Args:
        log_prob: Of the planner, in nats.
        log_speed_prior: Of `SpeedPrior` at each sample, in nats. Where it is the prior, because the
            speed is not known, the planner's distribution stays.
        log_prior: The prior that the speed prior was shrunk towards, in nats.

    Returns:
        Log-probabilities in nats.
    """
    logit = log_prob + (log_speed_prior - log_prior)
    told: Array = logit - logsumexp(logit, axis=1, keepdims=True)
    return told
