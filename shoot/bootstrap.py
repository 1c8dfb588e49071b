"""95 % intervals of means, by drawing whole scenes again.

Samples of one scene look alike, so samples drawn one by one would make intervals far too narrow.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
from jaxtyping import Float, Shaped

Array = npt.NDArray[Any]

NUM_DRAWS = 2000
SEED = 0


@dataclass(frozen=True)
class Interval:
    """A mean over samples with the 95 % interval it has over scenes.

    Attributes:
        value: Mean over all samples.
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
    """Draws of scenes, made once and used for every mean over the same samples.

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
        _, self._row = np.unique(scene, return_inverse=True)
        counts = np.bincount(self._row)
        self.num_scenes = len(counts)
        generator = np.random.default_rng(seed)
        times_drawn = generator.multinomial(
            self.num_scenes, np.full(self.num_scenes, 1.0 / self.num_scenes), size=num_draws
        )
        # Per draw and scene: the weight each of the scene's samples has in the draw's mean.
        self._weights = times_drawn / (times_drawn @ counts)[:, None]

    def interval(self, values: Float[Array, " S"]) -> Interval:
        """Interval of the mean of one number per sample."""
        values = values.astype(np.float64)
        value = float(values.mean())
        if self.num_scenes == 1:
            return Interval(value, float("nan"), float("nan"))
        sums = np.bincount(self._row, weights=values, minlength=self.num_scenes)
        low, high = np.percentile(self._weights @ sums, [2.5, 97.5])
        return Interval(value, float(low), float(high))


def interval(
    values: Float[Array, " S"],
    scene: Shaped[Array, " S"],
    num_draws: int = NUM_DRAWS,
    seed: int = SEED,
) -> Interval:
    """95 % interval of the mean of `values`, over draws of whole scenes.

    Args:
        values: One number per sample.
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
        values_b: One number per sample, in the same order.
        scene: Scene of each sample.
        num_draws: Number of draws.
        seed: Seed of the draws.
    """
    return interval(values_a - values_b, scene, num_draws, seed)
