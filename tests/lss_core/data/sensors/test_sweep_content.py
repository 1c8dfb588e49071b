"""Sweeps whose bytes fit and whose content does not: named by what they look like."""

import logging
from pathlib import Path

import numpy as np
import pytest
from tiny_tables import TRAIN_A, VERSION, TinyScene, write_tiny

from lss_core.config import CAMERAS
from lss_core.data.samples import SampleIndex, load_index
from lss_core.data.sensors.lidar import load_scans, load_sweep
from lss_core.data.usable import Needs, usable_rows
from lss_core.errors import DataError

NUM_POINTS, NUM_RINGS = 4096 + 64, 32
ROW = 6
NEEDS = Needs(images=False, lidar_scans=1)


def sweep(seed: int = 0, by_ring: bool = False) -> np.ndarray:
    """[P, 5] float32 of a full turn over flat ground with walls, as nuScenes writes it."""
    rng = np.random.default_rng(seed)
    firing, ring = np.divmod(np.arange(NUM_POINTS), NUM_RINGS)
    azimuth_rad = 2.0 * np.pi * firing * NUM_RINGS / NUM_POINTS
    pitch_rad = np.deg2rad(-30.0 + 40.0 * ring / NUM_RINGS)
    reach_m = np.minimum(1.8 / np.maximum(-np.sin(pitch_rad), 1e-3), rng.uniform(20, 40, len(ring)))
    points = np.stack(
        [
            reach_m * np.cos(pitch_rad) * np.cos(azimuth_rad),
            reach_m * np.cos(pitch_rad) * np.sin(azimuth_rad),
            reach_m * np.sin(pitch_rad),
            rng.integers(0, 256, len(ring)),
            ring,
        ],
        axis=1,
    ).astype(np.float32)
    return points[np.lexsort((firing, ring))] if by_ring else points


def with_fifth(points: np.ndarray, column: np.ndarray | float) -> np.ndarray:
    changed = points.copy()
    changed[:, 4] = column
    return changed


def kitti(points: np.ndarray) -> np.ndarray:
    """KITTI's four columns, intensity 0 to 1."""
    return points[:, :4] / np.float32([1, 1, 1, 255])


def timed(points: np.ndarray) -> np.ndarray:
    time_s = np.linspace(0.0, 0.1, len(points), dtype=np.float32)
    return np.column_stack([points, time_s])


def noisy(points: np.ndarray) -> np.ndarray:
    """float64 with all of its digits in use, as computed ones have."""
    noise = np.random.default_rng(1).normal(0.0, 1e-4, (len(points), 3))
    return points + np.pad(noise, ((0, 0), (0, points.shape[1] - 3)))


def write_data(root: Path, scene: TinyScene = TRAIN_A) -> tuple[SampleIndex, Path]:
    """A scene with whole keyframe sweeps, and the path of that of the sample `ROW`."""
    write_tiny(root, (scene,), cameras=CAMERAS[:1], image_hw=(9, 16))
    index = load_index(root, VERSION, CAMERAS[:1])
    for seed, name in enumerate(index.lidar_path):
        sweep(seed).tofile(root / str(name))
    return index, root / str(index.lidar_path[ROW])


def check_refused(root: Path, index: SampleIndex, message: str) -> None:
    """Refused by name when it is read, and left out when bad samples are."""
    for load in (load_sweep, lambda *where: load_scans(*where, 1)):
        with pytest.raises(DataError, match=message) as caught:
            load(index, root, ROW)
        assert Path(str(index.lidar_path[ROW])).name in str(caught.value)
    rows = np.arange(len(index.sample_token))
    usable = usable_rows(index, root, rows, True, NEEDS)
    assert usable.rows.tolist() == [row for row in rows.tolist() if row != ROW]
    assert usable.left_out[0].reason == "damaged lidar sweep"


def check_read(root: Path, index: SampleIndex, expected_m: np.ndarray) -> None:
    assert len(load_sweep(index, root, ROW)) == len(expected_m)
    rows = np.arange(len(index.sample_token))
    assert usable_rows(index, root, rows, True, NEEDS).left_out == ()


OTHER_LAYOUTS = {
    "four columns": (kitti, "4 columns: x, y, z, intensity, as KITTI writes"),
    "four columns up to 255": (lambda points: points[:, :4], "4 columns"),
    "three columns": (lambda points: points[:, :3], "3 columns"),
    "six columns, a time last": (timed, "6 columns"),
    "float64": (lambda points: points.astype(np.float64), "float64"),
    "float64, all digits": (noisy, "float64"),
    "float64, four columns": (lambda points: noisy(points[:, :4]), "float64 with 4 columns"),
    "float16": (lambda points: points.astype(np.float16), "float16"),
    "the other order of bytes": (lambda points: points.astype(">f4"), "bytes in the other order"),
}


