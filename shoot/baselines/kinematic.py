"""Driving on as before, or not at all: predicted paths, and what they say of templates."""

from typing import Any

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.optimize import minimize_scalar
from scipy.special import logsumexp

Array = np.ndarray[Any, np.dtype[Any]]

# Enough to fit one number; bounds the memory of the S x K distances at K = 1000 to 32 MB.
_SIGMA_SAMPLES = 4096


def constant_yaw_rate_futures(
    velocity_mps: Float[Array, "S 2"],
    yaw_rate_radps: Float[Array, " S"],
    horizon_s: float = 5.0,
    dt_s: float = 0.25,
) -> Float[Array, "S T 2"]:
    """Where the ego would be if it kept its speed and its rate of turning.

    Args:
        velocity_mps: Velocity now in `ego`, from past poses only.
        yaw_rate_radps: Rate of turning now, positive to the left, from past poses only.
        horizon_s: Time of the last point.
        dt_s: Time of the first point, and between points.

    Returns:
        Points in metres in `ego` now; the start is none of them.
    """
    time_s = dt_s * np.arange(1, round(horizon_s / dt_s) + 1)
    turn_rad = yaw_rate_radps[:, None] * time_s
    # The integral of a turning unit vector, written so that it holds at rate 0 too.
    ahead_s = time_s * np.sinc(turn_rad / np.pi)
    aside_s = time_s * np.sin(turn_rad / 2) * np.sinc(turn_rad / (2 * np.pi))
    vx_mps, vy_mps = velocity_mps[:, 0, None], velocity_mps[:, 1, None]
    futures_m: Array = np.stack(
        [vx_mps * ahead_s - vy_mps * aside_s, vx_mps * aside_s + vy_mps * ahead_s], axis=-1
    )
    return futures_m


def constant_velocity_futures(
    velocity_mps: Float[Array, "S 2"], horizon_s: float = 5.0, dt_s: float = 0.25
) -> Float[Array, "S T 2"]:
    """Where the ego would be if it kept its velocity.

    Args:
        velocity_mps: Velocity now in `ego`, from past poses only.
        horizon_s: Time of the last point.
        dt_s: Time of the first point, and between points.

    Returns:
        Points in metres in `ego` now; the start is none of them.
    """
    return constant_yaw_rate_futures(velocity_mps, np.zeros(len(velocity_mps)), horizon_s, dt_s)


def squared_distances(
    futures: Float[Array, "S T 2"], templates: Float[Array, "K T 2"]
) -> Float[Array, "S K"]:
    """Squared L2 distance over the 2 T numbers, in square metres.

    Args:
        futures: Paths in metres in `ego`.
        templates: Templates in metres in `ego`.
    """
    paths = futures.reshape(len(futures), -1).astype(np.float64)
    banks = templates.reshape(len(templates), -1).astype(np.float64)
    # |a - b|^2 multiplied out: S x K x 2T differences would not fit in memory.
    squared_m2 = (paths**2).sum(1)[:, None] + (banks**2).sum(1) - 2.0 * (paths @ banks.T)
    nonnegative_m2: Array = np.maximum(squared_m2, 0.0)
    return nonnegative_m2


def future_log_prob(
    futures: Float[Array, "S T 2"],
    templates: Float[Array, "K T 2"],
    sigma_m: float,
    log_prior: Float[Array, " K"] | None = None,
) -> Float[Array, "S K"]:
    """Distribution over templates around a predicted path: softmax(-d^2 / (2 sigma^2)).

    Args:
        futures: Predicted paths in metres in `ego`.
        templates: Templates in metres in `ego`.
        sigma_m: Standard deviation of each of the 2 T numbers, see `fit_sigma`.
        log_prior: Log-probability of each template beforehand; None: all alike.

    Returns:
        Log-probabilities in nats.
    """
    logit = squared_distances(futures, templates) / (-2.0 * sigma_m**2)
    if log_prior is not None:
        logit += log_prior
    log_prob: Array = logit - logsumexp(logit, axis=1, keepdims=True)
    return log_prob


def fit_sigma(
    futures: Float[Array, "S T 2"],
    templates: Float[Array, "K T 2"],
    labels: Int[Array, " S"],
    log_prior: Float[Array, " K"] | None = None,
) -> float:
    """The sigma of `future_log_prob` with the smallest NLL on training samples, in metres.

    The NLL is convex in 1 / sigma^2, so a line search finds its minimum. At most 4096 samples,
    evenly spread, take part: one number needs no more.

    Args:
        futures: Predicted paths of training samples, in metres in `ego`.
        templates: Templates in metres in `ego`.
        labels: Template nearest to the path that was driven.
        log_prior: As in `future_log_prob`.

    Raises:
        ValueError: If there are no samples.
    """
    if len(futures) == 0:
        raise ValueError("Fitting sigma needs at least one training sample, got none.")
    keep = np.arange(0, len(futures), -(-len(futures) // _SIGMA_SAMPLES))
    squared_m2 = squared_distances(futures[keep], templates)
    prior = np.zeros(len(templates)) if log_prior is None else log_prior
    at_label = np.take_along_axis(squared_m2, labels[keep, None], axis=1)[:, 0]

    def mean_nll(log_sigma: float) -> float:
        scale = -0.5 * np.exp(-2.0 * log_sigma)
        logit_at_label = scale * at_label + prior[labels[keep]]
        return float((logsumexp(scale * squared_m2 + prior, axis=1) - logit_at_label).mean())

    found = minimize_scalar(mean_nll, bounds=(np.log(1e-2), np.log(1e3)), method="bounded")
    return float(np.exp(found.x))


def standing_still_log_prob(
    templates: Float[Array, "K T 2"], labels: Int[Array, " S"]
) -> Float[Array, " K"]:
    """What one would say who expects the ego to stay where it is.

    Args:
        templates: Templates in metres in `ego`.
        labels: Nearest template of each training sample; sigma is fitted to them.

    Returns:
        Log-probabilities in nats; the same for every sample.

    Raises:
        ValueError: If there are no samples.
    """
    staying = np.zeros((len(labels), *templates.shape[1:]))
    sigma_m = fit_sigma(staying, templates, labels)
    log_prob: Array = future_log_prob(staying[:1], templates, sigma_m)[0]
    return log_prob


def driving_on_log_prob(
    train_paths: Float[Array, "S T 2"],
    train_known: Bool[Array, " S"],
    train_labels: Int[Array, " S"],
    paths: Float[Array, "Q T 2"],
    known: Bool[Array, " Q"],
    templates: Float[Array, "K T 2"],
    log_prior: Float[Array, " K"],
) -> Float[Array, "Q K"]:
    """Distributions around predicted paths; the prior where there is nothing to predict from.

    Where the recording of a scene begins, no motion is known. Reading that as standing would cost
    so much NLL there that sigma would become too wide everywhere else.

    Args:
        train_paths: Predicted paths of training samples, in metres in `ego`.
        train_known: Whether their motion is known.
        train_labels: Their nearest templates; sigma is fitted to them.
        paths: Predicted paths of the samples asked about, in metres in `ego`.
        known: Whether their motion is known.
        templates: Templates in metres in `ego`.
        log_prior: Log-probability of each template where the motion is not known.

    Returns:
        Log-probabilities in nats.
    """
    log_prob = np.tile(log_prior, (len(paths), 1))
    if train_known.any():
        sigma_m = fit_sigma(train_paths[train_known], templates, train_labels[train_known])
        log_prob[known] = future_log_prob(paths[known], templates, sigma_m)
    return log_prob
