"""Farthest-point sampling: each template is the future that is farthest from all before it."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lss_core.geometry import FloatArray
from lss_core.progress import progress


@dataclass(frozen=True)
class FarthestPoints:
    """Points that were chosen.

    Attributes:
        rows: [k] which, in the order of their choice.
        nearest: [N] which of the k is nearest to each point.
    """

    rows: NDArray[np.int64]
    nearest: NDArray[np.int64]


def farthest_points(points: FloatArray, k: int, chosen: Sequence[int] = ()) -> FarthestPoints:
    """The k points of which each is the farthest (L2) from all that stand before it.

    Of several equally far ones the first is taken. The largest distance of any point to its nearest
    chosen one is at most twice the least that k points can have (Gonzalez 1985).

    Args:
        points: [N, D], at least k distinct ones.
        k: How many.
        chosen: Rows to begin with; if none, the point nearest to the mean of all.
    """
    begin = chosen or [int(((points - points.mean(axis=0)) ** 2).sum(axis=1).argmin())]
    rows = np.zeros(k, dtype=np.int64)
    squared = np.full(len(points), np.inf)
    nearest = np.zeros(len(points), dtype=np.int64)
    with progress("Farthest points", k) as advance:
        for number in range(k):
            row = begin[number] if number < len(begin) else int(squared.argmax())
            rows[number] = row
            # Who is nearer to its own than half the way from there to the new one stays there.
            apart = ((points[rows[: number + 1]] - points[row]) ** 2).sum(axis=1)
            asked = np.flatnonzero(squared > 0.25 * apart[nearest])
            new = ((points[asked] - points[row]) ** 2).sum(axis=1)
            is_nearer = new < squared[asked]
            squared[asked[is_nearer]] = new[is_nearer]
            nearest[asked[is_nearer]] = number
            advance(1)
    return FarthestPoints(rows, nearest)
