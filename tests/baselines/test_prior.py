import numpy as np
import pytest

from shoot.baselines.folds import scene_folds
from shoot.baselines.prior import SMOOTHINGS, fit_prior, prior_log_prob


class TestFolds:
    def test_keep_scenes_whole_and_share_them_out_evenly(self):
        scene = np.repeat(np.arange(100, 123), 7)
        fold = scene_folds(scene, num_folds=5)
        of_scene = [set(fold[scene == name]) for name in np.unique(scene)]
        assert all(len(folds) == 1 for folds in of_scene)
        assert sorted(np.bincount([folds.pop() for folds in of_scene])) == [4, 4, 5, 5, 5]

    def test_fewer_scenes_than_folds(self):
        assert set(scene_folds(np.array([3, 3, 8]), num_folds=5)) == {0, 1}
        assert set(scene_folds(np.array([3, 3]), num_folds=5)) == {0}


class TestPrior:
    def test_by_hand(self):
        log_prob = prior_log_prob(np.array([0, 0, 0, 2]), 3, smoothing=1.0)
        np.testing.assert_allclose(np.exp(log_prob), [4 / 7, 1 / 7, 2 / 7])

    @pytest.mark.parametrize("smoothing", [0.0, -1.0, float("nan")])
    def test_smoothing_must_be_positive(self, smoothing):
        with pytest.raises(ValueError, match="smoothing must be above 0"):
            prior_log_prob(np.array([0]), 3, smoothing)

    @pytest.mark.parametrize("label", [-1, 3])
    def test_labels_of_other_templates_are_refused(self, label):
        with pytest.raises(ValueError, match=r"must lie in 0\.\.2"):
            prior_log_prob(np.array([0, label]), 3)

    def test_fitted_smoothing_is_about_the_best_on_new_scenes(self):
        generator = np.random.default_rng(0)
        frequency = generator.dirichlet(np.full(200, 0.2))
        labels = generator.choice(200, size=600, p=frequency)
        scene = np.repeat(np.arange(60), 10)

        def expected_nll(log_prob):
            return -(frequency * log_prob).sum()

        nll = [expected_nll(prior_log_prob(labels, 200, s)) for s in SMOOTHINGS]
        assert max(nll) - min(nll) > 0.1
        assert expected_nll(fit_prior(labels, scene, 200)) < min(nll) + 0.02

    def test_one_scene_falls_back_to_plain_smoothing(self):
        labels = np.array([0, 1, 1])
        expected = prior_log_prob(labels, 4)
        np.testing.assert_array_equal(fit_prior(labels, np.zeros(3), 4), expected)
