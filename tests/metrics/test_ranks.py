import socket
from datetime import timedelta
from pathlib import Path

import numpy as np
import pytest
import torch
from world_fixture import start_beside

from shoot.metrics.ranks import (
    TOP_KS,
    PlanningMetrics,
    min_ade,
    min_fde,
    misses,
    negative_log_likelihood,
    rank_labels,
    template_errors,
    top_templates,
)


def _random_log_prob(num_samples, num_templates, seed=0):
    generator = np.random.default_rng(seed)
    logits = 3.0 * generator.standard_normal((num_samples, num_templates))
    return logits - np.log(np.exp(logits).sum(1, keepdims=True))


def _with_ties(num_samples, num_templates, num_levels, seed):
    """Few levels, so that many templates are equally probable; and labels."""
    generator = np.random.default_rng(seed)
    levels = -generator.random(num_levels).astype(np.float32)
    rows = levels[generator.integers(0, num_levels, (num_samples, num_templates))]
    return rows, generator.integers(0, num_templates, num_samples)


class TestRankLabels:
    def test_by_hand(self):
        log_prob = np.log([[0.5, 0.2, 0.3], [0.1, 0.2, 0.7]])
        found = rank_labels(log_prob, np.array([2, 0]))
        assert (found.num_before.tolist(), found.num_tied.tolist()) == ([1, 2], [1, 1])

    def test_ties_share_their_places_by_hand(self):
        # One template before the label; the label and two others then share places 2, 3 and 4.
        found = rank_labels(np.array([[-1.0, -2.0, -2.0, -3.0, -2.0]]), np.array([4]))
        assert (found.num_before.tolist(), found.num_tied.tolist()) == ([1], [3])
        hits = [found.hits(k)[0] for k in range(1, 6)]
        assert hits == pytest.approx([0.0, 1 / 3, 2 / 3, 1.0, 1.0])

    def test_a_planner_that_says_nothing_has_k_of_all_whatever_is_driven(self):
        # Labels as they are: the first templates are the most frequent by far.
        label = np.minimum(np.random.default_rng(1).geometric(0.05, 500) - 1, 199)
        nothing = rank_labels(np.full((500, 200), -np.log(200.0)), label)
        running = PlanningMetrics()
        running.update(torch.zeros(500, 200).log_softmax(dim=-1), torch.from_numpy(label))
        for k in TOP_KS:
            np.testing.assert_allclose(nothing.hits(k), k / 200)
            assert running.compute()[f"top{k}"] == pytest.approx(100.0 * k / 200)

    def test_agrees_with_shuffling_the_templates_many_times(self):
        log_prob, label = _with_ties(40, 25, 6, seed=2)
        generator = np.random.default_rng(3)
        share = np.zeros((len(TOP_KS), 40))
        for _ in range(2000):
            shuffled = generator.permutation(25)
            best = shuffled[top_templates(log_prob[:, shuffled], 25)]
            place = (best == label[:, None]).argmax(axis=1)
            share += place < np.array(TOP_KS)[:, None]
        found = rank_labels(log_prob, label)
        for k, expected in zip(TOP_KS, share / 2000, strict=True):
            np.testing.assert_allclose(found.hits(k), expected, atol=0.06)  # five deviations

    def test_the_order_of_templates_does_not_matter(self):
        log_prob, label = _with_ties(60, 30, 4, seed=4)
        new_of_old = np.random.default_rng(5).permutation(30)
        moved = np.empty_like(log_prob)
        moved[:, new_of_old] = log_prob
        here, there = rank_labels(log_prob, label), rank_labels(moved, new_of_old[label])
        for k in TOP_KS:
            np.testing.assert_array_equal(here.hits(k), there.hits(k))

    def test_a_diverged_model_never_ranks_first(self):
        log_prob = np.array([[np.nan, np.nan, np.nan], [np.nan, -1.0, -0.5]])
        found = rank_labels(log_prob, np.array([0, 2]))
        assert found.num_before.tolist() == [3, 1]
        assert found.hits(1).tolist() == [0.0, 0.0]
        assert found.hits(2).tolist() == [0.0, 1.0]
        assert found.hits(20).tolist() == [0.0, 1.0]

    def test_works_on_a_broadcast_prior(self):
        prior = _random_log_prob(1, 30)[0]
        label = np.arange(30)
        shared = rank_labels(np.broadcast_to(prior, (30, 30)), label).num_before
        assert np.array_equal(np.argsort(shared), np.argsort(-prior))


