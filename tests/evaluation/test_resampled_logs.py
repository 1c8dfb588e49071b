"""Intervals over logs, each of which holds several scenes."""

import numpy as np
import pytest
from report_case import make_case

from shoot.evaluation.report import evaluate
from shoot.metrics.bootstrap import interval
from shoot.metrics.ranks import rank_labels
from shoot.report.html import PageDetails, render_page
from shoot.report.terminal import format_table


@pytest.fixture(scope="module")
def case():
    return make_case()


@pytest.fixture(scope="module")
def report(case):
    return evaluate(**case)


class TestLogs:
    """12 scenes of 4 logs, the last of which has only one of them."""

    logs = np.repeat(["a", "a", "a", "a", "a", "b", "b", "b", "c", "c", "c", "d"], 20)

    @pytest.fixture(scope="class")
    def by_log(self, case):
        return evaluate(**case, logs=self.logs)

    def test_are_drawn_whole_and_means_stay(self, case, report, by_log):
        labels = case["labels"]
        hits = 100.0 * rank_labels(case["log_probs"]["model"], labels).hits(10)
        prior = np.tile(case["log_probs"]["prior"], (240, 1))
        prior_hits = 100.0 * rank_labels(prior, labels).hits(10)
        found = by_log.overall
        assert found.methods["model"]["top10"] == interval(hits, self.logs)
        assert found.methods["model"]["top10"] != report.overall.methods["model"]["top10"]
        assert found.differences["prior"]["top10"] == interval(hits - prior_hits, self.logs)
        for name, metric in report.overall.methods["model"].items():
            assert found.methods["model"][name].value == pytest.approx(metric.value)

    def test_are_counted_and_named(self, report, by_log):
        loaded = by_log.to_json()
        assert (loaded["resampled"], loaded["num_scenes"], loaded["num_groups"]) == ("logs", 12, 4)
        assert loaded["by_condition"]["rain"]["num_groups"] == 2
        loaded = report.to_json()
        assert (loaded["resampled"], loaded["num_groups"]) == ("scenes", 12)

    def test_are_named_in_the_table_and_on_the_page(self, report, by_log):
        titles = [" ".join(format_table(found).split()) for found in (by_log, report)]
        assert "240 samples of 12 scenes (95 % intervals over 4 logs)" in titles[0]
        assert "240 samples of 12 scenes (95 % intervals over scenes)" in titles[1]
        details = PageDetails("run", "last", "data", "now", 30)
        pages = [render_page(found, {}, details) for found in (by_log, report)]
        assert "240 of 12 scenes of 4 logs" in pages[0]
        assert "95 % intervals over 4 logs: whole logs are drawn again" in pages[0]
        assert "logs" not in pages[1]
        assert "95 % intervals over scenes: whole scenes are drawn again" in pages[1]

    def test_one_alone_has_no_interval_though_it_has_scenes(self, case):
        found = evaluate(**case, logs=np.full(240, "a"))
        assert np.isnan(found.overall.methods["model"]["top10"].low)
        page = render_page(found, {}, PageDetails("run", "last", "data", "now", 30))
        assert "one log only" in page
