import math

import numpy as np
import pytest

from shoot.metrics.bootstrap import GroupBootstrap, Interval, interval


def _scenes(generator, num_scenes, scene_std):
    """Samples in scenes of 1 to 9, alike within a scene; their expected mean is 0."""
    scene = np.repeat(np.arange(num_scenes), generator.integers(1, 10, num_scenes))
    values = scene_std * generator.standard_normal(num_scenes)[scene]
    return values + generator.standard_normal(len(scene)), scene


def test_agrees_with_a_plain_loop():
    values, scene = _scenes(np.random.default_rng(0), 12, 1.0)
    found = interval(values, scene, num_draws=4000)
    generator = np.random.default_rng(99)
    means = []
    for _ in range(4000):
        drawn = generator.choice(12, size=12)
        means.append(np.concatenate([values[scene == name] for name in drawn]).mean())
    assert found.value == pytest.approx(values.mean())
    # Two runs of 4000 draws differ by a few hundredths of the spread.
    tolerance = 0.1 * np.std(means)
    assert found.low == pytest.approx(np.percentile(means, 2.5), abs=tolerance)
    assert found.high == pytest.approx(np.percentile(means, 97.5), abs=tolerance)


def test_interval_holds_the_truth_about_95_times_in_100():
    generator = np.random.default_rng(1)
    held = 0
    for _ in range(300):
        found = interval(*_scenes(generator, 40, 2.0), num_draws=400)
        held += found.low <= 0.0 <= found.high
    # The percentile bootstrap is a little narrow at 40 scenes; +-4 standard errors around 94 %.
    assert 0.885 <= held / 300 <= 0.985


def test_alike_samples_of_a_scene_widen_the_interval():
    generator = np.random.default_rng(2)
    scene = np.repeat(np.arange(30), 20)
    values = generator.standard_normal(30)[scene]
    by_scene = interval(values, scene)
    by_sample = interval(values, np.arange(600))
    ratio = (by_scene.high - by_scene.low) / (by_sample.high - by_sample.low)
    assert ratio == pytest.approx(math.sqrt(20), rel=0.15)


def test_order_and_names_of_scenes_do_not_matter():
    values, scene = _scenes(np.random.default_rng(3), 10, 1.0)
    order = np.random.default_rng(4).permutation(len(values))
    names = np.array([f"scene-{i:04d}" for i in range(10)])
    first, second = interval(values, scene), interval(values[order], names[scene[order]])
    assert (first.low, first.high) == pytest.approx((second.low, second.high))


def test_same_seed_same_draws():
    values, scene = _scenes(np.random.default_rng(5), 10, 1.0)
    assert interval(values, scene, seed=7) == interval(values, scene, seed=7)
    assert interval(values, scene, seed=7) != interval(values, scene, seed=8)


def test_paired_cancels_what_is_common():
    generator = np.random.default_rng(6)
    values, scene = _scenes(generator, 30, 5.0)
    better = values + 0.5
    paired = interval(better - values, scene)
    assert (paired.value, paired.low, paired.high) == pytest.approx((0.5, 0.5, 0.5))
    apart = interval(better, scene)
    assert apart.low < values.mean()


def test_equal_values_have_no_width():
    found = interval(np.full(6, 3.5), np.array([0, 0, 1, 2, 2, 2]))
    assert (found.value, found.low, found.high) == pytest.approx((3.5, 3.5, 3.5))
    assert found.excludes_zero


def test_one_scene_has_a_value_and_no_interval():
    found = interval(np.array([1.0, 3.0]), np.array([4, 4]))
    assert found.value == 2.0
    assert math.isnan(found.low)
    assert math.isnan(found.high)
    assert not found.excludes_zero


@pytest.mark.parametrize(
    ("low", "high", "excludes"),
    [(0.1, 0.2, True), (-0.2, -0.1, True), (-0.1, 0.1, False), (0.0, 0.1, False)],
)
def test_excludes_zero(low, high, excludes):
    assert Interval(0.5 * (low + high), low, high).excludes_zero is excludes


def test_no_samples_are_refused():
    with pytest.raises(ValueError, match="at least one sample"):
        GroupBootstrap(np.zeros(0, dtype=int))


