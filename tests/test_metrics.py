# References are imported where they are used: the spawned processes import this file too.
import socket
from datetime import timedelta
from pathlib import Path

import numpy as np
import pytest
import torch

from shoot.metrics import (
    TOP_KS,
    PlanningMetrics,
    min_ade,
    min_fde,
    misses,
    negative_log_likelihood,
    ranks,
    template_errors,
    top_templates,
)


def _random_log_prob(num_samples, num_templates, seed=0):
    generator = np.random.default_rng(seed)
    logits = 3.0 * generator.standard_normal((num_samples, num_templates))
    return logits - np.log(np.exp(logits).sum(1, keepdims=True))


class TestRanks:
    def test_by_hand(self):
        log_prob = np.log([[0.5, 0.2, 0.3], [0.1, 0.2, 0.7]])
        assert ranks(log_prob, np.array([2, 0])).tolist() == [1, 2]

    def test_ties_rank_by_template_index(self):
        flat = np.full((4, 4), np.log(0.25))
        assert ranks(flat, np.arange(4)).tolist() == [0, 1, 2, 3]

    def test_a_diverged_model_never_ranks_first(self):
        log_prob = np.array([[np.nan, np.nan, np.nan], [np.nan, -1.0, -0.5]])
        assert ranks(log_prob, np.array([0, 2])).tolist() == [3, 1]

    def test_equals_sorting_with_ties(self):
        generator = np.random.default_rng(1)
        log_prob = -generator.integers(0, 6, (300, 25)).astype(np.float32)
        label = generator.integers(0, 25, 300)
        expected = [
            sorted(range(25), key=lambda k: (-row[k], k)).index(y)
            for row, y in zip(log_prob.tolist(), label.tolist(), strict=True)
        ]
        assert ranks(log_prob, label).tolist() == expected

    def test_works_on_a_broadcast_prior(self):
        prior = _random_log_prob(1, 30)[0]
        label = np.arange(30)
        shared = ranks(np.broadcast_to(prior, (30, 30)), label)
        assert np.array_equal(np.argsort(shared), np.argsort(-prior))


class TestTopTemplates:
    def test_contains_the_label_exactly_where_its_rank_is_below_k(self):
        generator = np.random.default_rng(2)
        log_prob = -generator.integers(0, 9, (2500, 40)).astype(np.float32)  # more than one chunk
        label = generator.integers(0, 40, 2500)
        rank = ranks(log_prob, label)
        for k in TOP_KS:
            assert np.array_equal((top_templates(log_prob, k) == label[:, None]).any(1), rank < k)

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
        assert np.mean(ranks(log_prob, label) < k) == pytest.approx(expected)
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
        rank = ranks(log_prob, label)
        for k in TOP_KS:
            assert values[f"top{k}"] == pytest.approx(100.0 * np.mean(rank < k))
        assert values["nll"] == pytest.approx(negative_log_likelihood(log_prob, label).mean())

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
    # This process is one of the two: importing torch is most of the test's time.
    other = torch.multiprocessing.get_context("spawn").Process(
        target=_run_rank, args=(1, port, str(tmp_path))
    )
    other.start()
    _run_rank(0, port, str(tmp_path))
    other.join()
    assert other.exitcode == 0
    alone = PlanningMetrics()
    alone.update(*_ddp_samples())
    expected = alone.compute()
    for rank in range(2):
        assert torch.load(tmp_path / f"{rank}.pt") == pytest.approx(expected)
