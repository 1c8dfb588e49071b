"""How good ranked templates are: whether the label is near the top, and how many metres off."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from jaxtyping import Float, Int
from torch import Tensor
from torchmetrics import Metric

Array = np.ndarray[Any, np.dtype[Any]]
# Metric name to one value per sample, in the unit of the report; NaN where it does not apply.
PerSample = dict[str, Array]

TOP_KS = (1, 5, 10, 20)
MISS_M = 2.0

# Rows sorted at once: keeps the sort's 8-byte indices for K = 1000 below 10 MB.
_ROWS = 1024


@dataclass(frozen=True)
class TemplateErrors:
    """Distances from a driven path to its templates, best-ranked first.

    Attributes:
        mean_m: Mean distance over the T points (average displacement error).
        final_m: Distance at the last point (final displacement error).
        max_m: Largest distance over the T points.
    """

    mean_m: Float[Array, "S J"]
    final_m: Float[Array, "S J"]
    max_m: Float[Array, "S J"]


@dataclass(frozen=True)
class LabelRanks:
    """Where the label of each sample stands among the templates.

    Attributes:
        num_before: Templates ranked before it for sure; 0 is best.
        num_tied: Templates with its log-probability, itself included; 0 where that is no number.
    """

    num_before: Int[Array, " S"]
    num_tied: Int[Array, " S"]

    def hits(self, k: int) -> Float[Array, " S"]:
        """Probability that the label is among the first k if those tied are shuffled: 0 to 1.

        Templates are ordered by frequency, so an order by index would give a planner that says
        nothing the accuracy of the prior. This way it has k / K.

        Raises:
            ValueError: If `k` is below 1.
        """
        _check_k(k)
        share = np.clip((k - self.num_before) / np.maximum(self.num_tied, 1), 0.0, 1.0)
        hit: Array = share * (self.num_tied > 0)
        return hit


def rank_labels(log_prob: Float[Array, "S K"], label: Int[Array, " S"]) -> LabelRanks:
    """How many templates are ranked before the label, and how many tie with it.

    A value that is not a number counts against the model: such a template stands before the label,
    such a label behind all K.

    Args:
        log_prob: Any monotone score per template; high is good.
        label: Index of the template nearest to the driven path.

    Raises:
        ValueError: If there is not one label in 0..K-1 for each sample.
    """
    check_labels(label, log_prob.shape)
    at_label = np.take_along_axis(log_prob, label[:, None], axis=1)
    num_tied = (log_prob == at_label).sum(axis=1)
    # Counting those behind, not those before, keeps a diverged (NaN) model from ranking first.
    num_behind = (log_prob < at_label).sum(axis=1)
    return LabelRanks(log_prob.shape[1] - num_behind - num_tied, num_tied)


def check_labels(label: Int[Array, "..."], shape: tuple[int, ...]) -> None:
    """Check that labels are those of [S, K] values: one in 0..K-1 for each sample.

    Raises:
        ValueError: If not.
    """
    num_samples, num_templates = shape
    if label.shape != (num_samples,) or not np.issubdtype(label.dtype, np.integer):
        raise ValueError(
            f"There must be one whole label for each of {num_samples} samples, got {label.dtype} "
            f"{list(label.shape)}."
        )
    if label.size and not 0 <= label.min() <= label.max() < num_templates:
        raise ValueError(
            f"Labels must lie in 0..{num_templates - 1}, got {label.min()} to {label.max()}."
        )


def _check_k(k: int) -> None:
    if k < 1:
        raise ValueError(f"The number of best-ranked templates must be at least 1, got {k}.")


def top_templates(log_prob: Float[Array, "S K"], k: int) -> Int[Array, "S J"]:
    """Indices of the k most probable templates, best first.

    Of equally probable ones the first by index come first, which is the most frequent: where one
    must be chosen, to be drawn or driven, it is always the same. `LabelRanks` has no such order.

    Args:
        log_prob: Any monotone score per template; high is good.
        k: Number wanted; with fewer templates all of them are returned (J = min(k, K)).

    Raises:
        ValueError: If `k` is below 1.
    """
    _check_k(k)
    best = np.empty((len(log_prob), min(k, log_prob.shape[1])), dtype=np.int64)
    for start in range(0, len(log_prob), _ROWS):
        rows = slice(start, start + _ROWS)
        best[rows] = np.argsort(-log_prob[rows], axis=1, kind="stable")[:, :k]
    return best


def negative_log_likelihood(
    log_prob: Float[Array, "S K"], label: Int[Array, " S"]
) -> Float[Array, " S"]:
    """Minus the label's log-probability, in nats.

    Raises:
        ValueError: If there is not one label in 0..K-1 for each sample.
    """
    check_labels(label, log_prob.shape)
    nll: Array = -np.take_along_axis(log_prob, label[:, None], axis=1)[:, 0].astype(np.float64)
    return nll


def template_errors(
    templates: Float[Array, "K T 2"],
    futures: Float[Array, "S T 2"],
    best: Int[Array, "S J"],
) -> TemplateErrors:
    """Distances from each driven path to the templates chosen for it.

    Only the J chosen templates are gathered, never all K of them.

    Args:
        templates: Points (x, y) in metres in `ego`.
        futures: Driven paths at the same times, in metres in `ego`.
        best: Templates of each sample, best-ranked first, as `top_templates` gives them.

    Raises:
        ValueError: If there are other numbers of points or of samples, or templates that are none.
    """
    if templates.shape[1:] != futures.shape[1:] or len(best) != len(futures):
        raise ValueError(
            f"Templates {list(templates.shape)}, futures {list(futures.shape)} and best "
            f"{list(best.shape)} must be [K, T, 2], [S, T, 2] and [S, J]."
        )
    if best.size and not 0 <= best.min() <= best.max() < len(templates):
        raise ValueError(f"Templates must lie in 0..{len(templates) - 1}, got others.")
    distance_m = np.linalg.norm(templates[best] - futures[:, None], axis=-1)
    return TemplateErrors(distance_m.mean(-1), distance_m[..., -1], distance_m.max(-1))


def min_ade(errors: TemplateErrors, k: int) -> Float[Array, " S"]:
    """Smallest average displacement error among the k best-ranked templates, in metres.

    Raises:
        ValueError: If `k` is below 1.
    """
    _check_k(k)
    ade_m: Array = errors.mean_m[:, :k].min(axis=1)
    return ade_m


def min_fde(errors: TemplateErrors, k: int) -> Float[Array, " S"]:
    """Smallest final displacement error among the k best-ranked templates, in metres.

    Raises:
        ValueError: If `k` is below 1.
    """
    _check_k(k)
    fde_m: Array = errors.final_m[:, :k].min(axis=1)
    return fde_m


def misses(errors: TemplateErrors, k: int, miss_m: float = MISS_M) -> Float[Array, " S"]:
    """1 where each of the k best-ranked templates is somewhere at least `miss_m` off, else 0.

    This is the rule of nuScenes' prediction challenge (largest distance over the path), not
    Argoverse's (distance at its end).

    Raises:
        ValueError: If `k` is below 1.
    """
    _check_k(k)
    missed: Array = (errors.max_m[:, :k].min(axis=1) >= miss_m).astype(np.float64)
    return missed


class PlanningMetrics(Metric):
    """Running top-k accuracy and NLL over batches, the same on one process or many.

    States are sums, so batches of any size and processes with different numbers of batches weigh
    each sample once. A sampler that repeats samples to even out its processes does not.

    Args:
        ks: The k of each top-k accuracy.

    Raises:
        ValueError: If one is below 1.
    """

    full_state_update = False
    higher_is_better = None
    is_differentiable = False

    hits: Tensor
    nll_sum: Tensor
    num_samples: Tensor

    def __init__(self, ks: Sequence[int] = TOP_KS) -> None:
        super().__init__()
        self.ks = tuple(ks)
        for k in self.ks:
            _check_k(k)
        hits = torch.zeros(len(self.ks), dtype=torch.float64)
        self.add_state("hits", hits, dist_reduce_fx="sum")
        self.add_state("nll_sum", torch.zeros((), dtype=torch.float64), dist_reduce_fx="sum")
        self.add_state("num_samples", torch.zeros((), dtype=torch.long), dist_reduce_fx="sum")

    def update(self, log_prob: Float[Tensor, "B K"], label: Int[Tensor, " B"]) -> None:
        """Add a batch.

        Args:
            log_prob: Log-probability of each template, in nats.
            label: Index of the template nearest to the driven path.
        """
        log_prob = log_prob.detach()
        at_label = log_prob.gather(1, label[:, None])
        # As `rank_labels` and `LabelRanks.hits`.
        num_tied = (log_prob == at_label).sum(dim=1, keepdim=True)
        num_behind = (log_prob < at_label).sum(dim=1, keepdim=True)
        within = torch.tensor(self.ks, dtype=self.hits.dtype, device=log_prob.device)
        places_left = within - (log_prob.shape[1] - num_behind - num_tied)
        share = (places_left / num_tied.clamp(min=1)).clamp(0.0, 1.0)
        self.hits += (share * (num_tied > 0)).sum(dim=0)
        self.nll_sum -= at_label.to(self.nll_sum.dtype).sum()
        self.num_samples += len(label)

    def compute(self) -> dict[str, float]:
        """Accuracies in per cent (`top1`, ...), `nll` in nats, over all samples; NaN before any."""
        percent = 100.0 * self.hits / self.num_samples
        values = {f"top{k}": float(value) for k, value in zip(self.ks, percent, strict=True)}
        return {**values, "nll": float(self.nll_sum / self.num_samples)}