class TestTopTemplates:
    def test_contains_the_label_exactly_where_it_hits(self):
        generator = np.random.default_rng(2)
        log_prob = generator.random((2500, 40)).astype(np.float32)  # more than one chunk
        label = generator.integers(0, 40, 2500)
        ranks = rank_labels(log_prob, label)
        assert (ranks.num_tied == 1).all()
        for k in TOP_KS:
            within = (top_templates(log_prob, k) == label[:, None]).any(1)
            assert np.array_equal(within, ranks.hits(k))

    def test_ties_are_chosen_by_index(self):
        log_prob, _ = _with_ties(300, 25, 6, seed=1)
        expected = [sorted(range(25), key=lambda k: (-row[k], k)) for row in log_prob.tolist()]
        assert top_templates(log_prob, 25).tolist() == expected

    def test_fewer_templates_than_k_gives_all(self):
        assert top_templates(np.log([[0.2, 0.8]]), 20).tolist() == [[1, 0]]

    def test_k_below_one_is_refused(self):
        with pytest.raises(ValueError, match="at least 1, got 0"):
            top_templates(np.zeros((1, 3)), 0)


def test_accuracy_and_nll_agree_with_sklearn():
    from sklearn.metrics import log_loss, top_k_accuracy_score

    log_prob = _random_log_prob(400, 30)
    label = np.random.default_rng(3).integers(0, 30, 400)
    classes = np.arange(30)
    for k in TOP_KS:
        expected = top_k_accuracy_score(label, log_prob, k=k, labels=classes)
        assert rank_labels(log_prob, label).hits(k).mean() == pytest.approx(expected)
    expected = log_loss(label, np.exp(log_prob), labels=classes)
    assert negative_log_likelihood(log_prob, label).mean() == pytest.approx(expected)


class TestTemplateErrors:
    templates = np.array([[[1.0, 0.0], [2.0, 0.0]], [[1.0, 3.0], [2.0, 4.0]], [[4.0, 4.0]] * 2])
    future = np.array([[[1.0, 0.0], [2.0, 1.0]]])

    def test_by_hand(self):
        errors = template_errors(self.templates, self.future, np.array([[1, 0]]))
        assert errors.mean_m.tolist() == [[3.0, 0.5]]
        assert errors.final_m.tolist() == [[3.0, 1.0]]
        assert errors.max_m.tolist() == [[3.0, 1.0]]
        assert min_ade(errors, 1).tolist() == [3.0]
        assert min_ade(errors, 2).tolist() == [0.5]
        assert min_fde(errors, 2).tolist() == [1.0]
        assert misses(errors, 1).tolist() == [1.0]
        assert misses(errors, 2).tolist() == [0.0]

    def test_a_point_in_the_middle_makes_a_miss_and_two_metres_is_one(self):
        templates = np.array([[[0.0, 0.0], [0.0, 2.0], [0.0, 0.0]]])
        still = np.zeros((1, 3, 2))
        errors = template_errors(templates, still, np.array([[0]]))
        assert min_fde(errors, 1).tolist() == [0.0]
        assert misses(errors, 1).tolist() == [1.0]
        assert misses(errors, 1, miss_m=2.001).tolist() == [0.0]

    def test_agree_with_the_devkit(self):
        from nuscenes.eval.prediction import metrics as devkit

        generator = np.random.default_rng(4)
        templates = 4.0 * generator.standard_normal((25, 12, 2)).cumsum(1) * 0.1
        futures = 4.0 * generator.standard_normal((50, 12, 2)).cumsum(1) * 0.1
        log_prob = _random_log_prob(50, 25)
        errors = template_errors(templates, futures, top_templates(log_prob, 20))
        bank = np.broadcast_to(templates, (50, *templates.shape))
        truth = np.repeat(futures[:, None], 25, axis=1)
        prob = np.exp(log_prob)
        ade = devkit.min_ade_k(bank, truth, prob)
        fde = devkit.min_fde_k(bank, truth, prob)
        miss = devkit.miss_rate_top_k(bank, truth, prob, 2.0)
        assert 0.1 < miss[:, 4].mean() < 0.9
        for k in TOP_KS:
            np.testing.assert_allclose(min_ade(errors, k), ade[:, k - 1])
            np.testing.assert_allclose(min_fde(errors, k), fde[:, k - 1])
            np.testing.assert_array_equal(misses(errors, k), miss[:, k - 1])


