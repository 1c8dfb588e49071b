"""95 % intervals of means and other statistics, by drawing whole groups of samples again.

Samples of one scene look alike, and scenes of one drive (a log) share street, weather and traffic;
samples drawn one by one would make intervals far too narrow. Groups are scenes where each is a
drive of its own, else logs.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from jaxtyping import Float, Shaped

Array = np.ndarray[Any, np.dtype[Any]]
Groups = Literal["scenes", "logs"]

NUM_DRAWS = 2000
SEED = 0


@dataclass(frozen=True)
class Interval:
    """A mean over samples with the 95 % interval it has over groups of them.

    Attributes:
        value: Mean over all samples; NaN if there is nothing to take a mean of.
        low: 2.5th percentile over the draws; NaN if there is one group only, which tells nothing
            about others.
        high: 97.5th percentile over the draws; NaN likewise.
    """

    value: float
    low: float
    high: float

    @property
    def excludes_zero(self) -> bool:
        """Whether zero lies outside [low, high]; False where there is no interval."""
        return self.low > 0.0 or self.high < 0.0


class GroupBootstrap:
    """Draws of groups, made once and used for everything that is said of the same samples.

    Each draw takes as many groups as there are, with replacement; one drawn twice counts twice. The
    mean of a draw is over its samples, so large groups weigh more, as in the value itself.

    Args:
        group: Group of each sample, any labels: its scene or log.
        num_draws: Number of draws.
        seed: Seed of the draws.

    Raises:
        ValueError: If there are no samples.
    """

    def __init__(
        self, group: Shaped[Array, " S"], num_draws: int = NUM_DRAWS, seed: int = SEED
    ) -> None:
        if len(group) == 0:
            raise ValueError("A bootstrap interval needs at least one sample, got none.")
        _, row = np.unique(group, return_inverse=True)
        # Samples group by group, and where each group begins.
        self._order = np.argsort(row, kind="stable")
        self._begins = np.searchsorted(row[self._order], np.arange(row.max() + 1))
        self.num_groups = len(self._begins)
        generator = np.random.default_rng(seed)
        # As floats, since only those are multiplied fast.
        self._times_drawn = generator.multinomial(
            self.num_groups, np.full(self.num_groups, 1.0 / self.num_groups), size=num_draws
        ).astype(np.float64)

    def interval(self, values: Float[Array, " S"]) -> Interval:
        """Interval of the mean of one number per sample; NaN is left out, see `intervals`."""
        return self.intervals(values[:, None])[0]

    def intervals(self, values: Float[Array, "S M"]) -> list[Interval]:
        """Intervals of the means of the M columns, each as if asked for alone, but faster.

        NaN stands for samples to which a number does not apply. They are left out: of the value, of
        the mean of each draw (a draw without any other sample is left out itself), and of the
        number of groups. A column of nothing else has the value NaN.
        """
        applies = ~np.isnan(values)
        sums = self._group_sums(np.where(applies, values, 0.0))
        counts = self._group_sums(applies)
        with np.errstate(invalid="ignore"):
            value = sums.sum(axis=0) / counts.sum(axis=0)
            draws = (self._times_drawn @ sums) / (self._times_drawn @ counts)
        num_groups = (counts > 0.0).sum(axis=0)
        return [
            _percentiles(float(value[column]), draws[:, column], int(num_groups[column]))
            for column in range(values.shape[1])
        ]

    def statistic(
        self,
        per_sample: Float[Array, "S J"],
        function: Callable[[Float[Array, "D J"]], Float[Array, " D"]],
    ) -> Interval:
        """Interval of something that is worked out from sums over samples, but is no mean.

        A ratio of sums, say, or the calibration error. The percentiles are the draws' own: of a
        statistic that noise makes larger, as of absolute values, they lie rather high.

        Args:
            per_sample: J numbers for each sample, none of them NaN.
            function: From D rows of sums to D values; called with the sums over all samples (D = 1)
                and with those of all draws.

        Returns:
            Value and interval; draws with the value NaN are left out.
        """
        sums = self._group_sums(per_sample)
        value = float(function(sums.sum(axis=0, keepdims=True))[0])
        return _percentiles(value, function(self._times_drawn @ sums), self.num_groups)

    def _group_sums(self, per_sample: Shaped[Array, "S J"]) -> Float[Array, "N J"]:
        ordered = per_sample[self._order].astype(np.float64)
        sums: Array = np.add.reduceat(ordered, self._begins, axis=0)
        return sums


def interval(
    values: Float[Array, " S"],
    group: Shaped[Array, " S"],
    num_draws: int = NUM_DRAWS,
    seed: int = SEED,
) -> Interval:
    """95 % interval of the mean of `values`, over draws of whole groups.

    Args:
        values: One number per sample; NaN where it does not apply, which is left out.
        group: Scene or log of each sample.
        num_draws: Number of draws.
        seed: Seed of the draws.
    """
    return GroupBootstrap(group, num_draws, seed).interval(values)


def _percentiles(value: float, draws: Float[Array, " D"], num_groups: int) -> Interval:
    known = draws[~np.isnan(draws)]
    if num_groups < 2 or not len(known):
        return Interval(value, float("nan"), float("nan"))
    low, high = np.percentile(known, [2.5, 97.5])
    return Interval(value, float(low), float(high))


def name_groups(groups: Groups, num_groups: int) -> str:
    """What intervals are over, in words: `scenes`, whose number stands beside, or `15 logs`."""
    return "scenes" if groups == "scenes" else f"{num_groups} {groups}"
