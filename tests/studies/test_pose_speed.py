"""Speed in poses: poses of a car at a speed, and what a planner says of each."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from world_fixture import TinyRun

from lss_core.data.dataset import ego_from_camera
from lss_core.errors import DataError
from shoot.metrics.bootstrap import GroupBootstrap
from shoot.prediction.run import open_run, predict
from shoot.studies.pose_speed import (
    POSES,
    RECORDED,
    _correlation,
    format_pose_speed,
    poses_at,
    study_pose_speed,
)
from shoot.training.planning.data import load_split


def test_poses_of_a_car_that_stands_are_its_mountings_and_of_one_that_drives_move_with_time(
    tiny_run: TinyRun,
) -> None:
    run = open_run(tiny_run.folder)
    index = load_split(run.config.data, "val", run.templates).index
    mountings = ego_from_camera(index, 3, ego_motion=False)
    np.testing.assert_array_equal(poses_at(index, 3, 0.0), mountings)
    moved = poses_at(index, 3, 8.0) - mountings
    late_s = index.camera_time_s[3] - index.time_s[3]
    np.testing.assert_allclose(moved[:, 0, 3], 8.0 * late_s)
    moved[:, 0, 3] = 0.0
    assert not moved.any()


def test_recorded_poses_give_what_it_says_anyway(tiny_run: TinyRun, tmp_path: Path) -> None:
    run = open_run(tiny_run.folder)
    split = load_split(run.config.data, "val", run.templates)
    study = study_pose_speed(run, split, num_samples=6)
    assert (study.num_samples, study.num_scenes) == (6, 3)
    asked = np.linspace(0, len(split.labels) - 1, 6).round().astype(int)
    own = -predict(run, split)[asked, split.labels[asked]]
    assert study.nll[RECORDED].value == pytest.approx(own.mean(), abs=1e-4)
    for name, change in study.nll_change.items():
        assert change.value == pytest.approx(study.nll[name].value - study.nll[RECORDED].value)
    assert set(study.top10) == set(POSES)
    study.save(tmp_path / "study.json")
    assert (tmp_path / "study.json").stat().st_size > 500
    assert all(f"| {name} |" in format_pose_speed(study) for name in POSES)


def test_correlation_is_pearsons() -> None:
    rng = np.random.default_rng(4)
    x, group = rng.normal(3.0, 2.0, 60), np.repeat(np.arange(12), 5)
    y = 0.5 * x + rng.normal(-4.0, 1.0, 60)
    found = _correlation(GroupBootstrap(group), x, y)
    assert found.value == pytest.approx(np.corrcoef(x, y)[0, 1])
    assert found.low < found.value < found.high


def test_who_reads_no_such_poses_is_refused(tiny_run: TinyRun) -> None:
    run = open_run(tiny_run.folder)
    split = load_split(run.config.data, "val", run.templates)
    mounted = replace(run.config, data=replace(run.config.data, ego_motion=False))
    with pytest.raises(DataError, match="as mounted"):
        study_pose_speed(replace(run, config=mounted), split)
