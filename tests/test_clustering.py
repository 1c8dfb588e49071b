"""K-Means from coarse to fine, and of a stream: as good as K-Means, and honest about it."""

import numpy as np
import pytest
from sklearn.cluster import KMeans

from shoot.clustering import cluster, cluster_stream

K = 20


def _points(num: int = 6000, seed: int = 0) -> np.ndarray:
    """Smooth curves, like futures: forty numbers that vary along a few directions."""
    rng = np.random.default_rng(seed)
    time = np.linspace(0.05, 1.0, 20)
    speed, change, bend = rng.gamma(2.0, 10.0, num), rng.normal(0, 8, num), rng.normal(0, 9, num)
    x = speed[:, None] * time + change[:, None] * time**2
    y = bend[:, None] * time**2 + rng.normal(0.0, 0.05, (num, 1)) * time
    return np.stack([x, y], axis=-1).reshape(num, 40)


def _inertia(points: np.ndarray, centres: np.ndarray) -> float:
    return float(((points[:, None] - centres) ** 2).sum(axis=-1).min(axis=1).sum())


def test_inertia_is_that_of_full_k_means() -> None:
    # Many clusters, so that luck of the start evens out.
    points = _points(10_000)
    found = [cluster(points, 150, seed) for seed in range(3)]
    full = [KMeans(150, n_init=1, random_state=seed).fit(points).inertia_ for seed in range(3)]
    assert np.mean([clusters.inertia for clusters in found]) < 1.01 * np.mean(full)
    assert found[0].inertia == pytest.approx(_inertia(points, found[0].centres), rel=0.01)


def test_centres_are_means_of_their_points_in_all_numbers() -> None:
    points = _points()
    centres = cluster(points, K, seed=1).centres
    nearest = ((points[:, None] - centres) ** 2).sum(axis=-1).argmin(axis=1)
    for k in range(K):
        # A few points at the border may have changed sides since.
        np.testing.assert_allclose(centres[k], points[nearest == k].mean(axis=0), atol=1.0)


def test_same_seed_same_centres_and_another_seed_others() -> None:
    points = _points()
    assert np.array_equal(cluster(points, K, 3).centres, cluster(points, K, 3).centres)
    assert not np.array_equal(cluster(points, K, 3).centres, cluster(points, K, 4).centres)


def test_one_cluster_is_the_mean() -> None:
    points = _points(50)
    found = cluster(points, 1, seed=0)
    np.testing.assert_allclose(found.centres, points.mean(axis=0)[None])
    assert found.inertia == pytest.approx(_inertia(points, found.centres))


def test_a_sample_with_too_few_distinct_points_is_not_used() -> None:
    # Almost all points are one: sixty times k random ones hardly hold k distinct ones.
    points = np.zeros((20_000, 40))
    points[:30] = _points(30)
    found = cluster(points, 25, seed=0)
    assert len(np.unique(found.centres, axis=0)) == 25


def test_a_stream_is_clustered_without_being_held() -> None:
    points = _points(20_000)

    def chunks() -> "map[np.ndarray]":
        return map(np.copy, np.split(points, 40))

    found = cluster_stream(chunks, K, seed=0)
    full = cluster(points, K, seed=0).inertia
    assert found.counts.sum() == len(points)
    assert found.inertia == pytest.approx(_inertia(points, found.centres), rel=1e-9)
    # What it says of itself is an upper bound of what it lost.
    assert found.inertia / full - 1.0 <= found.given_up
    assert found.given_up < 0.2
    assert len(found.sample) == 60 * K


def test_a_stream_s_sample_is_fair() -> None:
    # From points numbered in order, a fair sample has their mean; the first ones have not.
    numbers = np.arange(40_000, dtype=np.float64)[:, None]
    found = cluster_stream(lambda: np.split(numbers, 100), 10, seed=0)
    assert abs(found.sample.mean() - 20_000) < 4 * 40_000 / np.sqrt(12 * len(found.sample))


def test_a_short_stream_is_its_own_sample() -> None:
    points = _points(60)
    found = cluster_stream(lambda: np.split(points, 3), 5, seed=0)
    assert sorted(found.sample[:, 0]) == sorted(points[:, 0])
    assert found.inertia == pytest.approx(_inertia(points, found.centres), rel=1e-9)


def test_an_empty_stream_is_refused() -> None:
    with pytest.raises(ValueError, match="without points"):
        cluster_stream(lambda: [], 5, seed=0)
