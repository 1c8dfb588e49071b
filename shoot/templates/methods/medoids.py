"""K-medoids: templates that were driven, each with the least sum of distances to its own."""

import logging

import numpy as np
from numpy.typing import NDArray
from sklearn.metrics import pairwise_distances, pairwise_distances_argmin

from lss_core.geometry import FloatArray
from shoot.clustering import cluster
from shoot.templates.methods.distinct import DistinctFutures
from shoot.templates.methods.farthest import farthest_points

logger = logging.getLogger(__name__)

# The best member of a cluster is one of those near its mean.
CANDIDATES = 32
MAX_ROUNDS = 5


def medoids(futures: DistinctFutures, k: int, seed: int) -> NDArray[np.int64]:
    """Rows of k futures that others are near to (L2, not squared), by alternation.

    Each centre of K-Means is replaced by the future nearest to it. Then, in rounds: every future
    goes to its nearest medoid, and in every cluster the medoid is swapped for the member with the
    least sum of distances to the cluster, of the 32 nearest to its mean. No round makes the whole
    sum greater. Swaps across clusters (PAM), which can go on from there, are not tried: they need
    all pairs of futures.

    Args:
        futures: At least k.
        k: Number of medoids.
        seed: Of K-Means.
    """
    flat = futures.flat
    centres = cluster(np.repeat(flat, futures.counts, axis=0), k, seed).centres
    # Two means may be nearest to one future; what is then missing is far from all others.
    snapped = np.unique(pairwise_distances_argmin(centres, flat)).tolist()
    rows = farthest_points(flat, k, snapped).rows
    least = np.inf
    for number in range(MAX_ROUNDS):
        nearest = pairwise_distances_argmin(flat, flat[rows])
        nearest[rows] = np.arange(k)  # also beside one that differs by rounding only
        rows, total_m = _best_members(flat, futures.counts, nearest, rows)
        logger.info("k-medoids, round %d: %.6g m in all", number + 1, total_m)
        if total_m >= least:
            break
        least = total_m
    return rows


def _best_members(
    flat: FloatArray, counts: NDArray[np.int64], nearest: NDArray[np.int64], rows: NDArray[np.int64]
) -> tuple[NDArray[np.int64], float]:
    """The best medoid of each cluster, and the sum of all distances to them."""
    order = np.argsort(nearest, kind="stable")
    clusters = np.split(order, np.searchsorted(nearest[order], np.arange(1, len(rows))))
    best, total_m = rows.copy(), 0.0
    for number, members in enumerate(clusters):
        weights = counts[members]
        mean = np.average(flat[members], axis=0, weights=weights)
        squared = ((flat[members] - mean) ** 2).sum(axis=1)
        near = members[np.argsort(squared, kind="stable")[:CANDIDATES]]
        # The present one first: on a tie it stays.
        candidates = np.concatenate([rows[number : number + 1], near])
        sums_m = weights @ pairwise_distances(flat[members], flat[candidates])
        best[number] = candidates[sums_m.argmin()]
        total_m += float(sums_m.min())
    return best, total_m
