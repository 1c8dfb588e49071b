"""Templates as plain arrays: what comes in is what went out, and what is no vocabulary is said."""

import hashlib
import math
from pathlib import Path

import numpy as np
import pytest

from lss_core.errors import DataError
from shoot.templates import TemplateSet, read_vocabulary, write_vocabulary

DT_S = 0.1


def arcs(k: int = 5, num_points: int = 40) -> np.ndarray:
    """[K, T, 3] left arcs of 20 m radius, faster and faster, with headings; 4 s at 10 Hz."""
    times_s = DT_S * np.arange(1, num_points + 1)
    angle = (1.0 + np.arange(k)[:, None]) * times_s / 20.0
    x_m, y_m = 20.0 * np.sin(angle), 20.0 * (1.0 - np.cos(angle))
    return np.stack([x_m, y_m, angle], axis=-1)


def saved(path: Path, array: np.ndarray) -> Path:
    np.save(path, array)
    return path


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_the_three_layouts_are_the_same_templates(tmp_path: Path, dtype: type) -> None:
    paths = arcs().astype(dtype)
    layouts = {
        "xy": (paths[..., :2], "[5, 40, 2]: x, y"),
        "headings": (paths, "[5, 40, 3]: x, y, heading"),
        "flat": (paths.reshape(5, 120), "[5, 120]: x, y, heading"),
    }
    for name, (array, layout) in layouts.items():
        path = saved(tmp_path / f"{name}.npy", array)
        templates = read_vocabulary(path, DT_S)
        np.testing.assert_array_equal(templates.points, paths[..., :2].astype(np.float32))
        assert (templates.dt_s, templates.horizon_s) == (DT_S, 4.0)
        assert templates.counts.tolist() == [0] * 5
        assert templates.card["vocabulary"] == {
            "file": f"{name}.npy",
            "sha256": hashlib.sha256(path.read_bytes()).hexdigest(),
            "layout": layout,
        }


def test_out_and_in_again_is_the_same_to_the_bit(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    points = np.cumsum(rng.uniform(-0.2, 1.5, (7, 40, 2)), axis=1).astype(np.float32)
    templates = TemplateSet(points, DT_S, np.arange(7))
    write_vocabulary(tmp_path / "out.npy", templates)
    again = read_vocabulary(tmp_path / "out.npy", DT_S)
    np.testing.assert_array_equal(again.points, points)
    assert again.sha256 == templates.sha256


def test_headings_go_out_as_the_direction_of_travel(tmp_path: Path) -> None:
    paths = arcs()
    # The slowest stops half-way and keeps its heading.
    paths[0, 20:] = paths[0, 19]
    templates = TemplateSet(paths[..., :2].astype(np.float32), DT_S, np.zeros(5, dtype=np.int64))
    write_vocabulary(tmp_path / "out.npy", templates)
    array = np.load(tmp_path / "out.npy", allow_pickle=False)
    assert (array.dtype, array.shape) == (np.dtype(np.float32), (5, 40, 3))
    # The chord of the last two points lags by half a step: at 5 m/s by 0.0125 rad.
    np.testing.assert_allclose(array[..., 2], paths[..., 2], atol=0.013)
    assert (array[0, 21:, 2] == array[0, 20, 2]).all()
    assert array[4, -1, 2] == pytest.approx(5.0 * 4.0 / 20.0, abs=0.013)


@pytest.mark.parametrize(
    ("array", "sentence"),
    [
        (np.zeros((4, 40)), r"float64 \[4, 40\], but a vocabulary is numbers"),
        (np.zeros((4, 40, 4)), r"\[4, 40, 4\], but"),
        (np.zeros((0, 40, 2)), "no array of numpy|but a vocabulary"),
        (np.zeros((4, 40, 2), dtype=complex), "complex128"),
        (np.zeros((4, 40, 2), dtype=bool), "bool"),
        (np.where(arcs() > 3.0, np.nan, arcs()), "5 of 5 trajectories are not"),
        (100.0 * arcs(), "slower than 100 m/s"),
        (1e300 * arcs(), "must be finite"),
        (np.insert(arcs(), 0, 0.0, axis=1), "leave its first point out"),
    ],
)
def test_what_is_no_vocabulary_is_said(tmp_path: Path, array: np.ndarray, sentence: str) -> None:
    path = saved(tmp_path / "v.npy", array)
    with pytest.raises(DataError, match=sentence) as refused:
        read_vocabulary(path, DT_S)
    assert str(path) in str(refused.value)


def test_a_step_in_other_units_is_said(tmp_path: Path) -> None:
    """4 s at 10 Hz, read as if 10 were milliseconds: 100 times as fast."""
    path = saved(tmp_path / "v.npy", arcs())
    with pytest.raises(DataError, match=r"a point every 0\.001 s"):
        read_vocabulary(path, 0.001)


def test_other_files_are_refused(tmp_path: Path) -> None:
    with pytest.raises(DataError, match="no vocabulary"):
        read_vocabulary(tmp_path / "none.npy", DT_S)
    (tmp_path / "text.npy").write_text("x, y, heading")
    np.savez(tmp_path / "several.npz", a=arcs(), b=arcs())
    np.save(tmp_path / "pickle.npy", np.array([{"x": math.pi}], dtype=object), allow_pickle=True)
    whole = saved(tmp_path / "whole.npy", arcs()).read_bytes()
    (tmp_path / "cut.npy").write_bytes(whole[:-9])
    for name, sentence in {
        "text.npy": "no array of numpy",
        "several.npz": "several arrays",
        "pickle.npy": "no array of numpy",
        "cut.npy": "no array of numpy",
    }.items():
        with pytest.raises(DataError, match=sentence):
            read_vocabulary(tmp_path / name, DT_S)


def test_more_points_than_a_template_file_may_hold_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "much.npy"
    # A file with holes: it takes no space.
    np.lib.format.open_memmap(path, "w+", np.float32, (1 << 20, 40, 2))
    with pytest.raises(DataError, match="41,943,040 points"):
        read_vocabulary(path, DT_S)
