"""What is seen in the loop as a trained planner reads it, which is as samples of a data set."""

import numpy as np
import torch

from lss_core.batch import Batch
from lss_core.config import DataConfig
from lss_core.data.sensors.images import fit_image
from lss_core.data.sensors.lidar import place_scan
from lss_core.data.sensors.views import View, read_views
from shoot.simulation.observation import CameraView, LidarScan, Sights


def read_sights(sights: Sights, config: DataConfig) -> Batch:
    """One sample, without batch dimension, as an evaluation of a run reads it from files.

    Args:
        sights: What sensors see; its cameras are those of `config`, in their order.
        config: Of the run.
    """
    if config.lidar_scans:
        return _read_scans(sights.scans)
    return read_views([_view(view, config.ego_motion) for view in sights.views], config.image)


def _view(view: CameraView, ego_motion: bool) -> View:
    return View(
        load=lambda pixel_map: fit_image(view.open(), pixel_map),
        image_hw=view.image_hw,
        rawpixel_from_camera=view.rawpixel_from_camera,
        egocam_from_camera=view.egocam_from_camera,
        ego_from_camera=view.ego_from_camera if ego_motion else view.egocam_from_camera,
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
