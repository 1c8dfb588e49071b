"""From a trained run and a sample to everything its picture shows."""

from pathlib import Path

import numpy as np
import torch

from lss_core.data.dataset import ego_from_camera
from lss_core.data.sensors.lidar import load_sweep
from shoot.prediction.run import TrainedRun, batches
from shoot.rendering import SampleView
from shoot.report.shown_sample import caption_of, shown_images, title_of
from shoot.training.planning.data import LabelledSplit


def view_sample(
    run: TrainedRun, split: LabelledSplit, position: int, with_lidar: bool = False
) -> SampleView:
    """What the planner saw, thought and the driver did at one sample.

    Args:
        run: Trained planner.
        split: Samples to choose from.
        position: Which of them.
        with_lidar: Show the keyframe's lidar sweep too.

    Raises:
        DataError: If a file is missing or damaged.
    """
    index, root = split.index, Path(run.config.data.root)
    row = int(split.futures.sample[position])
    (batch,) = batches(run, split, np.asarray([position]))
    with torch.no_grad():
        cost_maps = run.module.cost_maps(batch.sensors)
        probabilities = run.module.outputs(cost_maps).softmax(dim=-1)[0]
    images, intrinsics, names, there = shown_images(index, root, row)
    poses = ego_from_camera(index, row, run.config.data.ego_motion)
    return SampleView(
        images=images,
        pixel_from_camera=intrinsics,
        ego_from_camera=poses[there],
        camera_names=names,
        grid=run.config.model.grid,
        cost_map=cost_maps[0].mean(dim=0).float().cpu().numpy(),
        templates=run.templates.points,
        probabilities=probabilities.float().cpu().numpy(),
        driven=split.futures.xy_m[position],
        lidar_points_ego=load_sweep(index, root, row) if with_lidar else None,
        dt_s=run.templates.dt_s,
        title=title_of(index, row),
        caption=caption_of(index, row) + of_times(run),
    )


def of_times(run: TrainedRun) -> str:
    """What of a cost volume the map shows, to be said below the headline."""
    if run.task.out_channels == 1:
        return ""
    return f"; the map: mean cost of {run.task.out_channels} times"