class TestPlanningMetrics:
    def test_over_uneven_batches_equals_numpy_on_all(self):
        log_prob = _random_log_prob(101, 40).astype(np.float32)
        label = np.random.default_rng(5).integers(0, 40, 101)
        metric = PlanningMetrics()
        for rows in np.split(np.arange(101), [7, 8, 60]):
            metric.update(torch.from_numpy(log_prob[rows]), torch.from_numpy(label[rows]))
        values = metric.compute()
        ranks = rank_labels(log_prob, label)
        for k in TOP_KS:
            assert values[f"top{k}"] == pytest.approx(100.0 * ranks.hits(k).mean())
        assert values["nll"] == pytest.approx(negative_log_likelihood(log_prob, label).mean())

    @pytest.mark.parametrize("dtype", [np.float32, np.float64])
    def test_ties_and_what_is_no_number_equal_numpy(self, dtype):
        log_prob, label = _with_ties(400, 30, 5, seed=8)
        log_prob = log_prob.astype(dtype)
        log_prob[::7, 3] = np.nan
        log_prob[::9, 4] = -np.inf
        assert np.isnan(log_prob[np.arange(400), label]).any()
        metric = PlanningMetrics()
        for rows in np.split(np.arange(400), [7, 90]):
            metric.update(torch.from_numpy(log_prob[rows]), torch.from_numpy(label[rows]))
        ranks = rank_labels(log_prob, label)
        for k in TOP_KS:
            expected = pytest.approx(100.0 * ranks.hits(k).mean(), rel=1e-12)
            assert metric.compute()[f"top{k}"] == expected

    def test_agrees_with_torchmetrics(self):
        from torchmetrics.classification import MulticlassAccuracy

        log_prob = torch.from_numpy(_random_log_prob(64, 30))
        label = torch.from_numpy(np.random.default_rng(6).integers(0, 30, 64))
        metric = PlanningMetrics(ks=(1, 5))
        metric.update(log_prob, label)
        for k in (1, 5):
            expected = MulticlassAccuracy(30, top_k=k, average="micro")(log_prob, label)
            assert metric.compute()[f"top{k}"] == pytest.approx(100.0 * float(expected))

    def test_a_diverged_model_scores_nothing(self):
        metric = PlanningMetrics()
        metric.update(torch.full((3, 30), torch.nan), torch.tensor([0, 1, 2]))
        values = metric.compute()
        assert [values[f"top{k}"] for k in TOP_KS] == [0.0] * 4
        assert np.isnan(values["nll"])

    @pytest.mark.filterwarnings("ignore:The ``compute`` method")
    def test_reset_forgets_and_nothing_seen_is_nan(self):
        metric = PlanningMetrics()
        metric.update(torch.zeros(2, 3), torch.tensor([0, 1]))
        metric.reset()
        assert all(np.isnan(value) for value in metric.compute().values())

    def test_holds_no_graph(self):
        metric = PlanningMetrics()
        metric.update(torch.zeros(2, 3, requires_grad=True), torch.tensor([0, 1]))
        assert not metric.nll_sum.requires_grad


def _ddp_samples():
    log_prob = torch.from_numpy(_random_log_prob(23, 30).astype(np.float32))
    return log_prob, torch.from_numpy(np.random.default_rng(7).integers(0, 30, 23))


def _run_rank(rank: int, port: int, folder: str) -> None:
    torch.distributed.init_process_group(
        "gloo",
        init_method=f"tcp://127.0.0.1:{port}",
        rank=rank,
        world_size=2,
        timeout=timedelta(minutes=5),
    )
    try:
        log_prob, label = _ddp_samples()
        metric = PlanningMetrics()
        # Rank 0: 8 + 8 samples in two batches; rank 1: 7 in one.
        for rows in ([slice(0, 8), slice(8, 16)], [slice(16, 23)])[rank]:
            metric.update(log_prob[rows], label[rows])
        torch.save(metric.compute(), f"{folder}/{rank}.pt")
    finally:
        torch.distributed.destroy_process_group()


def test_two_processes_give_the_values_of_one(tmp_path: Path):
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    # This process is one of the two.
    other = start_beside(_run_rank, 1, port, str(tmp_path), log=tmp_path / "log")
    _run_rank(0, port, str(tmp_path))
    other.join()
    assert other.exitcode == 0, (tmp_path / "log").read_text()
    alone = PlanningMetrics()
    alone.update(*_ddp_samples())
    expected = alone.compute()
    for rank in range(2):
        assert torch.load(tmp_path / f"{rank}.pt") == pytest.approx(expected)
