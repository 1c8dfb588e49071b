"""The models: what the sensors of a car see in, a bird's-eye-view map out."""

from lss_core.baselines.cnn_model import CnnModel
from lss_core.baselines.oft_model import OftModel
from lss_core.camera_model import CameraModel
from lss_core.config import DataConfig, ModelConfig
from lss_core.images_to_map import ImagesToMap
from lss_core.lidar_model import LidarModel

__all__ = ["CameraModel", "CnnModel", "ImagesToMap", "LidarModel", "OftModel", "make_model"]


def make_model(
    config: ModelConfig, data: DataConfig, out_channels: int = 1
) -> ImagesToMap | LidarModel:
    """The model for what a data set gives: images, by the lift asked for, or lidar scans.

    Raises:
        ValueError: If the images are not a whole number of feature cells.
        DataError: If the image backbone or its weights cannot be had.
    """
    if data.lidar_scans:
        return LidarModel(config, out_channels)
    image_hw = (data.image.height_px, data.image.width_px)
    if config.lift == "cnn":
        return CnnModel(config, image_hw, len(data.cameras), out_channels)
    if config.lift == "oft":
        return OftModel(config, image_hw, out_channels)
    return CameraModel(config, image_hw, out_channels)
