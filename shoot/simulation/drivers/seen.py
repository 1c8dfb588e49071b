"""What is seen in the loop as a trained planner reads it, which is as samples of a data set."""

import numpy as np
import torch

from lss_core.batch import Batch
from lss_core.camera import horizon_row
from lss_core.config import DataConfig
from lss_core.data.sensors.images import draw_pixel_map, fit_image
from lss_core.data.sensors.lidar import place_scan
from shoot.simulation.observation import CameraView, LidarScan, Sights


def read_sights(sights: Sights, config: DataConfig) -> Batch:
    """One sample, without batch dimension, as an evaluation of a run reads it from files.

    Args:
        sights: What sensors see; its cameras are those of `config`, in their order.
        config: Of the run.
    """
    if config.lidar_scans:
        return _read_scans(sights.scans)
    return _read_views(sights.views, config)


def _read_views(views: tuple[CameraView, ...], config: DataConfig) -> Batch:
    images, pixel_from_camera, poses = [], [], []
    for view in views:
        horizon = horizon_row(view.rawpixel_from_camera, view.egocam_from_camera)
        pixel_map = draw_pixel_map(config.image, view.image_hw, None, horizon)
        images.append(fit_image(view.open(), pixel_map))
        pixel_from_camera.append(pixel_map.pixel_from_rawpixel @ view.rawpixel_from_camera)
        poses.append(view.ego_from_camera if config.ego_motion else view.egocam_from_camera)
    return Batch(
        images=torch.from_numpy(np.stack(images)).permute(0, 3, 1, 2),
        pixel_from_camera=torch.from_numpy(np.stack(pixel_from_camera)).float(),
        ego_from_camera=torch.from_numpy(np.stack(poses).astype(np.float32)),
        camera_mask=torch.ones(len(views), dtype=torch.bool),
        sample_idx=torch.tensor(0),
        points=torch.zeros(0, 5),
        point_counts=torch.tensor(0),
    )


def _read_scans(scans: tuple[LidarScan, ...]) -> Batch:
    points = np.concatenate([place_scan(s.points_lidar, s.ego_from_lidar, s.age_s) for s in scans])
    return Batch(
        images=torch.zeros(0, 3, 1, 1),
        pixel_from_camera=torch.zeros(0, 3, 3),
        ego_from_camera=torch.zeros(0, 4, 4),
        camera_mask=torch.zeros(0, dtype=torch.bool),
        sample_idx=torch.tensor(0),
        points=torch.from_numpy(points),
        point_counts=torch.tensor(len(points)),
    )
