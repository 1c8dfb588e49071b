"""Scores of maps: worked by hand, against scikit-learn, and the same from sums of scenes."""

import numpy as np
import pytest
from sklearn.metrics import average_precision_score, jaccard_score

from shoot.metrics.overlap import (
    NUM_BINS,
    average_precision,
    best_threshold,
    count_by_probability,
    count_overlap,
    iou,
    iou_at_best,
    iou_by_threshold,
    share_true,
)


@pytest.fixture
def cells() -> tuple[np.ndarray, np.ndarray]:
    """Probabilities that know something of a class that one cell in ten is of."""
    generator = np.random.default_rng(0)
    truth = (generator.random(20_000) < 0.1).astype(np.uint8)
    logit = generator.normal(size=20_000) + 2.5 * truth - 2.0
    return (1.0 / (1.0 + np.exp(-logit))).astype(np.float32), truth


def test_by_hand() -> None:
    """Bins of 0.25; true cells at 0.9, 0.6 and 0.1, others at 0.9, 0.3 and twice at 0."""
    prob = np.array([0.9, 0.6, 0.1, 0.9, 0.3, 0.0, 0.0])
    truth = np.array([1, 1, 1, 0, 0, 0, 0], dtype=np.uint8)
    counts = count_by_probability(prob, truth, num_bins=4)
    assert counts.tolist() == [[2, 1], [1, 0], [0, 1], [1, 1]]
    assert count_overlap(counts).tolist() == [2, 1, 1]
    assert iou(count_overlap(counts)) == pytest.approx(50.0)
    # All said: 3 of 7; from 0.25 on 2 of 5; from 0.5 on 2 of 4; from 0.75 on 1 of 4.
    assert iou_by_threshold(counts).tolist() == pytest.approx([300 / 7, 40.0, 50.0, 25.0])
    assert best_threshold(counts) == 0.5
    assert iou_at_best(counts) == pytest.approx(50.0)
    # A third of recall each at precision 1 / 2, 2 / 3 and 3 / 7.
    assert average_precision(counts) == pytest.approx(100 / 3 * (1 / 2 + 2 / 3 + 3 / 7))
    assert share_true(counts) == pytest.approx(300 / 7)


def test_edges_of_bins_are_exact_in_float32() -> None:
    below = np.nextafter(np.float32(0.5), np.float32(0.0))
    prob = np.array([below, 0.5, 0.0, 1.0], dtype=np.float32)
    counts = count_by_probability(prob, np.ones(4, dtype=np.uint8))
    assert np.flatnonzero(counts[:, 1]).tolist() == [0, NUM_BINS // 2 - 1, NUM_BINS // 2, 1023]
    assert count_overlap(counts).tolist() == [2, 0, 2]


def test_agrees_with_scikit_learn(cells: tuple[np.ndarray, np.ndarray]) -> None:
    prob, truth = cells
    counts = count_by_probability(prob, truth)
    assert iou(count_overlap(counts)) == pytest.approx(100 * jaccard_score(truth, prob >= 0.5))
    rounded = np.floor(prob * NUM_BINS) / NUM_BINS
    exact_of_bins = 100 * average_precision_score(truth, rounded)
    assert average_precision(counts) == pytest.approx(exact_of_bins)
    threshold = best_threshold(counts)
    assert iou_at_best(counts) == pytest.approx(100 * jaccard_score(truth, prob >= threshold))
    for other in (threshold - 0.01, threshold + 0.01, 0.5):
        assert iou_at_best(counts) >= 100 * jaccard_score(truth, prob >= other)


def test_bins_cost_average_precision_next_to_nothing(
    cells: tuple[np.ndarray, np.ndarray],
) -> None:
    prob, truth = cells
    exact = 100 * average_precision_score(truth, prob)
    assert average_precision(count_by_probability(prob, truth)) == pytest.approx(exact, abs=0.1)
    coarse = average_precision(count_by_probability(prob, truth, num_bins=8))
    assert abs(coarse - exact) > 0.1


def test_sums_of_scenes_are_scores_of_all_cells(cells: tuple[np.ndarray, np.ndarray]) -> None:
    prob, truth = (of_all.reshape(4, 50, 100) for of_all in cells)
    by_scene = np.stack([count_by_probability(p, t) for p, t in zip(prob, truth, strict=True)])
    counts = count_by_probability(prob, truth)
    assert (by_scene.sum(axis=0) == counts).all()
    assert (count_overlap(by_scene).sum(axis=0) == count_overlap(counts)).all()
    # Many at once is one by one.
    for metric in (average_precision, iou_at_best, share_true):
        assert metric(by_scene).tolist() == [float(metric(of_one)) for of_one in by_scene]
    # One intersection over one union is no mean of ratios.
    ratios = iou(count_overlap(by_scene))
    assert iou(count_overlap(counts)) != pytest.approx(float(ratios.mean()), abs=1e-6)


def test_where_nothing_is_true_nothing_is_known() -> None:
    none = count_by_probability(np.full(5, 0.25), np.zeros(5, dtype=np.uint8))
    assert np.isnan(iou(count_overlap(none)))
    assert np.isnan(best_threshold(none))
    assert np.isnan(iou_at_best(none))
    assert np.isnan(average_precision(none))
    assert share_true(none) == 0.0
    # What is said and not true is no empty union.
    said = count_by_probability(np.full(5, 0.75), np.zeros(5, dtype=np.uint8))
    assert iou(count_overlap(said)) == 0.0
