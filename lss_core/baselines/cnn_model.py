"""Images to a map by convolutions and resizing alone."""

import torch
import torch.nn.functional as F
from jaxtyping import Bool, Float, Shaped
from torch import Tensor, nn

from lss_core.config import ModelConfig
from lss_core.errors import DataError
from lss_core.images_to_map import ImagesToMap


class CnnModel(ImagesToMap):
    """No 3-D structure: the cameras' features side by side, mixed and stretched over the grid.

    Each camera has a slot of its own, by its place in the batch; one that is missing is zeros. The
    top of the images lies on the far end of the grid. Where in space a camera looks, the network
    must learn from the slot, whatever the calibration.

    Paper: section 5.1 (CNN). Deviation: what the paper leaves open, see docs/deviations.md.

    Args:
        config: Sizes and choices.
        image_hw: Height and width of the images in pixels.
        num_cameras: Slots; batches have no more cameras.
        out_channels: Channels of the map.

    Raises:
        ValueError: If the images are not a whole number of feature cells.
        DataError: If the backbone or its weights cannot be had.
    """

    def __init__(
        self,
        config: ModelConfig,
        image_hw: tuple[int, int],
        num_cameras: int,
        out_channels: int = 1,
    ) -> None:
        super().__init__(config, image_hw, out_channels, num_depths=0)
        self.num_cameras = num_cameras
        channels = config.context_channels
        self.mix = nn.Sequential(
            nn.Conv2d(num_cameras * channels, channels, 1, bias=False),
            nn.BatchNorm2d(channels),
            nn.ReLU(inplace=True),
        )

    def bev_features(
        self,
        images: Shaped[Tensor, "B N 3 Hi Wi"],
        pixel_from_camera: Float[Tensor, "B N 3 3"],
        ego_from_camera: Float[Tensor, "B N 4 4"],
        camera_mask: Bool[Tensor, "B N"] | None = None,
    ) -> Float[Tensor, "B C X Y"]:
        """What all cameras' features together say, stretched over the grid; no calibration is read.

        Raises:
            DataError: If there are more cameras than slots.
        """
        missing = self.num_cameras - images.shape[1]
        if missing < 0:
            raise DataError(
                f"A model with lift 'cnn' for {self.num_cameras} cameras was given "
                f"{images.shape[1]}; give it no more, or train it with all (--data.cameras)."
            )
        context, _ = self.encode_images(images, camera_mask)
        slots = F.pad(context, (0, 0, 0, 0, 0, 0, 0, missing)).flatten(1, 2)
        mixed: Tensor = self.mix(slots.contiguous(memory_format=torch.channels_last))
        # Rows run down, X runs forward.
        return F.interpolate(
            mixed.flip(-2), size=self.config.grid.shape, mode="bilinear", align_corners=False
        )