@pytest.mark.parametrize("by_ring", [False, True], ids=["by firing", "by ring"])
@pytest.mark.parametrize("name", OTHER_LAYOUTS)
def test_points_of_another_layout_are_named(tmp_path: Path, name: str, by_ring: bool) -> None:
    change, message = OTHER_LAYOUTS[name]
    index, path = write_data(tmp_path)
    change(sweep(by_ring=by_ring)).tofile(path)
    assert path.stat().st_size % 20 == 0
    check_refused(tmp_path, index, message)


def test_four_columns_that_do_not_fit_are_named_too(tmp_path: Path) -> None:
    index, path = write_data(tmp_path)
    kitti(sweep()[:-1]).tofile(path)
    assert path.stat().st_size % 20
    check_refused(tmp_path, index, "ends within a point.*4 columns")


def test_bytes_of_no_points_at_all_are_refused(tmp_path: Path) -> None:
    index, path = write_data(tmp_path)
    path.write_bytes(np.random.default_rng(0).bytes(NUM_POINTS * 20))
    check_refused(tmp_path, index, "expected float32 x, y, z, intensity, ring")


def no_return(points: np.ndarray) -> np.ndarray:
    """A third of the firings never came back."""
    changed = points.copy()
    changed[::3] = np.nan
    return changed


@pytest.mark.parametrize("by_ring", [False, True], ids=["by firing", "by ring"])
@pytest.mark.parametrize(
    "change",
    [
        lambda points: points,
        lambda points: with_fifth(points, 1.0),  # Lyft
        lambda points: with_fifth(points, -1.0),
        lambda points: with_fifth(points, timed(points)[:, 5]),
        lambda points: with_fifth(points, np.nan),
        lambda points: with_fifth(points, timed(points)[:, 5])[(points[:, :2] > 0.0).all(axis=1)],
        lambda points: points / np.float32([1, 1, 1, 255, 1]),
        lambda points: points[:40],
    ],
    ids=["nuScenes", "Lyft", "no ring", "times", "nan", "a quarter", "0 to 1", "few"],
)
def test_what_may_be_meant_is_read(tmp_path: Path, by_ring: bool, change: object) -> None:
    index, _ = write_data(tmp_path)
    assert callable(change)
    points = change(sweep(by_ring=by_ring))
    # Beside sweeps of its own kind: else a small one counts as cut off.
    for name in index.lidar_path:
        points.tofile(tmp_path / str(name))
    check_read(tmp_path, index, points)


def test_points_that_never_came_back_are_no_other_layout(tmp_path: Path) -> None:
    index, path = write_data(tmp_path)
    points = no_return(sweep())
    points.tofile(path)
    check_read(tmp_path, index, points[np.isfinite(points).all(axis=1)])


@pytest.mark.parametrize("num_bytes", [20_480, 61_440, 20 * 400])
def test_a_sweep_that_was_cut_off_is_named(tmp_path: Path, num_bytes: int) -> None:
    index, path = write_data(tmp_path)
    path.write_bytes(path.read_bytes()[:num_bytes])
    check_refused(tmp_path, index, f"cut off: it has {num_bytes // 20} points .* {NUM_POINTS}")


def test_whole_sweeps_may_end_with_a_block_or_be_smaller(tmp_path: Path) -> None:
    index, path = write_data(tmp_path)
    whole = sweep()
    # Every fourth firing of a turn is missing, and what is left fills blocks.
    kept = whole[(np.arange(NUM_POINTS) // NUM_RINGS) % 4 != 3][:3072]
    assert (kept.nbytes % 4096) == 0
    kept.tofile(path)
    check_read(tmp_path, index, kept)
    half = whole[(np.arange(NUM_POINTS) // NUM_RINGS) % 4 == 0]
    assert half.nbytes % 4096
    half.tofile(path)
    check_read(tmp_path, index, half)


def test_bright_points_stay_and_are_warned_of_once(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    index, path = write_data(tmp_path)
    expected = load_scans(index, tmp_path, ROW, 1)
    points = np.fromfile(path, dtype=np.float32).reshape(-1, 5)
    far = np.flatnonzero(np.hypot(points[:, 0], points[:, 1]) > 5.0)
    points[far[:40], 3] = 31_000.0
    points[far[40:43], 3] = np.nan
    points.tofile(path)
    with caplog.at_level(logging.WARNING):
        read = [load_scans(index, tmp_path, ROW, 1) for _ in range(2)][1]
    np.testing.assert_array_equal(read[:, :3], expected[:, :3])
    first = int(np.flatnonzero(np.hypot(points[:, 0], points[:, 1]) >= 2.2).searchsorted(far[0]))
    assert (read[:, 3] == 255.0).sum() >= 40
    assert read[first, 3] == 255.0
    assert caplog.text.count("not all within 0 to 255") == 1
    assert "to 31000" in caplog.text
