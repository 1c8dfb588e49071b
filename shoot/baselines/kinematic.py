"""Driving on as before, or not at all: predicted paths, and what they say of templates."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.optimize import minimize
from scipy.special import logsumexp

Array = np.ndarray[Any, np.dtype[Any]]

# Enough to fit two numbers; bounds the memory of the S x K distances at K = 1000 to 8 MB.
_SPREAD_SAMPLES = 1024
_SPREAD_BOUNDS_M = (1e-3, 1e4)


@dataclass(frozen=True)
class Spread:
    """How far driven paths stray from predicted ones: further the later it is.

    What a prediction from motion alone cannot know, an acceleration, grows with time squared. A
    free power of time is worse than that: it may grow until the first points alone count.

    Attributes:
        always_m: Standard deviation of x and of y at any time, in metres.
        grown_m: What is added to it at the last point, in metres; before, with time squared.
    """

    always_m: float
    grown_m: float

    def sigma_m(self, num_points: int) -> Float[Array, " T"]:
        """Standard deviation of x and of y at each of evenly spaced points, in metres."""
        share = np.arange(1, num_points + 1) / num_points
        sigma_m: Array = self.always_m + self.grown_m * share**2
        return sigma_m


def along_heading(velocity_mps: Float[Array, "S 2"]) -> Float[Array, "S 2"]:
    """The velocity turned to where the ego heads now, the x axis of `ego`; backwards if it backs.

    A velocity measured over a past while points to where the ego headed in the middle of it: in a
    bend it lags behind.

    Args:
        velocity_mps: Mean velocity over the time just past, in `ego` now.
    """
    speed_mps = np.copysign(np.linalg.norm(velocity_mps, axis=1), velocity_mps[:, 0])
    turned_mps: Array = np.stack([speed_mps, np.zeros_like(speed_mps)], axis=-1)
    return turned_mps


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
    """Squared L2 distance over the 2 T numbers, in the square of their unit.

    Args:
        futures: Paths in `ego`.
        templates: Templates in `ego`, in the same unit.
    """
    paths = futures.reshape(len(futures), -1).astype(np.float64)
    banks = templates.reshape(len(templates), -1).astype(np.float64)
    # |a - b|^2 multiplied out: S x K x 2T differences would not fit in memory.
    squared = (paths**2).sum(1)[:, None] + (banks**2).sum(1) - 2.0 * (paths @ banks.T)
    nonnegative: Array = np.maximum(squared, 0.0)
    return nonnegative


def future_log_prob(
    futures: Float[Array, "S T 2"],
    templates: Float[Array, "K T 2"],
    spread: Spread,
    log_prior: Float[Array, " K"] | None = None,
) -> Float[Array, "S K"]:
    """Distribution over templates around a predicted path: softmax(log prior - d^2 / 2).

    d^2 is the sum over points of their squared distances in units of `spread` at their times.

    Args:
        futures: Predicted paths in metres in `ego`.
        templates: Templates in metres in `ego`.
        spread: Of the driven path around the predicted one, see `fit_spread`.
        log_prior: Log-probability of each template beforehand; None: all alike.

    Returns:
        Log-probabilities in nats.
    """
    sigma_m = spread.sigma_m(templates.shape[1])[:, None]
    logit = -0.5 * squared_distances(futures / sigma_m, templates / sigma_m)
    if log_prior is not None:
        logit += log_prior
    log_prob: Array = logit - logsumexp(logit, axis=1, keepdims=True)
    return log_prob


def fit_spread(
    futures: Float[Array, "S T 2"],
    templates: Float[Array, "K T 2"],
    labels: Int[Array, " S"],
    log_prior: Float[Array, " K"] | None = None,
) -> Spread:
    """The spread for `future_log_prob` with the smallest NLL on training samples.

    At most 1024 samples, evenly spread, take part: two numbers need no more.

    Args:
        futures: Predicted paths of training samples, in metres in `ego`.
        templates: Templates in metres in `ego`.
        labels: Template nearest to the path that was driven.
        log_prior: As in `future_log_prob`.

    Raises:
        ValueError: If there are no samples.
    """
    if len(futures) == 0:
        raise ValueError("Fitting a spread needs at least one training sample, got none.")
    keep = np.arange(0, len(futures), -(-len(futures) // _SPREAD_SAMPLES))
    paths, driven = futures[keep], labels[keep, None]

    def mean_nll(parameters: Float[Array, "2"]) -> float:
        spread = Spread(*np.exp(parameters).tolist())
        log_prob = future_log_prob(paths, templates, spread, log_prior)
        return -float(np.take_along_axis(log_prob, driven, axis=1).mean())

    start, bounds = np.log([1.0, 10.0]), 2 * [np.log(_SPREAD_BOUNDS_M)]
    found = minimize(mean_nll, start, method="L-BFGS-B", bounds=bounds)
    return Spread(*np.exp(found.x).tolist())


def standing_still_log_prob(
    templates: Float[Array, "K T 2"], labels: Int[Array, " S"]
) -> Float[Array, " K"]:
    """What one would say who expects the ego to stay where it is.

    Args:
        templates: Templates in metres in `ego`.
        labels: Nearest template of each training sample; the spread is fitted to them.

    Returns:
        Log-probabilities in nats; the same for every sample.

    Raises:
        ValueError: If there are no samples.
    """
    staying = np.zeros((len(labels), *templates.shape[1:]))
    spread = fit_spread(staying, templates, labels)
    log_prob: Array = future_log_prob(staying[:1], templates, spread)[0]
    return log_prob


def driving_on_log_prob(
    train_paths: Float[Array, "S T 2"],
    train_known: Bool[Array, " S"],
    train_labels: Int[Array, " S"],
    paths: Float[Array, "Q T 2"],
    known: Bool[Array, " Q"],
    templates: Float[Array, "K T 2"],
    log_prior: Float[Array, " K"],
    with_prior: bool = False,
) -> Float[Array, "Q K"]:
    """Distributions around predicted paths; the prior where there is nothing to predict from.

    Where the recording of a scene begins, no motion is known. Reading that as standing would cost
    so much NLL there that the spread would become too wide everywhere else.

    Args:
        train_paths: Predicted paths of training samples, in metres in `ego`.
        train_known: Whether their motion is known.
        train_labels: Their nearest templates; the spread is fitted to them.
        paths: Predicted paths of the samples asked about, in metres in `ego`.
        known: Whether their motion is known.
        templates: Templates in metres in `ego`.
        log_prior: Log-probability of each template where the motion is not known.
        with_prior: Weigh templates by the prior elsewhere, too; else all are alike there.

    Returns:
        Log-probabilities in nats.
    """
    log_prob = np.tile(log_prior, (len(paths), 1))
    if train_known.any():
        prior = log_prior if with_prior else None
        spread = fit_spread(train_paths[train_known], templates, train_labels[train_known], prior)
        log_prob[known] = future_log_prob(paths[known], templates, spread, prior)
    return log_prob
