"""Images of one moment, wherever they come from, as an evaluation reads those of a data set."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray

from lss_core.batch import Batch
from lss_core.camera import horizon_row
from lss_core.config import ImageConfig
from lss_core.data.sensors.images import PixelMap, draw_pixel_map
from lss_core.geometry import FloatArray


@dataclass(frozen=True)
class View:
    """What one camera sees at a moment.

    Attributes:
        load: The image after a pixel map, [H, W, 3] RGB.
        image_hw: Height and width before it.
        rawpixel_from_camera: [3, 3].
        egocam_from_camera: [4, 4] mounting, which says where the horizon is.
        ego_from_camera: [4, 4] pose in `ego` at the moment.
    """

    load: Callable[[PixelMap], NDArray[np.uint8]]
    image_hw: tuple[int, int]
    rawpixel_from_camera: FloatArray
    egocam_from_camera: FloatArray
    ego_from_camera: FloatArray


def read_views(views: Sequence[View], config: ImageConfig) -> Batch:
    """One sample, without batch dimension and augmentation; all of its cameras are there.

    Args:
        views: One or more.
        config: What the network takes.

    Raises:
        DataError: If an image cannot be loaded.
    """
    images, pixel_from_camera = [], []
    for view in views:
        horizon = horizon_row(view.rawpixel_from_camera, view.egocam_from_camera)
        pixel_map = draw_pixel_map(config, view.image_hw, None, horizon)
        images.append(view.load(pixel_map))
        pixel_from_camera.append(pixel_map.pixel_from_rawpixel @ view.rawpixel_from_camera)
    poses = np.stack([view.ego_from_camera for view in views])
    return Batch(
        images=torch.from_numpy(np.stack(images)).permute(0, 3, 1, 2),
        pixel_from_camera=torch.from_numpy(np.stack(pixel_from_camera)).float(),
        ego_from_camera=torch.from_numpy(poses.astype(np.float32)),
        camera_mask=torch.ones(len(views), dtype=torch.bool),
        sample_idx=torch.tensor(0),
        points=torch.zeros(0, 5),
        point_counts=torch.tensor(0),
    )