class TestNumbersThatDoNotApply:
    def test_are_as_if_they_were_not_there(self):
        values, scene = _scenes(np.random.default_rng(8), 12, 1.0)
        applies = np.random.default_rng(9).random(len(values)) < 0.7
        applies[np.unique(scene, return_index=True)[1]] = True  # the same scenes, the same draws
        found = interval(np.where(applies, values, np.nan), scene)
        rest = interval(values[applies], scene[applies])
        assert (found.value, found.low, found.high) == pytest.approx(
            (rest.value, rest.low, rest.high)
        )

    def test_agree_with_a_plain_loop_where_scenes_have_none(self):
        generator = np.random.default_rng(10)
        values, scene = _scenes(generator, 6, 1.0)
        values[np.isin(scene, [1, 4, 5])] = np.nan
        found = interval(values, scene, num_draws=6000)
        means = []
        for _ in range(6000):
            drawn = np.concatenate([values[scene == s] for s in generator.choice(6, size=6)])
            if not np.isnan(drawn).all():
                means.append(np.nanmean(drawn))
        assert 5800 < len(means) < 6000  # some draws have no number at all
        tolerance = 0.1 * np.std(means)
        assert found.value == pytest.approx(np.nanmean(values))
        assert found.low == pytest.approx(np.percentile(means, 2.5), abs=tolerance)
        assert found.high == pytest.approx(np.percentile(means, 97.5), abs=tolerance)

    def test_one_scene_with_numbers_has_no_interval(self):
        found = interval(np.array([1.0, 3.0, np.nan]), np.array([0, 0, 1]))
        assert found.value == 2.0
        assert math.isnan(found.low)
        assert math.isnan(found.high)

    @pytest.mark.filterwarnings("error")
    def test_no_number_at_all(self):
        found = interval(np.full(4, np.nan), np.array([0, 0, 1, 2]))
        assert all(math.isnan(number) for number in (found.value, found.low, found.high))


def test_columns_at_once_equal_one_by_one():
    generator = np.random.default_rng(11)
    first, scene = _scenes(generator, 20, 1.0)
    second = np.where(generator.random(len(first)) < 0.2, np.nan, first**2)
    bootstrap = GroupBootstrap(scene)
    together = bootstrap.intervals(np.stack([first, second], axis=1))
    for found, values in zip(together, (first, second), strict=True):
        alone = bootstrap.interval(values)
        assert (found.value, found.low, found.high) == pytest.approx(
            (alone.value, alone.low, alone.high)
        )


class TestStatistic:
    def test_of_a_mean_is_the_interval(self):
        values, scene = _scenes(np.random.default_rng(12), 15, 1.0)
        bootstrap = GroupBootstrap(scene)
        terms = np.stack([values, np.ones(len(values))], axis=1)
        found = bootstrap.statistic(terms, lambda sums: sums[:, 0] / sums[:, 1])
        expected = bootstrap.interval(values)
        assert (found.value, found.low, found.high) == pytest.approx(
            (expected.value, expected.low, expected.high)
        )

    def test_of_a_ratio_agrees_with_a_plain_loop(self):
        generator = np.random.default_rng(13)
        values, scene = _scenes(generator, 10, 1.0)
        terms = np.stack([np.abs(values), 1.0 + values**2], axis=1)

        def ratio(sums):
            return sums[:, 0] / sums[:, 1]

        found = GroupBootstrap(scene, num_draws=4000).statistic(terms, ratio)
        ratios = []
        for _ in range(4000):
            rows = np.concatenate([np.flatnonzero(scene == s) for s in generator.choice(10, 10)])
            ratios.append(float(ratio(terms[rows].sum(axis=0, keepdims=True))[0]))
        tolerance = 0.1 * np.std(ratios)
        assert found.value == pytest.approx(float(ratio(terms.sum(axis=0, keepdims=True))[0]))
        assert found.low == pytest.approx(np.percentile(ratios, 2.5), abs=tolerance)
        assert found.high == pytest.approx(np.percentile(ratios, 97.5), abs=tolerance)

    def test_one_scene_has_a_value_and_no_interval(self):
        found = GroupBootstrap(np.zeros(2)).statistic(np.ones((2, 1)), lambda sums: sums[:, 0])
        assert found.value == 2.0
        assert math.isnan(found.low)
