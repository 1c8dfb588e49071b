"""CoverNet's cover: no future is farther than epsilon from a template at any of its points."""

import logging
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array
from scipy.spatial import cKDTree

from lss_core.geometry import FloatArray
from shoot.templates.methods.distinct import DistinctFutures
from shoot.templates.methods.farthest import farthest_points

logger = logging.getLogger(__name__)

# The greedy choice is made among so many futures, as far from each other as can be.
CANDIDATES_PER_TEMPLATE = 5
_MIN_CANDIDATES = 500
# An epsilon found to this ratio, or a cover that wants this share of the templates, is good enough.
_RATIO = 1.02
_MIN_SHARE = 0.98
_LEAST_M = 1e-3
_ROWS_A_BLOCK = 1000


@dataclass(frozen=True)
class Cover:
    """A cover that was found.

    Attributes:
        rows: [k] futures chosen.
        epsilon_m: No future is farther from the nearest template, at the worst of its points.
        num_covering: How many of them cover; the others are the farthest from these.
    """

    rows: NDArray[np.int64]
    epsilon_m: float
    num_covering: int


def fit_cover(futures: DistinctFutures, k: int) -> Cover:
    """A cover by k futures, with the smallest epsilon that bisection finds.

    Paper: CoverNet (Phan-Minh et al., CVPR 2020): a greedy approximation of the least
    set that covers. There epsilon is given and the size comes out; here it is searched so that the
    size is at most k. What is missing to k are the farthest points (L2) from those that cover.

    Args:
        futures: At least k.
        k: Number of templates.
    """
    first = candidates(futures, np.arange(len(futures.points)), k)
    low_m, high_m, best = 0.0, 0.0, np.zeros(0, dtype=np.int64)
    epsilon_m = 1.0
    while True:
        rows = cover(futures, epsilon_m, k, first)
        found = f"more than {k}" if rows is None else str(len(rows))
        logger.info("epsilon %.4g m: %s templates", epsilon_m, found)
        if rows is None:
            low_m = epsilon_m
        else:
            high_m, best = epsilon_m, rows
            if len(rows) >= _MIN_SHARE * k or epsilon_m < _LEAST_M:
                break
        if high_m and low_m and high_m / low_m < _RATIO:
            break
        if high_m and low_m:
            epsilon_m = float(np.sqrt(low_m * high_m))
        else:
            epsilon_m = high_m / 2.0 if high_m else 2.0 * low_m
    return Cover(farthest_points(futures.flat, k, best.tolist()).rows, high_m, len(best))


@dataclass(frozen=True)
class Candidates:
    """Futures among which templates are chosen.

    Attributes:
        rows: [C] which.
        weights: [C] how many drives are nearest to each.
    """

    rows: NDArray[np.int64]
    weights: NDArray[np.int64]


def candidates(futures: DistinctFutures, left: NDArray[np.int64], k: int) -> Candidates:
    """The farthest points of some rows of futures: 5 for each of k templates, 500 at least."""
    size = min(len(left), max(_MIN_CANDIDATES, CANDIDATES_PER_TEMPLATE * k))
    if size == len(left):
        return Candidates(left, futures.counts[left])
    found = farthest_points(futures.flat[left], size)
    weights = np.bincount(found.nearest, weights=futures.counts[left], minlength=size)
    return Candidates(left[found.rows], weights.astype(np.int64))


def cover(
    futures: DistinctFutures, epsilon_m: float, most: int, first: Candidates
) -> NDArray[np.int64] | None:
    """Rows of futures that cover all; None if it takes more than `most`.

    Greedy: next is who covers most of what is not covered yet. All pairs would not fit into memory,
    so candidates cover each other; whom that misses are covered in the same way.
    """
    left, rows, among = np.arange(len(futures.points)), np.zeros(0, dtype=np.int64), first
    while True:
        points = futures.points[among.rows]
        new = _greedy(_within(points, points, epsilon_m), among.weights, most - len(rows))
        if new is None:
            return None
        rows = np.concatenate([rows, among.rows[new]])
        covered = _within(futures.points[left], points[new], epsilon_m)
        left = left[np.diff(covered.indptr) == 0]
        if not len(left):
            return rows
        among = candidates(futures, left, most)


def _greedy(covers: csr_array, weights: NDArray[np.int64], most: int) -> NDArray[np.int64] | None:
    """Rows that cover all columns of a symmetric matrix; None if it takes more than `most`."""
    gains, is_left = covers @ weights, np.ones(len(weights), dtype=bool)
    rows: list[int] = []
    while is_left.any():
        if len(rows) == most:
            return None
        row = int(gains.argmax())
        rows.append(row)
        new = covers.indices[covers.indptr[row] : covers.indptr[row + 1]]
        new = new[is_left[new]]
        is_left[new] = False
        gains -= covers[new].T @ weights[new]
    return np.array(rows, dtype=np.int64)


def _within(points: FloatArray, others: FloatArray, epsilon_m: float) -> csr_array:
    """[N, M] sparse, 1 where [N, T, 2] and [M, T, 2] are within epsilon at all their points.

    Trees of three of the points tell who may be; all points decide.
    """
    num_steps = points.shape[1]
    asked = np.unique(np.ceil(num_steps * np.array([0.25, 0.5, 1.0])).astype(int)) - 1
    tree = cKDTree(others[:, asked].reshape(len(others), -1))
    found = []
    for first in range(0, len(points), _ROWS_A_BLOCK):
        block = points[first : first + _ROWS_A_BLOCK]
        pairs = cKDTree(block[:, asked].reshape(len(block), -1)).sparse_distance_matrix(
            tree, epsilon_m, p=np.inf, output_type="ndarray"
        )
        row, column = pairs["i"], pairs["j"]
        for step in range(num_steps):
            apart = block[row, step] - others[column, step]
            is_near = (apart**2).sum(axis=1) <= epsilon_m**2
            row, column = row[is_near], column[is_near]
        found.append(np.stack([row + first, column]).astype(np.int32))
    rows, columns = np.concatenate(found, axis=1)
    shape = len(points), len(others)
    return csr_array((np.ones(len(rows), dtype=np.int64), (rows, columns)), shape=shape)
