"""From a trained segmentation and a sample to everything its picture shows."""

from pathlib import Path

import numpy as np
import torch

from lss_core.data.dataset import ego_from_camera
from shoot.metrics.overlap import THRESHOLD, count_by_probability, count_overlap, iou
from shoot.prediction.segmenter import TrainedSegmenter, segment_batches
from shoot.rendering import SegmentationView
from shoot.report.shown_sample import caption_of, shown_images, title_of
from shoot.training.segmentation.data import SegmentSplit


def view_segmentation(
    run: TrainedSegmenter, split: SegmentSplit, position: int
) -> SegmentationView:
    """What the network saw and said at one sample, and what was there.

    Args:
        run: Trained segmentation.
        split: Samples to choose from.
        position: Which of them.

    Raises:
        DataError: If a file is missing or damaged.
    """
    index, row = split.index, int(split.rows[position])
    (batch,) = segment_batches(run, split, np.asarray([position]))
    with torch.no_grad():
        prob = run.module(batch.sensors)[0].float().sigmoid().cpu().numpy()
    truth = batch.labels[0].cpu().numpy()
    images, intrinsics, names, there = shown_images(index, Path(run.config.data.root), row)
    return SegmentationView(
        images=images,
        pixel_from_camera=intrinsics,
        ego_from_camera=ego_from_camera(index, row, run.config.data.ego_motion)[there],
        camera_names=names,
        grid=run.config.model.grid,
        classes=run.config.classes,
        probabilities=prob,
        truth=truth,
        iou=tuple(
            float(iou(count_overlap(count_by_probability(*maps))))
            for maps in zip(prob, truth, strict=True)
        ),
        threshold=THRESHOLD,
        title=title_of(index, row),
        caption=caption_of(index, row),
    )
