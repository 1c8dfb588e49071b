"""95 % intervals of means and other statistics, by drawing whole scenes again.

Samples of one scene look alike, so samples drawn one by one would make intervals far too narrow.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float, Shaped

Array = np.ndarray[Any, np.dtype[Any]]

NUM_DRAWS = 2000
SEED = 0


@dataclass(frozen=True)
class Interval:
    """A mean over samples with the 95 % interval it has over scenes.

    Attributes:
        value: Mean over all samples; NaN if there is nothing to take a mean of.
        low: 2.5th percentile over the draws; NaN if there is one scene only, which tells nothing
            about other scenes.
        high: 97.5th percentile over the draws; NaN likewise.
    """

    value: float
    low: float
    high: float

    @property
    def excludes_zero(self) -> bool:
        """Whether zero lies outside [low, high]; False where there is no interval."""
        return self.low > 0.0 or self.high < 0.0


class SceneBootstrap:
    """Draws of scenes, made once and used for everything that is said of the same samples.

    Each draw takes as many scenes as there are, with replacement; a scene drawn twice counts twice.
    The mean of a draw is over its samples, so long scenes weigh more, as in the value itself.

    Args:
        scene: Scene of each sample, any labels.
        num_draws: Number of draws.
        seed: Seed of the draws.

    Raises:
        ValueError: If there are no samples.
    """

    def __init__(
        self, scene: Shaped[Array, " S"], num_draws: int = NUM_DRAWS, seed: int = SEED
    ) -> None:
        if len(scene) == 0:
            raise ValueError("A bootstrap interval needs at least one sample, got none.")
        _, row = np.unique(scene, return_inverse=True)
        # Samples scene by scene, and where each scene begins.
        self._order = np.argsort(row, kind="stable")
        self._begins = np.searchsorted(row[self._order], np.arange(row.max() + 1))
        self.num_scenes = len(self._begins)
        generator = np.random.default_rng(seed)
        # As floats, since only those are multiplied fast.
        self._times_drawn = generator.multinomial(
            self.num_scenes, np.full(self.num_scenes, 1.0 / self.num_scenes), size=num_draws
        ).astype(np.float64)

    def interval(self, values: Float[Array, " S"]) -> Interval:
        """Interval of the mean of one number per sample; NaN is left out, see `intervals`."""
        return self.intervals(values[:, None])[0]

    def intervals(self, values: Float[Array, "S M"]) -> list[Interval]:
        """Intervals of the means of the M columns, each as if asked for alone, but faster.

        NaN stands for samples to which a number does not apply. They are left out: of the value, of
        the mean of each draw (a draw without any other sample is left out itself), and of the
        number of scenes. A column of nothing else has the value NaN.
        """
        applies = ~np.isnan(values)
        sums = self._scene_sums(np.where(applies, values, 0.0))
        counts = self._scene_sums(applies)
        with np.errstate(invalid="ignore"):
            value = sums.sum(axis=0) / counts.sum(axis=0)
            draws = (self._times_drawn @ sums) / (self._times_drawn @ counts)
        num_scenes = (counts > 0.0).sum(axis=0)
        return [
            _percentiles(float(value[column]), draws[:, column], int(num_scenes[column]))
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
        sums = self._scene_sums(per_sample)
        value = float(function(sums.sum(axis=0, keepdims=True))[0])
        return _percentiles(value, function(self._times_drawn @ sums), self.num_scenes)

    def _scene_sums(self, per_sample: Shaped[Array, "S J"]) -> Float[Array, "N J"]:
        ordered = per_sample[self._order].astype(np.float64)
        sums: Array = np.add.reduceat(ordered, self._begins, axis=0)
        return sums


def interval(
    values: Float[Array, " S"],
    scene: Shaped[Array, " S"],
    num_draws: int = NUM_DRAWS,
    seed: int = SEED,
) -> Interval:
    """95 % interval of the mean of `values`, over draws of whole scenes.

    Args:
        values: One number per sample; NaN where it does not apply, which is left out.
        scene: Scene of each sample.
        num_draws: Number of draws.
        seed: Seed of the draws.
    """
    return SceneBootstrap(scene, num_draws, seed).interval(values)


def paired_interval(
    values_a: Float[Array, " S"],
    values_b: Float[Array, " S"],
    scene: Shaped[Array, " S"],
    num_draws: int = NUM_DRAWS,
    seed: int = SEED,
) -> Interval:
    """95 % interval of the mean of a minus b, both on the same samples.

    What makes a scene hard for both cancels, so it is narrower than two intervals side by side.

    Args:
        values_a: One number per sample.
        values_b: One number per sample, in the same order; samples where either is NaN are left
            out.
        scene: Scene of each sample.
        num_draws: Number of draws.
        seed: Seed of the draws.
    """
    return interval(values_a - values_b, scene, num_draws, seed)


def _percentiles(value: float, draws: Float[Array, " D"], num_scenes: int) -> Interval:
    known = draws[~np.isnan(draws)]
    if num_scenes < 2 or not len(known):
        return Interval(value, float("nan"), float("nan"))
    low, high = np.percentile(known, [2.5, 97.5])
    return Interval(value, float(low), float(high))
