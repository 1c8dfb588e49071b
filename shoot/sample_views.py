"""From a trained run and a sample to everything its picture shows."""

from pathlib import Path

import numpy as np
import torch

from lss_core.data.dataset import ego_from_camera
from lss_core.data.images import PixelMap, load_image
from lss_core.data.lidar import load_sweep
from lss_core.data.samples import SampleIndex
from lss_core.geometry import FloatArray
from shoot.datamodule import LabelledSplit
from shoot.prediction import TrainedRun, batches
from shoot.rendering import SampleView

_SHOWN_WIDTH_PX = 800


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
        cost_map = run.module.cost_map(batch.sensors)
        probabilities = run.module.planner(cost_map).softmax(dim=-1)[0]
    scene = int(index.sample_scene[row])
    images, intrinsics, names, there = _shown_images(index, root, row)
    poses = ego_from_camera(index, row, run.config.data.ego_motion)
    return SampleView(
        images=images,
        pixel_from_camera=intrinsics,
        ego_from_camera=poses[there],
        camera_names=names,
        grid=run.config.model.grid,
        cost_map=cost_map[0].float().cpu().numpy(),
        templates=run.templates.points,
        probabilities=probabilities.float().cpu().numpy(),
        driven=split.futures.xy_m[position],
        lidar_points_ego=load_sweep(index, root, row) if with_lidar else None,
        dt_s=run.templates.dt_s,
        title=f"{index.scene_name[scene]}: {index.scene_description[scene]}",
        caption=f"sample {index.sample_token[row]}",
    )


def _shown_images(
    index: SampleIndex, root: Path, row: int
) -> tuple[np.ndarray[tuple[int, ...], np.dtype[np.uint8]], FloatArray, tuple[str, ...], list[int]]:
    """Whole images at a readable size, their intrinsics, names, and which cameras they are of."""
    there = [int(n) for n in np.flatnonzero(index.has_camera[row])]
    images, intrinsics = [], []
    for n in there:
        raw_h, raw_w = (int(side) for side in index.image_hw[row, n])
        scale = min(1.0, _SHOWN_WIDTH_PX / raw_w)
        shown_hw = round(raw_h * scale), round(raw_w * scale)
        pixel_map = PixelMap(shown_hw, 0, 0, False, 0.0, shown_hw, (raw_h, raw_w))
        images.append(load_image(root / index.image_path[row, n], pixel_map))
        intrinsics.append(pixel_map.pixel_from_rawpixel @ index.rawpixel_from_camera[row, n])
    names = tuple(str(index.cameras[n]) for n in there)
    return np.stack(images), np.stack(intrinsics), names, there
