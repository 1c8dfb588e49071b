"""The models: what the sensors of a car see in, a bird's-eye-view map out."""

from lss_core.camera_model import CameraModel
from lss_core.config import DataConfig, ModelConfig
from lss_core.lidar_model import LidarModel

__all__ = ["CameraModel", "LidarModel", "make_model"]


def make_model(
    config: ModelConfig, data: DataConfig, out_channels: int = 1
) -> CameraModel | LidarModel:
    """The model for what a data set gives: images, or lidar scans.

    Raises:
        ValueError: If the images are not a whole number of feature cells.
        DataError: If the image backbone or its weights cannot be had.
    """
    if data.lidar_scans:
        return LidarModel(config, out_channels)
    return CameraModel(config, (data.image.height_px, data.image.width_px), out_channels)
