"""What any planner stands beside: what is known without looking, and driving on as before."""

import logging
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
from jaxtyping import Float, Int, Shaped
from scipy.optimize import minimize, minimize_scalar
from scipy.sparse import csr_matrix
from scipy.special import logsumexp

from shoot.planner import Planner

Array = npt.NDArray[Any]

logger = logging.getLogger(__name__)

NUM_FOLDS = 5
SMOOTHINGS = (3.0, 1.0, 0.3, 0.1, 0.03, 0.01)
WEIGHT_DECAYS = (1.0, 3e-1, 1e-1, 3e-2, 1e-2, 3e-3, 1e-3, 3e-4, 1e-4, 3e-5, 1e-5, 3e-6, 1e-6)

# Enough to fit one number; bounds the memory of the S x K distances at K = 1000 to 32 MB.
_SIGMA_SAMPLES = 4096


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


@dataclass(frozen=True)
class BlindFit:
    """What a planner knows without looking.

    Attributes:
        log_prob: Log-probability of each template in nats; the same for every sample.
        cost_map: The learned map.
        off_grid_cost: The learned cost of a waypoint outside the map.
        weight_decay: The decay that predicted training scenes left out best.
        held_out_nll: NLL on those scenes at that decay, in nats; NaN if there was one scene only.
    """

    log_prob: Float[Array, " K"]
    cost_map: Float[Array, "X Y"]
    off_grid_cost: float
    weight_decay: float
    held_out_nll: float


class _BlindModel:
    """One cost map for all samples, read as a planner reads it; fitted to counts of labels.

    Scores are linear in the map, so they are one sparse matrix times the map, here in float64. The
    samples share their prediction, so their mean cross-entropy depends on the counts alone, and it
    is convex: with a weight decay it has one solution, whatever the start.
    """

    def __init__(self, planner: Planner) -> None:
        cells = planner.cell_idx.cpu().numpy()
        num_templates, num_reads = cells.shape
        self.shape = planner.grid.shape
        # The last column is the off-grid cost; its counts are 0 where the planner has none.
        off_grid = np.full((num_templates, 1), self.shape[0] * self.shape[1])
        shares = np.concatenate(
            [planner.weight.cpu().numpy(), planner.num_outside.cpu().numpy()[:, None]], axis=1
        )
        rows = np.repeat(np.arange(num_templates), num_reads + 1)
        columns = np.concatenate([cells, off_grid], axis=1).ravel()
        self._visited, columns = np.unique(columns, return_inverse=True)
        self._reads = csr_matrix((shares.astype(np.float64).ravel(), (rows, columns)))
        self._reads_transposed = self._reads.T.tocsr()
        self._costs = np.zeros(len(self._visited))

    def log_prob(self) -> Float[Array, " K"]:
        scores: Array = -(self._reads @ self._costs)
        return scores - float(logsumexp(scores))

    def parameters(self) -> Float[Array, " P"]:
        """Costs of all cells, row by row, and the off-grid cost; 0 where no template comes."""
        parameters = np.zeros(self.shape[0] * self.shape[1] + 1)
        parameters[self._visited] = self._costs
        return parameters

    def fit(self, counts: Float[Array, " K"], weight_decay: float, max_steps: int) -> None:
        """Minimise mean NLL + weight_decay / 2 |parameters|^2 from where the parameters are."""
        frequency = counts / counts.sum()

        def loss_and_gradient(costs: Array) -> tuple[float, Array]:
            self._costs = costs
            log_prob = self.log_prob()
            loss = -frequency @ log_prob + 0.5 * weight_decay * costs @ costs
            gradient = self._reads_transposed @ (frequency - np.exp(log_prob))
            return float(loss), gradient + weight_decay * costs

        found = minimize(
            loss_and_gradient,
            self._costs,
            jac=True,
            method="L-BFGS-B",
            options={"maxiter": max_steps, "maxcor": 20, "ftol": 1e-9, "gtol": 1e-7},
        )
        self._costs = found.x


def fit_blind(
    planner: Planner,
    labels: Int[Array, " S"],
    scene: Shaped[Array, " S"],
    max_steps: int = 500,
) -> BlindFit:
    """A planner that never looks: one learned cost map for all samples, trained with the same loss.

    It is the most that the form of the planner lets it know without its inputs. So that it is not
    overfitted, its weight decay is the one of `WEIGHT_DECAYS` with the smallest NLL on training
    scenes left out (cross-validation by scene); the map is then fitted to all training labels.

    Args:
        planner: Templates, grid and rules of reading; its learned scalars are neither used nor
            changed (the map's scale is free, so a temperature would add nothing).
        labels: Nearest template of each training sample.
        scene: Scene of each training sample.
        max_steps: Iterations for each decay; each starts where the one before ended.

    Raises:
        ValueError: If there are no labels, or one is not among the planner's templates.
    """
    if not len(labels):
        raise ValueError("Fitting the blind planner needs at least one training label, got none.")
    counts = label_counts(labels, len(planner.templates))
    fold = scene_folds(scene)
    num_folds = int(fold.max()) + 1
    model = _BlindModel(planner)
    if num_folds < 2:
        chosen, held_out_nll = len(WEIGHT_DECAYS) // 2, float("nan")
    else:
        counts_out = [label_counts(labels[fold == i], len(counts)) for i in range(num_folds)]
        models = [_BlindModel(planner) for _ in range(num_folds)]
        chosen, held_out_nll = -1, float("inf")
        for i, weight_decay in enumerate(WEIGHT_DECAYS):
            nll = 0.0
            for fold_model, left_out in zip(models, counts_out, strict=True):
                fold_model.fit(counts - left_out, weight_decay, max_steps)
                nll -= float(left_out @ fold_model.log_prob()) / len(labels)
            if nll < held_out_nll:
                chosen, held_out_nll = i, nll
            elif i > chosen + 1:
                break  # Less decay has been worse twice: from here on it overfits.
    for weight_decay in WEIGHT_DECAYS[: chosen + 1]:
        model.fit(counts, weight_decay, max_steps)
    logger.info(
        "Blind planner: weight decay %g, NLL %.3f on training scenes left out.",
        WEIGHT_DECAYS[chosen],
        held_out_nll,
    )
    parameters = model.parameters()
    return BlindFit(
        log_prob=model.log_prob(),
        cost_map=parameters[:-1].reshape(model.shape),
        off_grid_cost=float(parameters[-1]),
        weight_decay=WEIGHT_DECAYS[chosen],
        held_out_nll=held_out_nll,
    )
