"""Cameras that are moved or die at test time: the same for each run, and nothing else changes."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from world_fixture import TinySegmenter

from lss_core.errors import DataError
from shoot.prediction.disturbance import Disturbance
from shoot.prediction.segmenter import TrainedSegmenter, open_segmenter, segment_batches
from shoot.training.segmentation.data import SegmentBatch, SegmentSplit

NUM = 6


@pytest.fixture(scope="module")
def run(tiny_segmenter: TinySegmenter) -> TrainedSegmenter:
    return open_segmenter(tiny_segmenter.folder)


@pytest.fixture(scope="module")
def split(run: TrainedSegmenter) -> SegmentSplit:
    return run.task.load_split(run.config.data, "train")


def seen(run: TrainedSegmenter, split: SegmentSplit, how: Disturbance) -> SegmentBatch:
    positions = np.arange(NUM)
    (batch,) = segment_batches(replace(run, disturbance=how), split, positions)
    return batch


def test_noise_moves_mountings_and_nothing_else(run: TrainedSegmenter, split: SegmentSplit) -> None:
    plain = seen(run, split, Disturbance())
    noisy, again = (seen(run, split, Disturbance(noise_rad=0.05, noise_m=0.2)) for _ in range(2))
    assert torch.equal(noisy.sensors.ego_from_camera, again.sensors.ego_from_camera)
    moved = (noisy.sensors.ego_from_camera - plain.sensors.ego_from_camera)[..., :3, 3]
    assert (moved != 0.0).all()
    assert 0.1 < float(moved.std()) < 0.4
    for name in ("images", "pixel_from_camera", "camera_mask"):
        assert torch.equal(getattr(noisy.sensors, name), getattr(plain.sensors, name)), name
    assert torch.equal(noisy.labels, plain.labels)


def test_cameras_drop_in_each_sample(run: TrainedSegmenter, split: SegmentSplit) -> None:
    mask = seen(run, split, Disturbance(drop_cameras=2)).sensors.camera_mask
    num = mask.shape[1]
    assert (mask.sum(dim=1) == num - 2).all()
    assert len({tuple(row) for row in mask.tolist()}) > 1
    alone = seen(run, split, Disturbance(drop_cameras=num - 1)).sensors.camera_mask
    assert (alone.sum(dim=1) == 1).all()


def test_missing_cameras_are_hidden_in_all(run: TrainedSegmenter, split: SegmentSplit) -> None:
    cameras = run.config.data.cameras
    batch = seen(run, split, Disturbance(missing=cameras[1:2]))
    assert not batch.sensors.camera_mask[:, 1].any()
    kept = [n for n in range(len(cameras)) if n != 1]
    assert batch.sensors.camera_mask[:, kept].all()
    with pytest.raises(DataError, match="CAM_NOWHERE is none of the run's cameras"):
        seen(run, split, Disturbance(missing=("CAM_NOWHERE",)))
