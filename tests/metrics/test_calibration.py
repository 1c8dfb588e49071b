import numpy as np
import pytest

from shoot.metrics.bootstrap import GroupBootstrap
from shoot.metrics.calibration import (
    brier_score,
    calibration_error,
    calibration_terms,
    equal_mass_bins,
    measure_reliability,
)


def _error(confidence, hit, num_bins=10):
    sums = calibration_terms(confidence, np.asarray(hit, dtype=float), num_bins).sum(
        axis=0, keepdims=True
    )
    return float(calibration_error(sums)[0])


def _random_prob(num_samples, num_templates, seed=0):
    logits = 2.0 * np.random.default_rng(seed).standard_normal((num_samples, num_templates))
    prob = np.exp(logits)
    return prob / prob.sum(axis=1, keepdims=True)


class TestBrierScore:
    def test_by_hand(self):
        prob = np.array([[0.7, 0.2, 0.1], [1.0, 0.0, 0.0], [1.0, 0.0, 0.0]])
        score = brier_score(prob, np.array([0, 0, 2]))
        np.testing.assert_allclose(score, [0.09 + 0.04 + 0.01, 0.0, 2.0])

    def test_agrees_with_sklearn_template_by_template(self):
        from sklearn.metrics import brier_score_loss

        prob = _random_prob(200, 12)
        label = np.random.default_rng(1).integers(0, 12, 200)
        expected = sum(brier_score_loss(label == k, prob[:, k], pos_label=True) for k in range(12))
        assert brier_score(prob, label).mean() == pytest.approx(expected)

    def test_shared_probabilities_equal_those_written_out(self):
        prob = _random_prob(1, 30)
        label = np.arange(30)
        written_out = brier_score(np.tile(prob, (30, 1)), label)
        np.testing.assert_array_equal(brier_score(prob, label), written_out)

    def test_a_sure_planner_in_float32_is_not_negative(self):
        prob = np.full((1, 1000), 1e-8, dtype=np.float32)
        prob[0, 3] = 1.0 - 1e-5
        expected = np.square(1.0 - np.float64(prob[0, 3])) + 999 * np.square(np.float64(prob[0, 0]))
        assert brier_score(prob, np.array([3])) == pytest.approx([expected], rel=1e-4)


class TestBins:
    def test_equal_mass_ascending(self):
        place = np.random.default_rng(2).permutation(100)
        assert equal_mass_bins(place / 100).tolist() == (place // 10).tolist()

    def test_sizes_differ_by_one_at_most_without_ties(self):
        confidence = np.random.default_rng(3).random(1234)
        count = np.bincount(equal_mass_bins(confidence, 7))
        assert len(count) == 7
        assert count.max() - count.min() <= 1

    def test_ties_stay_together(self):
        confidence = np.round(np.random.default_rng(4).random(300), 1)
        bins = equal_mass_bins(confidence)
        for value in np.unique(confidence):
            assert len(np.unique(bins[confidence == value])) == 1
        assert np.all(np.diff(bins[np.argsort(confidence, kind="stable")]) >= 0)
        assert np.unique(bins).tolist() == list(range(bins.max() + 1))

    def test_one_confidence_makes_one_bin(self):
        assert equal_mass_bins(np.full(50, 0.2)).tolist() == [0] * 50

    def test_fewer_samples_than_bins_have_their_own(self):
        assert equal_mass_bins(np.array([0.5, 0.1, 0.9])).tolist() == [1, 0, 2]

    def test_no_bins_are_refused(self):
        with pytest.raises(ValueError, match="at least 1, got 0"):
            equal_mass_bins(np.array([0.5]), 0)


class TestCalibrationError:
    def test_by_hand(self):
        confidence = np.array([0.2, 0.4, 0.6, 0.8])
        hit = np.array([0.0, 0.0, 1.0, 1.0])
        # Two bins: 0.3 said and 0 right, 0.7 said and 1 right.
        assert _error(confidence, hit, 2) == pytest.approx(30.0)
        # One bin: 0.5 said and 0.5 right.
        assert _error(confidence, hit, 1) == pytest.approx(0.0)
        reliability = measure_reliability(confidence, hit, 2)
        np.testing.assert_allclose(reliability.confidence, [0.3, 0.7])
        assert reliability.accuracy.tolist() == [0.0, 1.0]
        assert reliability.count.tolist() == [2, 2]

    def test_agrees_with_torchmetrics_where_its_bins_hold_equally_many(self):
        """Its bins are equally wide; 40 samples in each of them make them ours, too."""
        import torch
        from torchmetrics.classification import MulticlassCalibrationError

        generator = np.random.default_rng(5)
        width = generator.uniform(0.045, 0.095, (10, 40))  # above 1 / 30, so it is the top
        confidence = generator.permutation((np.arange(10)[:, None] / 10 + width).ravel())
        top, label = generator.integers(0, 30, 400), generator.integers(0, 30, 400)
        label = np.where(generator.random(400) < 0.6, top, label)
        prob = np.repeat((1.0 - confidence[:, None]) / 29, 30, axis=1)
        prob[np.arange(400), top] = confidence
        metric = MulticlassCalibrationError(30, n_bins=10, norm="l1")
        expected = 100.0 * float(metric(torch.from_numpy(prob), torch.from_numpy(label)))
        assert expected > 5.0
        assert _error(confidence, top == label) == pytest.approx(expected, rel=1e-5)

    def test_is_the_mean_gap_of_the_reliability(self):
        generator = np.random.default_rng(6)
        confidence = generator.random(500)
        hit = (generator.random(500) < confidence**2).astype(float)
        bins = measure_reliability(confidence, hit)
        gap = np.abs(bins.accuracy - bins.confidence)
        expected = 100.0 * float((bins.count * gap).sum() / bins.count.sum())
        assert _error(confidence, hit) == pytest.approx(expected)

    def test_of_many_calibrated_samples_is_small(self):
        generator = np.random.default_rng(7)
        confidence = generator.random(40_000)
        assert _error(confidence, generator.random(40_000) < confidence) < 1.0

    def test_interval_keeps_the_bins_of_the_whole_sample(self):
        """As drawing samples in a loop does, with each sample's bin fixed beforehand."""
        generator = np.random.default_rng(8)
        scene = np.repeat(np.arange(15), 20)
        confidence = generator.random(300)
        hit = (generator.random(300) < 0.3 + 0.3 * confidence).astype(float)
        bootstrap = GroupBootstrap(scene, num_draws=3000)
        found = bootstrap.statistic(calibration_terms(confidence, hit), calibration_error)
        bins, gap = equal_mass_bins(confidence), hit - confidence
        errors = []
        for _ in range(3000):
            rows = np.concatenate([np.flatnonzero(scene == s) for s in generator.choice(15, 15)])
            of_bins = [gap[rows][bins[rows] == b].sum() for b in range(10)]
            errors.append(100.0 * np.abs(of_bins).sum() / len(rows))
        tolerance = 0.15 * np.std(errors)
        assert found.value == pytest.approx(_error(confidence, hit))
        assert found.low == pytest.approx(np.percentile(errors, 2.5), abs=tolerance)
        assert found.high == pytest.approx(np.percentile(errors, 97.5), abs=tolerance)
