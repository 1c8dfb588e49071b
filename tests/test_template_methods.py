"""Methods of making templates: what each promises, on cases worked out by hand and at random."""

from pathlib import Path
from typing import Any, get_args

import numpy as np
import pytest

from lss_core.errors import DataError
from shoot.templates import TemplateSet, fit_templates
from shoot.templates.methods import Method, choose_templates
from shoot.templates.methods.cover import candidates, cover, fit_cover
from shoot.templates.methods.distinct import distinct_futures
from shoot.templates.methods.factored import drive, fit_factored, paths_and_profiles
from shoot.templates.methods.farthest import farthest_points
from shoot.templates.methods.medoids import medoids

TIMES_S = 0.25 * np.arange(1, 21)
OTHERS = [method for method in get_args(Method) if method != "kmeans"]


def arcs(speeds_mps: Any, curvatures: Any) -> np.ndarray:
    """[S * C, 20, 2] futures at constant speeds on circles (1/m, left is positive)."""
    speed, bend = (a.ravel() for a in np.meshgrid(speeds_mps, curvatures, indexing="ij"))
    way_m = speed[:, None] * TIMES_S
    angle = bend[:, None] * way_m
    x_m = way_m * np.sinc(angle / np.pi)
    y_m = 0.5 * bend[:, None] * way_m**2 * np.sinc(0.5 * angle / np.pi) ** 2
    return np.stack([x_m, y_m], axis=-1)


