import numpy as np
import pytest

from shoot.metrics.displacement import expected_ade, open_loop_l2, template_ade

TIME_S = 0.25 * np.arange(1, 21)


def _paths(generator, num_paths):
    steps = generator.normal(1.5, 1.0, (num_paths, 20, 1)) * [1.0, 0.3]
    return (steps + generator.normal(0.0, 0.2, (num_paths, 20, 2))).cumsum(axis=1)


def test_template_ade_equals_all_distances_at_once():
    generator = np.random.default_rng(0)
    futures, templates = _paths(generator, 1500), _paths(generator, 7)  # more than one chunk
    expected = np.linalg.norm(futures[:, None] - templates, axis=-1).mean(axis=-1)
    found = template_ade(futures, templates.astype(np.float32))
    assert found.dtype == np.float32
    np.testing.assert_allclose(found, expected, atol=1e-4)


def test_expected_ade_by_hand():
    ade_m = np.array([[1.0, 3.0], [0.0, 8.0]], dtype=np.float32)
    assert expected_ade(np.array([[0.5, 0.5], [0.25, 0.75]]), ade_m).tolist() == [2.0, 6.0]
    assert expected_ade(np.array([[0.5, 0.5]]), ade_m).tolist() == [2.0, 4.0]


def test_expected_ade_is_the_mean_of_drawn_templates():
    generator = np.random.default_rng(1)
    ade_m = template_ade(_paths(generator, 3), _paths(generator, 50))
    prob = generator.dirichlet(np.full(50, 0.3), 3)
    drawn = [ade_m[row][generator.choice(50, 40_000, p=prob[row])] for row in range(3)]
    spread = np.std(drawn, axis=1) / np.sqrt(40_000)
    assert np.all(np.abs(expected_ade(prob, ade_m) - np.mean(drawn, axis=1)) < 5.0 * spread)


class TestOpenLoopL2:
    def test_a_growing_error_tells_the_conventions_apart(self):
        """1 m/s too fast: h metres off at h, and (0.5 + 1 + ... + h) / 2h on average."""
        driven = np.stack([4.0 * TIME_S, 0.0 * TIME_S], axis=-1)[None]
        chosen = np.stack([5.0 * TIME_S, 0.0 * TIME_S], axis=-1)[None]
        errors = {key: float(value[0]) for key, value in open_loop_l2(chosen, driven).items()}
        assert errors == pytest.approx(
            {
                "l2_at_1s": 1.0,
                "l2_at_2s": 2.0,
                "l2_at_3s": 3.0,
                "l2_upto_1s": 0.75,
                "l2_upto_2s": 1.25,
                "l2_upto_3s": 1.75,
            }
        )

    def test_an_error_that_does_not_grow_is_the_same_in_both(self):
        driven = _paths(np.random.default_rng(2), 4)
        errors = open_loop_l2(driven + np.array([3.0, 4.0]), driven)
        np.testing.assert_allclose(np.stack(list(errors.values())), 5.0)

    def test_sees_only_every_half_second(self):
        driven = np.zeros((1, 20, 2))
        chosen = driven.copy()
        chosen[0, 0::2] = 100.0  # 0.25 s, 0.75 s, ...
        chosen[0, 1, 1] = 6.0  # 0.5 s
        errors = {key: float(value[0]) for key, value in open_loop_l2(chosen, driven).items()}
        assert (errors["l2_at_1s"], errors["l2_at_3s"]) == (0.0, 0.0)
        assert errors["l2_upto_1s"] == pytest.approx(3.0)
        assert errors["l2_upto_3s"] == pytest.approx(1.0)

    def test_paths_that_end_early_have_no_later_errors(self):
        driven = np.zeros((2, 8, 2))
        errors = open_loop_l2(driven + 1.0, driven)
        np.testing.assert_allclose(errors["l2_at_2s"], np.sqrt(2.0))
        assert set(errors) == {f"l2_{how}_{s}s" for how in ("at", "upto") for s in (1, 2)}

    def test_another_step_means_the_same_times(self):
        chosen = np.random.default_rng(3).normal(size=(5, 30, 2)).cumsum(axis=1)
        fine, coarse = open_loop_l2(chosen, 0.0 * chosen, 0.1), chosen[:, 4::5]
        for key, value in open_loop_l2(coarse, 0.0 * coarse, 0.5).items():
            np.testing.assert_array_equal(value, fine[key])

    def test_times_between_points_have_no_errors(self):
        """At 0.3 s only 3 s is a point; at 1 s all are, but not the half seconds before."""
        driven = np.zeros((1, 10, 2))
        chosen = driven + np.arange(1.0, 11.0)[:, None] * [1.0, 0.0]
        assert open_loop_l2(chosen, driven, 0.3) == {"l2_at_3s": 10.0}
        found = {key: float(value[0]) for key, value in open_loop_l2(chosen, driven, 1.0).items()}
        assert found == {"l2_at_1s": 1.0, "l2_at_2s": 2.0, "l2_at_3s": 3.0}
        assert open_loop_l2(chosen, driven, 0.7) == {}
