import json
import os
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from lss_core.errors import DataError
from shoot.templates import TemplateSet, fit_templates, fit_templates_stream


def some_futures(num: int, seed: int = 0, num_points: int = 20) -> np.ndarray:
    """Arcs of many speeds and bends, with the car standing now and then."""
    rng = np.random.default_rng(seed)
    times_s = 0.25 * np.arange(1, num_points + 1)
    speed = rng.uniform(0.0, 12.0, num)[:, None]
    bend = rng.normal(0.0, 0.1, num)[:, None]
    x_m = speed * times_s * np.cos(bend * times_s)
    y_m = speed * times_s * np.sin(bend * times_s)
    return np.stack([x_m, y_m], axis=-1)


def a_set(k: int = 6, seed: int = 3) -> TemplateSet:
    points = some_futures(k, seed).astype(np.float32)
    return TemplateSet(points, 0.25, np.arange(k), {"data": "none"})


@given(seed=st.integers(0, 10_000))
def test_label_is_the_brute_force_nearest(seed: int) -> None:
    rng = np.random.default_rng(seed)
    points = rng.normal(0.0, 20.0, (7, 20, 2)).astype(np.float32)
    templates = TemplateSet(points, 0.25, np.zeros(7, dtype=np.int64))
    futures = rng.normal(0.0, 20.0, (9, 20, 2))
    for future, label in zip(futures, templates.nearest(futures), strict=True):
        distances = [float(((future - template) ** 2).sum()) for template in points]
        assert label == min(range(7), key=distances.__getitem__)


def test_a_template_is_its_own_label_and_not_its_farthest() -> None:
    templates = a_set()
    assert templates.nearest(templates.points.astype(np.float64)).tolist() == list(range(6))


def test_nearest_is_by_all_points_not_by_the_last() -> None:
    # The first template ends where the future does but gets there another way.
    detour = np.zeros((20, 2))
    detour[:-1, 1] = 9.0
    close = np.full((20, 2), 1.0)
    templates = TemplateSet(
        np.stack([detour, close]).astype(np.float32), 0.25, np.zeros(2, dtype=np.int64)
    )
    assert templates.nearest(np.zeros((1, 20, 2))).tolist() == [1]


def test_no_futures_have_no_labels() -> None:
    assert a_set().nearest(np.zeros((0, 20, 2))).shape == (0,)


def test_other_horizon_is_refused() -> None:
    with pytest.raises(DataError, match="20 points, futures 24"):
        a_set().nearest(np.zeros((3, 24, 2)))


def test_coverage_is_the_plain_one() -> None:
    templates, futures = a_set(), some_futures(40, seed=8)
    distances = []
    for future in futures:
        nearest = min(templates.points, key=lambda t: float(((t - future) ** 2).sum()))
        distances.append(
            np.mean([np.hypot(*(p - q)) for p, q in zip(nearest, future, strict=True)])
        )
    coverage = templates.coverage(futures)
    assert coverage.mean_m == pytest.approx(np.mean(distances))
    assert coverage.median_m == pytest.approx(np.median(distances))
    assert coverage.p95_m == pytest.approx(np.quantile(distances, 0.95))
    assert coverage.max_m == pytest.approx(max(distances))
    assert coverage.count == 40


def test_coverage_of_nothing_is_refused() -> None:
    with pytest.raises(DataError, match="no trajectory"):
        a_set().coverage(np.zeros((0, 20, 2)))


def test_fit_finds_the_clusters_and_sorts_them_by_size() -> None:
    rng = np.random.default_rng(5)
    centres = some_futures(3, seed=11) + 30.0 * np.arange(3)[:, None, None]
    sizes = (4, 21, 10)
    futures = np.concatenate(
        [c + rng.normal(0.0, 0.01, (n, 20, 2)) for c, n in zip(centres, sizes, strict=True)]
    )
    fitted = fit_templates(futures, k=3, seed=0)
    assert fitted.counts.tolist() == [21, 10, 4]
    np.testing.assert_allclose(fitted.points, centres[[1, 2, 0]], atol=0.03)
    assert fitted.points.dtype == np.float32
    assert fitted.horizon_s == 5.0