def drives(num: int = 250, seed: int = 0) -> np.ndarray:
    """Futures of many speeds and bends; some of them twice, some at rest."""
    rng = np.random.default_rng(seed)
    speed, bend = rng.gamma(3.0, 2.5, num), rng.normal(0.0, 0.02, num)
    futures = np.concatenate([arcs(s, b) for s, b in zip(speed, bend, strict=True)])
    futures[: num // 10] = 0.0
    futures[-num // 10 :] = futures[num // 2 : num // 2 + num // 10]
    return futures


def members(templates: np.ndarray, futures: np.ndarray) -> bool:
    known = {future.tobytes() for future in futures.astype(np.float32)}
    return all(template.tobytes() in known for template in templates.astype(np.float32))


def worst_m(futures: np.ndarray, templates: np.ndarray) -> float:
    """Pointwise, at the worst point, to whichever template makes it least, by the plain road."""
    apart = np.linalg.norm(futures[:, None] - templates[None], axis=-1).max(axis=-1)
    return float(apart.min(axis=1).max())


def test_farthest_points_are_the_corners() -> None:
    rng = np.random.default_rng(0)
    corners = np.array([[10.0, 10.0], [-10.0, 10.0], [10.0, -10.0], [-10.0, -10.0]])
    points = np.concatenate([rng.uniform(-4.0, 4.0, (50, 2)), corners])
    found = farthest_points(points, 5)
    assert set(found.rows[1:]) == {50, 51, 52, 53}
    assert found.rows[0] == np.linalg.norm(points - points.mean(axis=0), axis=1).argmin()


def test_farthest_points_are_the_plain_ones() -> None:
    points = np.random.default_rng(1).normal(0.0, 5.0, (300, 6))
    found = farthest_points(points, 40)
    rows = [int(found.rows[0])]
    for _ in range(39):
        apart = np.linalg.norm(points[:, None] - points[rows], axis=-1).min(axis=1)
        rows.append(int(apart.argmax()))
    assert found.rows.tolist() == rows
    nearest = np.linalg.norm(points[:, None] - points[rows], axis=-1).argmin(axis=1)
    assert found.nearest.tolist() == nearest.tolist()
    assert farthest_points(points, 40, rows[:7]).rows.tolist() == rows


def test_cover_of_parallel_lanes_by_every_second_step() -> None:
    # Nine futures side by side, 1 m apart: three, each with its neighbours, cover all within 1 m.
    lanes = np.zeros((9, 20, 2))
    lanes[:, :, 0] = 8.0 * TIMES_S
    lanes[:, -1, 1] = np.arange(9.0)
    futures = distinct_futures(lanes)
    everyone = candidates(futures, np.arange(9), 3)
    assert sorted(futures.points[cover(futures, 1.0, 3, everyone), -1, 1]) == [1.0, 4.0, 7.0]
    assert cover(futures, 0.99, 8, everyone) is None
    found = fit_cover(futures, 3)
    assert 1.0 <= found.epsilon_m < 1.02
    assert found.num_covering == 3


@pytest.mark.parametrize("num", [300, 900])  # all are candidates, or the farthest of them
def test_every_future_is_within_epsilon_of_the_cover(num: int) -> None:
    futures = distinct_futures(drives(num))
    found = fit_cover(futures, 30)
    assert found.rows.shape == (30,)
    covering = futures.points[found.rows[: found.num_covering]]
    assert worst_m(futures.points, covering) <= found.epsilon_m
    # It is not much larger than needed: half of it would not do.
    assert (
        cover(
            futures,
            0.5 * found.epsilon_m,
            30,
            candidates(futures, np.arange(len(futures.points)), 30),
        )
        is None
    )


def test_medoids_are_members_and_no_swap_within_a_cluster_is_better() -> None:
    futures = distinct_futures(drives(200))
    rows = medoids(futures, 12, seed=0)
    assert len(set(rows.tolist())) == 12
    apart = np.linalg.norm(futures.flat[:, None] - futures.flat[None], axis=-1)
    nearest = apart[:, rows].argmin(axis=1)
    for number, row in enumerate(rows):
        own = np.flatnonzero(nearest == number)
        sums = futures.counts[own] @ apart[np.ix_(own, own)]
        assert futures.counts[own] @ apart[own, row] == pytest.approx(sums.min())


def test_medoid_of_one_cluster_is_the_median_not_the_nearest_to_the_mean() -> None:
    ways_m = np.array([0.0, 1.0, 2.0, 3.0, 44.0])  # the mean is 10, the median 2
    lines = np.zeros((5, 20, 2))
    lines[:, -1, 0] = ways_m
    futures = distinct_futures(lines)
    assert futures.points[medoids(futures, 1, seed=0), -1, 0].tolist() == [2.0]


def test_a_future_is_a_path_times_a_profile() -> None:
    futures = arcs([2.0, 9.0, 16.0], [-0.05, 0.0, 0.02])
    paths_rad, profiles_m, gap_m = paths_and_profiles(futures, 0.25)
    made = drive(paths_rad, profiles_m, gap_m)
    again = made[np.arange(9), np.arange(9)]
    assert np.abs(again - futures).max() < 0.2
    # The path of one at the speed of another is the arc that nobody drove.
    fast_left = made[2, 7]  # 2 m/s on a bend to the left, 16 m/s straight on
    circle = arcs([16.0], [0.02])[0]
    short = TIMES_S * 16.0 < 10.0  # as far as the slow one went
    assert np.abs(fast_left - circle)[short].max() < 0.1


def test_backing_is_driven_backward() -> None:
    futures = arcs([2.0], [0.05]) * np.array([-1.0, 1.0])
    paths_rad, profiles_m, gap_m = paths_and_profiles(futures, 0.25)
    assert profiles_m[0, -1] == pytest.approx(-10.0, abs=0.05)
    assert np.abs(drive(paths_rad, profiles_m, gap_m)[0, 0] - futures[0]).max() < 0.1


def test_factored_templates_are_products_of_which_all_driven_ones_are_kept() -> None:
    futures = arcs([4.0, 8.0, 12.0, 16.0], [-0.02, 0.0, 0.02])
    made = fit_factored(distinct_futures(futures), 12, seed=0, dt_s=0.25)
    product = drive(made.paths_rad, made.profiles_m, made.gap_m)
    np.testing.assert_array_equal(made.points, product[made.path_idx, made.profile_idx])
    pairs = set(zip(made.path_idx.tolist(), made.profile_idx.tolist(), strict=True))
    assert len(pairs) == 12
    assert worst_m(futures, made.points) < 2.0


def test_too_few_products_are_refused() -> None:
    with pytest.raises(DataError, match="Only 1 of the trajectories differ"):
        choose_templates(np.ones((30, 20, 2)), 5, 0, 0.25, "factored")


@pytest.mark.parametrize("method", OTHERS)
def test_order_of_futures_plays_no_part_and_seeds_repeat(method: Method, tmp_path: Path) -> None:
    futures = drives()
    shuffled = futures[np.random.default_rng(5).permutation(len(futures))]
    first = fit_templates(futures, 20, 3, method=method)
    first.save(tmp_path / "first.npz")
    fit_templates(futures, 20, 3, method=method).save(tmp_path / "again.npz")
    assert (tmp_path / "first.npz").read_bytes() == (tmp_path / "again.npz").read_bytes()
    np.testing.assert_array_equal(
        fit_templates(shuffled, 20, 3, method=method).points, first.points
    )


@pytest.mark.parametrize("method", OTHERS)
def test_card_says_method_seed_and_settings(method: Method, tmp_path: Path) -> None:
    futures = drives()
    fitted = fit_templates(futures, 20, 3, method=method)
    fitted.save(tmp_path / "t.npz")
    card = TemplateSet.load(tmp_path / "t.npz").card
    assert (card["k"], card["seed"], card["num_futures"]) == (20, 3, 250)
    assert card["settings"]
    assert "K-Means" not in card["method"]
    assert fitted.counts.tolist() == np.bincount(fitted.nearest(futures), minlength=20).tolist()
    assert fitted.counts.tolist() == sorted(fitted.counts.tolist(), reverse=True)
    assert members(fitted.points, futures) == (method != "factored")


@pytest.mark.parametrize("method", OTHERS)
def test_as_many_as_differ_is_possible_and_one_more_is_not(method: Method) -> None:
    futures = np.repeat(drives(12, seed=4)[2:], 3, axis=0)
    distinct = len(distinct_futures(futures).points)
    assert len(fit_templates(futures, distinct, 0, method=method).points) == distinct
    with pytest.raises(DataError, match=f"Only {distinct} of the trajectories differ"):
        fit_templates(futures, distinct + 1, 0, method=method)
    with pytest.raises(DataError, match="Cannot fit 31 templates to 30 trajectories"):
        fit_templates(drives(30), 31, 0, method=method)
