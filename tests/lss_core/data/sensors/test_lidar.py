"""Several lidar scans as one, and planners that see them instead of images."""

from pathlib import Path

import numpy as np
import pytest
import torch
from ring_sweeps import RING_M, write_sweeps
from tiny_tables import TRAIN_A, TRAIN_B, VERSION, copy_tiny

from lss_core.batch import collate
from lss_core.config import CAMERAS, DataConfig
from lss_core.data.dataset import LidarDataset
from lss_core.data.samples import SampleIndex, load_index
from lss_core.data.sensors.lidar import load_scans, recent_sweeps
from lss_core.data.usable import Needs, usable_rows
from lss_core.errors import DataError
from lss_core.geometry import apply, invert

NUM_SCANS = 10


@pytest.fixture(scope="module")
def root(tiny_root: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = copy_tiny(tiny_root, tmp_path_factory.mktemp("lidar") / "data")
    write_sweeps(load_index(folder, VERSION, CAMERAS), folder)
    return folder


@pytest.fixture(scope="module")
def index(root: Path) -> SampleIndex:
    return load_index(root, VERSION, CAMERAS)


def test_what_stands_still_stays_where_it_is(index: SampleIndex, root: Path) -> None:
    row = index.row_of(f"{TRAIN_A.name}-06")
    points = load_scans(index, root, row, NUM_SCANS)
    assert points.shape == (NUM_SCANS * len(RING_M), 5)
    expected = apply(invert(index.global_from_ego[row]), RING_M)
    for number, place in enumerate(expected):
        own = points[points[:, 3] == number]
        np.testing.assert_allclose(own[:, :3], np.tile(place, (NUM_SCANS, 1)), atol=1e-3)
    # The car moved meanwhile: without its motion undone they would be metres apart.
    assert np.ptp(index.track_xy_m[recent_sweeps(index, row, NUM_SCANS), 0]) > 1.0


def test_ages_tell_the_scans_apart(index: SampleIndex, root: Path) -> None:
    points = load_scans(index, root, index.row_of(f"{TRAIN_A.name}-06"), NUM_SCANS)
    ages, counts = np.unique(points[:, 4].round(4), return_counts=True)
    np.testing.assert_allclose(ages, 0.1 * np.arange(NUM_SCANS), atol=1e-3)
    assert (counts == len(RING_M)).all()


def test_no_scan_is_of_the_future_or_of_another_scene(index: SampleIndex) -> None:
    for scene in (TRAIN_A, TRAIN_B):
        first, later = (index.row_of(f"{scene.name}-{number:02d}") for number in (0, 1))
        assert len(recent_sweeps(index, first, NUM_SCANS)) == 1
        sweeps = recent_sweeps(index, later, NUM_SCANS)
        assert len(sweeps) == 6  # half a second of sweeps every 0.1 s, both ends in
        assert (index.track_time_s[sweeps] <= index.time_s[later] + 1e-6).all()
        assert (np.diff(index.track_time_s[sweeps]) < 0.0).all()
        track = index.track(int(index.sample_scene[later]))
        assert sweeps.min() >= track.start


def test_one_scan_is_the_keyframes_own(index: SampleIndex, root: Path) -> None:
    row = index.row_of(f"{TRAIN_A.name}-03")
    (sweep,) = recent_sweeps(index, row, 1)
    assert index.sweep_path[sweep].decode() == index.lidar_path[row]
    assert (load_scans(index, root, row, 1)[:, 4] == 0.0).all()


def test_batches_keep_samples_apart(index: SampleIndex, root: Path) -> None:
    rows = np.asarray([index.row_of(f"{TRAIN_A.name}-{number:02d}") for number in (0, 5, 6)])
    data = DataConfig(root=str(root), version=VERSION, lidar_scans=NUM_SCANS)
    items = [LidarDataset(index, rows, data)[position, -1] for position in range(3)]
    batch = collate(items)
    assert batch.point_counts.tolist() == [12, 120, 120]
    assert batch.point_offsets.tolist() == [0, 12, 132]
    for item, start, count in zip(items, batch.point_offsets, batch.point_counts, strict=True):
        assert torch.equal(batch.points[start : start + count], item.points)


def test_a_missing_sweep_is_named_or_left_out(root: Path, tmp_path: Path) -> None:
    spoilt = copy_tiny(root, tmp_path / "data")
    index = load_index(spoilt, VERSION, CAMERAS)
    row = index.row_of(f"{TRAIN_A.name}-06")
    name = index.sweep_path[recent_sweeps(index, row, 3)[-1]].decode()
    (spoilt / name).unlink()
    rows = np.asarray([row - 1, row])
    two, three = (Needs(images=False, lidar_scans=scans) for scans in (2, 3))
    assert usable_rows(index, spoilt, rows, False, two).rows.tolist() == rows.tolist()
    with pytest.raises(DataError, match=rf"1 of 2 samples cannot be used.*{Path(name).name}"):
        usable_rows(index, spoilt, rows, False, three)
    usable = usable_rows(index, spoilt, rows, True, three)
    assert usable.rows.tolist() == [row - 1]
    assert usable.left_out[0].reason == "missing lidar sweep"
