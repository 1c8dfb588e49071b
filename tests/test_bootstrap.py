import math

import numpy as np
import pytest

from shoot.bootstrap import Interval, SceneBootstrap, interval, paired_interval


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
    paired = paired_interval(better, values, scene)
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
        SceneBootstrap(np.zeros(0, dtype=int))
