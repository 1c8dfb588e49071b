"""A factored set: paths that were driven, times the speeds that were driven along paths."""

from dataclasses import dataclass
from math import ceil, sqrt

import numpy as np
from numpy.typing import NDArray
from sklearn.metrics import pairwise_distances_argmin_min

from lss_core.errors import DataError
from lss_core.geometry import FloatArray
from shoot.clustering import cluster
from shoot.footprint import headings
from shoot.templates.methods.distinct import DistinctFutures

# So many products are made for each that is kept, and so many speed profiles for each path. On the
# synthetic city's training scenes these came nearer to what was driven than fewer or as many.
SPARE = 8
_PROFILES_PER_PATH = 2
_MAX_BENDS = 100
_MIN_BEND_M = 1.0
# As finely a path is laid out before it is driven.
_FOLLOW_M = 0.1


@dataclass(frozen=True)
class FactoredSet:
    """Products of paths and speed profiles.

    Attributes:
        points: [K, T, 2] metres in `ego`.
        path_idx: [K] which path each drives.
        profile_idx: [K] which speed profile.
        paths_rad: [P, G] headings along the paths, see `paths_and_profiles`.
        profiles_m: [V, T] way driven at each time, backward counting less.
        gap_m: Way between two headings of a path.
    """

    points: FloatArray
    path_idx: NDArray[np.int64]
    profile_idx: NDArray[np.int64]
    paths_rad: FloatArray
    profiles_m: FloatArray
    gap_m: float


def fit_factored(futures: DistinctFutures, k: int, seed: int, dt_s: float) -> FactoredSet:
    """The K products that are nearest (L2) to most futures.

    2 sqrt(K) paths are K-Means of headings over the way driven, which is curvature summed up; twice
    as many speed profiles are K-Means of ways over time. Where one of the two has fewer
    different ones, the other has more.

    Args:
        futures: At least k.
        k: Number of templates.
        seed: Of both K-Means.
        dt_s: Time between points.

    Raises:
        DataError: If there are fewer products than k.
    """
    headings_rad, ways_m, gap_m = paths_and_profiles(futures.points, dt_s)
    # Of who hardly moves no path is known.
    moves = np.abs(np.diff(ways_m, axis=1, prepend=0.0)).sum(axis=1) >= _MIN_BEND_M
    if not moves.any():
        moves[:] = True
    headings_rad, times = headings_rad[moves], futures.counts[moves]
    can_paths, can_profiles = _num_distinct(headings_rad), _num_distinct(ways_m)
    num_paths = min(can_paths, ceil(sqrt(SPARE * k / _PROFILES_PER_PATH)))
    num_profiles = min(can_profiles, ceil(SPARE * k / num_paths))
    num_paths = min(can_paths, ceil(SPARE * k / num_profiles))
    paths_rad = cluster(np.repeat(headings_rad, times, axis=0), num_paths, seed).centres
    profiles_m = cluster(np.repeat(ways_m, futures.counts, axis=0), num_profiles, seed).centres

    products = drive(paths_rad, profiles_m, gap_m).reshape(-1, *futures.points.shape[1:])
    flat = products.reshape(len(products), -1)
    # Who stands, stands on every path: one of them is enough.
    own = np.unique(flat.astype(np.float32), axis=0, return_index=True)[1]
    if len(own) < k:
        raise DataError(
            f"Only {len(own)} products of {num_paths} paths and {num_profiles} speed profiles "
            "differ; choose a k of at most that."
        )
    nearest, _ = pairwise_distances_argmin_min(futures.flat, flat[own])
    counts = np.bincount(nearest, weights=futures.counts, minlength=len(own))
    order = np.argsort(-counts, kind="stable")
    if counts[order[k - 1]] == 0:
        unused = np.flatnonzero(counts == 0)
        _, apart_m = pairwise_distances_argmin_min(flat[own[unused]], futures.flat)
        order[len(own) - len(unused) :] = unused[np.argsort(apart_m, kind="stable")]
    kept = own[order[:k]]
    path_idx, profile_idx = np.divmod(kept, num_profiles)
    return FactoredSet(products[kept], path_idx, profile_idx, paths_rad, profiles_m, gap_m)


def paths_and_profiles(points: FloatArray, dt_s: float) -> tuple[FloatArray, FloatArray, float]:
    """[N, T, 2] futures taken apart: where they lead, and how far they are when.

    Returns:
        [N, G] headings in radians (`footprint.headings`) after 0, `gap_m`, 2 `gap_m`, ... metres of
        way; where the future ends, its path goes straight on. [N, T] metres of way at each time,
        backward counting less. And `gap_m`: 1 m, more only if ways are longer than 100 m.
    """
    heading_rad = np.unwrap(np.pad(headings(points, dt_s), ((0, 0), (1, 0))), axis=1)
    steps_m = np.diff(points, axis=1, prepend=0.0)
    middle_rad = 0.5 * (heading_rad[:, :-1] + heading_rad[:, 1:])
    ahead_m = steps_m[..., 0] * np.cos(middle_rad) + steps_m[..., 1] * np.sin(middle_rad)
    lengths_m = np.hypot(steps_m[..., 0], steps_m[..., 1])
    way_m = np.pad(np.cumsum(lengths_m, axis=1), ((0, 0), (1, 0)))
    gap_m = max(_MIN_BEND_M, float(way_m.max()) / _MAX_BENDS)
    along_m = gap_m * np.arange(ceil(float(way_m.max()) / gap_m) + 1)
    paths = [np.interp(along_m, *one) for one in zip(way_m, heading_rad, strict=True)]
    return np.stack(paths), np.cumsum(np.sign(ahead_m) * lengths_m, axis=1), gap_m


def drive(paths_rad: FloatArray, profiles_m: FloatArray, gap_m: float) -> FloatArray:
    """[P, V, T, 2] every path driven at every speed profile, metres in `ego`.

    Args:
        paths_rad: [P, G] headings, a `gap_m` apart; beyond the last the path is straight.
        profiles_m: [V, T] way at each time.
        gap_m: See `paths_and_profiles`.
    """
    steps_m = np.diff(profiles_m, axis=1, prepend=0.0)
    way_m = np.pad(np.cumsum(np.abs(steps_m), axis=1), ((0, 0), (1, 0)))
    middle_m = _FOLLOW_M * (np.arange(ceil(float(way_m.max()) / _FOLLOW_M) + 1) + 0.5)
    along_m = gap_m * np.arange(paths_rad.shape[1])
    driven = np.zeros((len(paths_rad), *profiles_m.shape, 2))
    for path, heading_rad in enumerate(paths_rad):
        direction_rad = np.interp(middle_m, along_m, heading_rad)
        laid_m = np.pad(np.arange(len(middle_m)) * _FOLLOW_M + _FOLLOW_M, (1, 0))
        for axis, part in enumerate((np.cos(direction_rad), np.sin(direction_rad))):
            place_m = np.interp(way_m, laid_m, np.pad(np.cumsum(part) * _FOLLOW_M, (1, 0)))
            moved_m = np.sign(steps_m) * np.diff(place_m, axis=1)
            driven[path, ..., axis] = np.cumsum(moved_m, axis=1)
    return driven


def _num_distinct(rows: FloatArray) -> int:
    return len(np.unique(np.round(rows, 6), axis=0))
