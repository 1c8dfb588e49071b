"""K-Means of many alike trajectories: in a fraction of the time, or of more than memory holds."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from sklearn.cluster import KMeans, MiniBatchKMeans, kmeans_plusplus
from sklearn.decomposition import PCA
from sklearn.metrics import pairwise_distances_argmin_min

from lss_core.errors import DataError
from lss_core.geometry import FloatArray

# Trajectories are smooth: forty numbers vary along some ten directions.
_KEPT_VARIANCE = 1.0 - 1e-5
_SAMPLE_PER_CENTRE = 60
_MAX_ROUNDS = 30


@dataclass(frozen=True)
class Clusters:
    """What was found.

    Attributes:
        centres: [K, D] means of the clusters.
        inertia: Sum of the points' squared distances to the mean of their cluster.
    """

    centres: FloatArray
    inertia: float


@dataclass(frozen=True)
class StreamClusters(Clusters):
    """What was found in points that were never held all at once.

    Attributes:
        counts: [K] points nearest to each centre.
        sample: [S, D] random points of the stream on which nothing was fitted.
        given_up: The sample's inertia is at most by this share greater than with K-Means of all
            points: it is compared with K-Means of the sample itself, which serves it best.
    """

    counts: NDArray[np.int64]
    sample: FloatArray
    given_up: float


def cluster(points: FloatArray, k: int, seed: int) -> Clusters:
    """K-Means of [M, D] points, from coarse to fine.

    Points are described by the few principal directions that hold all but 1e-5 of their variance.
    K-Means++ chooses centres from a random sample of 60 points a centre, where Lloyd's rounds
    settle them; at most 30 rounds over all points follow, after which the inertia changes by parts
    of a per cent. The centres are then the means of their points in all D numbers.

    In float64: in float32 the result would depend on the order in which threads add up.

    Args:
        points: At least k distinct ones.
        k: Number of clusters.
        seed: Of sample and choice.
    """
    if k == 1:
        centre = points.mean(axis=0, keepdims=True)
        return Clusters(centre, float(((points - centre) ** 2).sum()))
    directions = PCA(n_components=_KEPT_VARIANCE, svd_solver="covariance_eigh")
    reduced = directions.fit_transform(points)
    size = min(len(points), _SAMPLE_PER_CENTRE * k)
    sample = reduced[np.random.default_rng(seed).permutation(len(points))[:size]]
    if len(np.unique(sample, axis=0)) < k:
        sample = reduced
    centres, _ = kmeans_plusplus(sample, k, random_state=seed)
    if len(sample) < len(points):
        centres = KMeans(k, init=centres, n_init=1).fit(sample).cluster_centers_
    rounds = _MAX_ROUNDS if len(sample) < len(points) else 300
    fitted = KMeans(k, init=centres, n_init=1, max_iter=rounds).fit(reduced)
    labels, counts = fitted.labels_, np.bincount(fitted.labels_, minlength=k)
    sums = np.stack(
        [np.bincount(labels, weights=column, minlength=k) for column in points.T], axis=-1
    )
    # A cluster that lost its last point in the last round stays where it was.
    means: FloatArray = np.where(
        counts[:, None] > 0,
        sums / np.maximum(counts, 1)[:, None],
        directions.inverse_transform(fitted.cluster_centers_),
    )
    return Clusters(means, float(((points - means[labels]) ** 2).sum()))


def cluster_stream(chunks: Callable[[], Iterable[FloatArray]], k: int, seed: int) -> StreamClusters:
    """K-Means of points that come in chunks, of which only one and two samples are held.

    K-Means of a random sample of 60 points a centre, then one pass of mini-batch K-Means over all.

    Args:
        chunks: Begins the stream of [M, D] chunks anew; it is read three times.
        k: Number of clusters.
        seed: Of samples and choice.

    Raises:
        DataError: If the samples have fewer than k distinct points.
    """
    samples = _two_samples(chunks(), _SAMPLE_PER_CENTRE * k, seed)
    distinct = min(len(np.unique(np.round(sample, 6), axis=0)) for sample in samples)
    if distinct < k:
        raise DataError(
            f"Only {distinct} of {len(samples[0])} random trajectories differ; choose a k of at "
            "most that."
        )
    centres = cluster(samples[0], k, seed).centres
    # A centre that few points choose is not moved elsewhere: it stands for a rare turn.
    means = MiniBatchKMeans(k, init=centres, n_init=1, reassignment_ratio=0.0, random_state=seed)
    for chunk in chunks():
        means.partial_fit(chunk)
    centres = np.asarray(means.cluster_centers_, dtype=np.float64)  # now of all points
    counts, inertia = np.zeros(k, dtype=np.int64), 0.0
    for chunk in chunks():
        nearest, distance_m = pairwise_distances_argmin_min(chunk, centres)
        counts += np.bincount(nearest, minlength=k)
        inertia += float((distance_m**2).sum())
    best = cluster(samples[1], k, seed).inertia
    given_up = _inertia(samples[1], centres) / best - 1.0 if best else 0.0
    return StreamClusters(centres, inertia, counts, samples[1], given_up)


def _two_samples(
    chunks: Iterable[FloatArray], size: int, seed: int
) -> tuple[FloatArray, FloatArray]:
    """Two random samples of at most `size` points that share none, if there are enough.

    Of each point's random number the least are kept: one pass, whatever the stream's length.
    """
    rng = np.random.default_rng(seed)
    kept, numbers = None, np.zeros(0)
    for chunk in chunks:
        kept = chunk if kept is None else np.concatenate([kept, chunk])
        numbers = np.concatenate([numbers, rng.random(len(chunk))])
        order = np.argsort(numbers, kind="stable")[: 2 * size]
        kept, numbers = kept[order], numbers[order]
    if kept is None:
        raise ValueError("A stream without points has no clusters.")
    if len(kept) < 2 * size:
        return kept, kept
    return kept[0::2], kept[1::2]


def _inertia(points: FloatArray, centres: FloatArray) -> float:
    _, distance_m = pairwise_distances_argmin_min(points, centres)
    return float((distance_m**2).sum())
