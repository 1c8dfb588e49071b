"""The tables that the benchmark of the index reads are as the devkit wants them."""

import importlib
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from lss_core.errors import DataError

SCENES = 6
NUM_KEYFRAMES = 5 * 40 + 41


@pytest.fixture
def index_benchmark(monkeypatch: pytest.MonkeyPatch) -> Any:
    monkeypatch.syspath_prepend(Path(__file__).parents[2] / "scripts")
    return importlib.import_module("benchmarks.index")


@pytest.fixture
def root(index_benchmark: Any, tmp_path: Path) -> Path:
    made: Path = index_benchmark.make_tables(tmp_path, SCENES)
    return made


def test_devkit_and_index_find_the_same(index_benchmark: Any, root: Path, tmp_path: Path) -> None:
    cache = tmp_path / "cache"
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("SHOOT_CACHE", "")  # so that it is as before afterwards
        assert index_benchmark.open_devkit(root) == NUM_KEYFRAMES
        assert index_benchmark.build_index(root, cache) == NUM_KEYFRAMES
        # The last five seconds have no whole future; cameras and lidar do not fire on time.
        kept = index_benchmark.start(root, cache)
        assert NUM_KEYFRAMES - 11 * SCENES <= kept <= NUM_KEYFRAMES - 10 * SCENES
        # Of the six scenes five are for training; each has 391 or 401 sweeps.
        assert 5 * (391 - 101) <= index_benchmark.mine(root, cache) <= 5 * (401 - 100)
        assert len(list(cache.iterdir())) == 1
    assert index_benchmark.skim_tables(root) == index_benchmark.read_tables(root)


def test_as_many_records_as_in_nuscenes(root: Path) -> None:
    tables = {p.stem: json.loads(p.read_text()) for p in root.glob("*/*.json")}
    frames = tables["sample_data"]
    assert len(frames) == len(tables["ego_pose"]) == len({frame["token"] for frame in frames})
    assert len(frames) / SCENES == pytest.approx(2_631_083 / 850, rel=0.01)
    assert sum(frame["is_key_frame"] for frame in frames) == 12 * NUM_KEYFRAMES
    assert len(tables["calibrated_sensor"]) == 12 * SCENES
    # Frames of one sensor follow each other, and lead to a keyframe of their time or later.
    time_us = {frame["token"]: frame["timestamp"] for frame in frames}
    assert all(time_us[f["next"]] > f["timestamp"] for f in frames if f["next"])
    keyframe_us = {sample["token"]: sample["timestamp"] for sample in tables["sample"]}
    early_s = [(keyframe_us[f["sample_token"]] - f["timestamp"]) / 1e6 for f in frames]
    assert min(early_s) > -0.1
    assert max(early_s) < 0.6
    poses = np.array([pose["rotation"] for pose in tables["ego_pose"]])
    np.testing.assert_allclose(np.linalg.norm(poses, axis=-1), 1.0)


def test_same_call_same_bytes(index_benchmark: Any, root: Path, tmp_path: Path) -> None:
    again = index_benchmark.make_tables(tmp_path / "again", SCENES)
    for table in root.glob("*/*.json"):
        assert (again / table.relative_to(root)).read_bytes() == table.read_bytes()
    assert index_benchmark.make_tables(tmp_path, SCENES) == root
    assert not list(tmp_path.glob("*.partial"))


def test_what_cannot_be_made(index_benchmark: Any, root: Path, tmp_path: Path) -> None:
    write = index_benchmark.write_big_tables
    with pytest.raises(DataError, match="exists already"):
        write(root)
    with pytest.raises(DataError, match="1 to 850 scenes, not 851"):
        write(tmp_path / "more", 851)
