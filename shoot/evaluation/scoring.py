"""All metrics of one method on all samples, one value per sample."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Bool, Float, Int

from shoot.metrics.calibration import brier_score
from shoot.metrics.comfort import measure_comfort
from shoot.metrics.displacement import expected_ade, open_loop_l2, template_ade
from shoot.metrics.ranks import (
    TOP_KS,
    PerSample,
    min_ade,
    min_fde,
    misses,
    negative_log_likelihood,
    rank_labels,
    template_errors,
    top_templates,
)
from shoot.trajectories import DT_S

Array = np.ndarray[Any, np.dtype[Any]]
PathChecks = Callable[[Float[Array, "S T 2"]], PerSample]


@dataclass(frozen=True)
class Scores:
    """One method, sample by sample.

    Attributes:
        metrics: Metric -> one value per sample in the unit of the report; NaN where it does not
            apply.
        confidence: Probability of the chosen template, which is the most probable one.
        hit: 1 where that template is the label, else 0; a share where several are most probable.
    """

    metrics: PerSample
    confidence: Float[Array, " S"]
    hit: Float[Array, " S"]

    def select(self, keep: Bool[Array, " S"]) -> "Scores":
        """Only some of the samples."""
        return Scores(select_samples(self.metrics, keep), self.confidence[keep], self.hit[keep])


class Scorer:
    """What was driven and what there was to choose from; scores any method against it.

    What does not depend on the method, such as the distances of all templates, is worked out once.

    Args:
        labels: Nearest template of each sample.
        futures: Driven paths in metres in `ego`.
        templates: Templates in metres in `ego`.
        path_checks: Collisions and leaving the road per sample for one path per sample; without
            them these metrics are absent.
        dt_s: Time of the first point of paths and templates, and between points.
    """

    def __init__(
        self,
        labels: Int[Array, " S"],
        futures: Float[Array, "S T 2"],
        templates: Float[Array, "K T 2"],
        path_checks: PathChecks | None = None,
        dt_s: float = DT_S,
    ) -> None:
        self._labels, self._futures, self._templates = labels, futures, templates
        self._path_checks, self._dt_s = path_checks, dt_s
        self._ade_m = template_ade(futures, templates)
        self._template_comfort = measure_comfort(templates, dt_s)

    def score(self, name: str, log_prob: Float[Array, "..."]) -> Scores:
        """Score one method.

        Args:
            name: Of the method, for messages.
            log_prob: Log-probabilities in nats, [S, K]; or [K] where they are the same for all
                samples.

        Raises:
            ValueError: If the shape does not fit, the values are not log-probabilities, or a label
                has probability 0.
        """
        labels, futures, templates = self._labels, self._futures, self._templates
        shape = (len(labels), len(templates))
        if log_prob.shape not in (shape, shape[1:]):
            raise ValueError(
                f"Log-probabilities of '{name}' must have shape {shape} or {shape[1:]}, "
                f"got {log_prob.shape}."
            )
        rows = np.atleast_2d(log_prob)
        prob = np.exp(rows, dtype=np.float32)
        total = prob.sum(axis=1, dtype=np.float64)
        # Written so that NaN fails it; float32 log-softmax is good to about 1e-6 here.
        if not (np.abs(total - 1.0) < 1e-3).all():
            raise ValueError(
                f"'{name}' must give log-probabilities that sum to one, but they sum to "
                f"{total.min():g}..{total.max():g} (NaN: the model has diverged)."
            )
        every = np.broadcast_to(rows, shape)
        nll = negative_log_likelihood(every, labels)
        if not np.isfinite(nll).all():
            raise ValueError(
                f"'{name}' gives probability 0 to a template that was driven; smooth it, so that "
                "its NLL is finite."
            )
        # Methods that are the same for all samples are sorted once; their rows are views.
        best = top_templates(rows, max(TOP_KS))
        confidence = np.take_along_axis(prob, best[:, :1], axis=1)[:, 0]
        best = np.broadcast_to(best, (len(labels), best.shape[1]))
        ranks = rank_labels(every, labels)
        errors = template_errors(templates, futures, best)
        metrics = {f"top{k}": 100.0 * ranks.hits(k) for k in TOP_KS}
        metrics |= {"nll": nll, "brier": brier_score(prob, labels)}
        metrics |= {"expected_ade": expected_ade(prob, self._ade_m)}
        metrics |= {f"min_ade_{k}": min_ade(errors, k) for k in TOP_KS}
        metrics |= {f"min_fde_{k}": min_fde(errors, k) for k in TOP_KS}
        metrics |= {f"miss_rate_{k}": 100.0 * misses(errors, k) for k in TOP_KS}
        chosen = best[:, 0]
        metrics |= open_loop_l2(templates[chosen], futures, self._dt_s)
        metrics |= {key: value[chosen] for key, value in self._template_comfort.items()}
        if self._path_checks is not None:
            metrics |= self._path_checks(templates[chosen])
        return Scores(metrics, np.broadcast_to(confidence, labels.shape), ranks.hits(1))

    def score_nearest(self) -> PerSample:
        """Errors of the nearest template: `ade`, `fde` and `miss_rate`."""
        errors = template_errors(self._templates, self._futures, self._labels[:, None])
        return {
            "ade": min_ade(errors, 1),
            "fde": min_fde(errors, 1),
            "miss_rate": 100.0 * misses(errors, 1),
        }

    def score_driven(self) -> PerSample:
        """Checks and comfort of the driven paths themselves; empty if there are no checks."""
        if self._path_checks is None:
            return {}
        comfort = measure_comfort(self._futures, self._dt_s)
        return self._path_checks(self._futures) | comfort


def select_samples(metrics: PerSample, keep: Bool[Array, " S"]) -> PerSample:
    """Only some of the samples."""
    return {key: value[keep] for key, value in metrics.items()}
