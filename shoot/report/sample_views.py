"""From a trained run and a sample to everything its picture shows."""

from pathlib import Path

import numpy as np
import torch

from lss_core.data.dataset import ego_from_camera, raw_hw
from lss_core.data.samples import SampleIndex
from lss_core.data.sensors.images import PixelMap, load_image
from lss_core.data.sensors.lidar import load_sweep
from lss_core.geometry import FloatArray
from lss_core.legible import legible
from shoot.prediction.run import TrainedRun, batches
from shoot.rendering import SampleView
from shoot.training.planning.data import LabelledSplit

_SHOWN_WIDTH_PX = 800
# Letters of a title: a long one leaves no room for the picture.
_SHOWN = 400


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
    scene = int(index.sample_scene[row])
    images, intrinsics, names, there = _shown_images(index, root, row)
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
        title=legible(f"{index.scene_name[scene]}: {index.scene_description[scene]}"[:_SHOWN]),
        caption=legible(f"sample {index.sample_token[row]}") + _of_times(run),
    )


def _of_times(run: TrainedRun) -> str:
    """What of a cost volume the map shows, to be said below the headline."""
    if run.task.out_channels == 1:
        return ""
    return f"; the map: mean cost of {run.task.out_channels} times"


def _shown_images(
    index: SampleIndex, root: Path, row: int
) -> tuple[np.ndarray[tuple[int, ...], np.dtype[np.uint8]], FloatArray, tuple[str, ...], list[int]]:
    """Whole images at a readable size, their intrinsics, names, and which cameras they are of.

    Where cameras differ, the smaller images have black borders.
    """
    there = [int(n) for n in np.flatnonzero(index.has_camera[row])]
    raw_hws = [raw_hw(index, root, row, n) for n in there]
    shown_hws = [_shown_hw(*sides_px) for sides_px in raw_hws]
    frame_hw = max(height for height, _ in shown_hws), max(width for _, width in shown_hws)
    images, intrinsics = [], []
    for n, sides_px, (height, width) in zip(there, raw_hws, shown_hws, strict=True):
        left, top = (width - frame_hw[1]) // 2, (height - frame_hw[0]) // 2
        pixel_map = PixelMap((height, width), left, top, False, 0.0, frame_hw, sides_px)
        images.append(load_image(root / index.image_path[row, n], pixel_map))
        intrinsics.append(pixel_map.pixel_from_rawpixel @ index.rawpixel_from_camera[row, n])
    names = tuple(legible(str(index.cameras[n])) for n in there)
    return np.stack(images), np.stack(intrinsics), names, there


def _shown_hw(raw_h: int, raw_w: int) -> tuple[int, int]:
    scale = min(1.0, _SHOWN_WIDTH_PX / raw_w)
    return max(1, round(raw_h * scale)), max(1, round(raw_w * scale))