def test_counts_are_the_labels_of_the_fit() -> None:
    futures = some_futures(150)
    fitted = fit_templates(futures, k=12, seed=1)
    assert fitted.counts.tolist() == np.bincount(fitted.nearest(futures), minlength=12).tolist()
    assert fitted.counts.sum() == 150
    assert (np.diff(fitted.counts) <= 0).all()


def test_as_many_templates_as_futures_are_the_futures() -> None:
    futures = some_futures(8)
    fitted = fit_templates(futures, k=8, seed=0)
    assert fitted.coverage(futures).max_m < 1e-5


def test_same_seed_same_bytes(tmp_path: Path) -> None:
    futures = some_futures(90)
    for name in ("a", "b"):
        fit_templates(futures, k=9, seed=4).save(tmp_path / f"{name}.npz")
    assert (tmp_path / "a.npz").read_bytes() == (tmp_path / "b.npz").read_bytes()
    assert (tmp_path / "a.json").read_bytes() == (tmp_path / "b.json").read_bytes()
    other = fit_templates(futures, k=9, seed=5)
    assert other.sha256 != TemplateSet.load(tmp_path / "a.npz").sha256


def test_templates_of_a_stream(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    speed, bend = rng.gamma(3.0, 2.0, 4000), rng.normal(0.0, 1.0, 4000)
    time_s = 0.25 * np.arange(1, 21)
    futures = np.stack([speed[:, None] * time_s, bend[:, None] * time_s**2], axis=-1)
    nothing = np.zeros((0, 20, 2))
    templates, sample = fit_templates_stream(
        lambda: [nothing, *np.split(futures, 8), nothing], k=30, seed=0
    )
    assert templates.points.shape == (30, 20, 2)
    assert templates.counts.tolist() == sorted(templates.counts.tolist(), reverse=True)
    assert templates.counts.sum() == templates.card["num_futures"] == 4000
    whole = fit_templates(futures, k=30, seed=0)
    more = templates.card["inertia_m2"] / whole.card["inertia_m2"] - 1.0
    assert more <= templates.card["inertia_given_up_at_most"] < 0.3
    assert np.isin(sample[:, -1, 0], futures[:, -1, 0]).all()
    templates.save(tmp_path / "t.npz")
    assert TemplateSet.load(tmp_path / "t.npz").card["method"].startswith("mini-batch")


@pytest.mark.parametrize(
    ("num", "what"), [(0, "Cannot fit 9 templates to no"), (5, "Only 1 of 5"), (50, "Only 1 of 50")]
)
def test_a_stream_of_too_few_is_refused(num: int, what: str) -> None:
    with pytest.raises(DataError, match=what):
        fit_templates_stream(lambda: [np.ones((num, 20, 2))], k=9, seed=0)


@pytest.mark.parametrize("k", [0, 31])
def test_k_must_fit_the_number_of_trajectories(k: int) -> None:
    with pytest.raises(DataError, match=f"Cannot fit {k} templates to 30 trajectories"):
        fit_templates(some_futures(30), k=k, seed=0)


def test_k_must_fit_the_number_of_distinct_trajectories() -> None:
    futures = np.repeat(some_futures(4), 10, axis=0)
    with pytest.raises(DataError, match="Only 4 of the trajectories differ"):
        fit_templates(futures, k=5, seed=0)


def test_sha256_follows_points_and_time_step() -> None:
    templates = a_set()
    moved = templates.points.copy()
    moved[2, 7, 1] += np.float32(1e-3)
    same = TemplateSet(templates.points.copy(), 0.25, np.zeros(6, dtype=np.int64))
    assert same.sha256 == templates.sha256
    assert TemplateSet(moved, 0.25, templates.counts).sha256 != templates.sha256
    assert TemplateSet(templates.points, 0.5, templates.counts).sha256 != templates.sha256
    reshaped = templates.points.reshape(12, 10, 2)
    assert TemplateSet(reshaped, 0.25, np.arange(12)).sha256 != templates.sha256


def test_round_trip(tmp_path: Path) -> None:
    templates = a_set()
    path = tmp_path / "new" / "folder" / "templates.npz"
    templates.save(path)
    loaded = TemplateSet.load(path)
    np.testing.assert_array_equal(loaded.points, templates.points)
    np.testing.assert_array_equal(loaded.counts, templates.counts)
    assert loaded.dt_s == 0.25
    assert loaded.sha256 == templates.sha256
    card = json.loads(path.with_suffix(".json").read_text())
    assert card["sha256"] == templates.sha256
    assert card["data"] == "none"
    assert loaded.card == card


def test_missing_file_says_what_makes_one(tmp_path: Path) -> None:
    with pytest.raises(DataError, match="shoot-fit-templates"):
        TemplateSet.load(tmp_path / "none.npz")


def test_pickles_are_not_opened(tmp_path: Path) -> None:
    class Trap:
        def __reduce__(self) -> tuple[object, tuple[str]]:
            return os.mkdir, (str(tmp_path / "sprung"),)

    path = tmp_path / "evil.npz"
    np.savez(
        path,
        templates=np.array([Trap()], dtype=object),
        dt_s=0.25,
        counts=np.zeros(1),
        card=np.asarray("{}"),
    )
    with pytest.raises(DataError, match="not a template file"):
        TemplateSet.load(path)
    assert not (tmp_path / "sprung").exists()


def test_every_cut_off_file_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "whole.npz"
    a_set().save(path)
    whole = path.read_bytes()
    for length in [0, 1, 3, 4, 60, *range(100, len(whole) - 1, 97)]:
        path.write_bytes(whole[:length])
        with pytest.raises(DataError, match="not a template file"):
            TemplateSet.load(path)


def test_damaged_bytes_never_pass_for_templates(tmp_path: Path) -> None:
    path = tmp_path / "whole.npz"
    templates = a_set()
    templates.save(path)
    whole = path.read_bytes()
    refused = 0
    for place in range(0, len(whole), 7):
        damaged = bytearray(whole)
        damaged[place] ^= 0xFF
        path.write_bytes(damaged)
        try:
            loaded = TemplateSet.load(path)
        except DataError:
            refused += 1
        else:  # a byte of zip's own bookkeeping that nobody reads
            assert loaded.sha256 == templates.sha256
    assert refused > len(whole) // 14


@pytest.mark.parametrize(
    "change",
    [
        {"templates": np.zeros((4, 20), np.float32)},
        {"templates": np.zeros((4, 20, 3), np.float32)},
        {"templates": np.zeros((4, 20, 2), np.float64)},
        {"templates": np.zeros((0, 20, 2), np.float32), "counts": np.zeros(0, np.int64)},
        {"templates": np.full((4, 20, 2), np.nan, np.float32)},
        {"counts": np.zeros(5, np.int64)},
        {"dt_s": np.float64(0.0)},
        {"dt_s": np.float64(np.nan)},
        {"card": np.asarray('{"format_version": 99}')},
        {"card": np.asarray("[1]")},
        {"card": np.asarray("no json")},
    ],
)
def test_files_of_other_contents_are_refused(tmp_path: Path, change: dict[str, np.ndarray]) -> None:
    good = {
        "templates": np.zeros((4, 20, 2), np.float32),
        "dt_s": np.float64(0.25),
        "counts": np.zeros(4, np.int64),
        "card": np.asarray('{"format_version": 1}'),
    }
    path = tmp_path / "t.npz"
    np.savez(path, **good)
    assert len(TemplateSet.load(path).points) == 4
    np.savez(path, **(good | change))
    with pytest.raises(DataError, match=r"template"):
        TemplateSet.load(path)


def test_an_npy_file_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "t.npz"
    with path.open("wb") as stream:
        np.save(stream, np.zeros((4, 20, 2), np.float32))
    with pytest.raises(DataError, match="not a template file"):
        TemplateSet.load(path)


def test_a_failed_save_leaves_the_old_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "t.npz"
    old = a_set()
    old.save(path)

    def fail(stream: object, **arrays: object) -> None:
        stream.write(b"half of it")  # type: ignore[attr-defined]
        raise OSError("disk full")

    monkeypatch.setattr(np, "savez_compressed", fail)
    with pytest.raises(OSError, match="disk full"):
        a_set(seed=9).save(path)
    assert TemplateSet.load(path).sha256 == old.sha256
    assert sorted(p.name for p in tmp_path.iterdir()) == ["t.json", "t.npz"]
