"""Futures without repetitions, in an order of their own: what methods choose from."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lss_core.geometry import FloatArray


@dataclass(frozen=True)
class DistinctFutures:
    """Futures that differ, sorted by their numbers: in whichever order they came, it is the same.

    Attributes:
        points: [N, T, 2] metres in `ego`; float64, but as round as templates are (float32).
        counts: [N] how often each was driven.
    """

    points: FloatArray
    counts: NDArray[np.int64]

    @property
    def flat(self) -> FloatArray:
        """[N, 2 T] the numbers of each, of which labels take the L2 distance."""
        return self.points.reshape(len(self.points), -1)


def distinct_futures(futures: FloatArray) -> DistinctFutures:
    """The different ones among [M, T, 2] futures."""
    flat = futures.reshape(len(futures), -1).astype(np.float32)
    found, counts = np.unique(flat, axis=0, return_counts=True)
    points = found.reshape(-1, *futures.shape[1:]).astype(np.float64)
    return DistinctFutures(points, counts.astype(np.int64))
