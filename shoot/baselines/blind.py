"""The blind planner: what the form of the planner lets it know without looking."""

import logging
import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float, Int, Shaped
from scipy.optimize import minimize
from scipy.sparse import csr_matrix
from scipy.special import logsumexp

from shoot.baselines.folds import label_counts, scene_folds
from shoot.planner import Planner

Array = np.ndarray[Any, np.dtype[Any]]

logger = logging.getLogger(__name__)

WEIGHT_DECAYS = (1.0, 3e-1, 1e-1, 3e-2, 1e-2, 3e-3, 1e-3, 3e-4, 1e-4, 3e-5, 1e-5, 3e-6, 1e-6)


@dataclass(frozen=True)
class BlindFit:
    """What a planner knows without looking.

    Attributes:
        log_prob: Log-probability of each template in nats; the same for every sample.
        cost_map: The learned map, or of a cost volume T of them.
        off_grid_cost: The learned cost of a waypoint outside the map.
        weight_decay: The decay that predicted training scenes left out best.
        held_out_nll: NLL on those scenes at that decay, in nats; NaN if there was one scene only.
    """

    log_prob: Float[Array, " K"]
    cost_map: Float[Array, "*C X Y"]
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
        volume = (planner.num_maps, *planner.grid.shape)
        self.shape = volume if planner.num_maps > 1 else planner.grid.shape
        # The last column is the off-grid cost; its counts are 0 where the planner has none.
        off_grid = np.full((num_templates, 1), math.prod(self.shape))
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
        parameters = np.zeros(math.prod(self.shape) + 1)
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
