"""Images to a map by boxes of space that collect the features they project to."""

import torch
import torch.nn.functional as F
from jaxtyping import Bool, Float, Shaped
from torch import Tensor, nn

from lss_core.baselines.voxel_boxes import find_boxes, pool_boxes
from lss_core.config import ModelConfig
from lss_core.images_to_map import ImagesToMap

# Where traffic is, cut into boxes: borders in metres above the ground.
HEIGHTS_M = (-1.0, 0.0, 1.0, 2.0, 3.0)


class OftModel(ImagesToMap):
    """The orthographic feature transform (Roddick et al., 2018), for any number of cameras.

    Above each cell stand boxes of space. Each takes the mean of the features within its projection,
    and the mean over the cameras that see it. A linear layer of the boxes of a cell, rectified, is
    what the images say of it. A pixel says the same at all depths.

    Paper: section 5.1 (OFT). Deviation: what differs from the transform's own paper, see
    docs/deviations.md.

    Args:
        config: Sizes and choices.
        image_hw: Height and width of the images in pixels.
        out_channels: Channels of the map.

    Raises:
        ValueError: If the images are not a whole number of feature cells.
        DataError: If the backbone or its weights cannot be had.
    """

    def __init__(
        self, config: ModelConfig, image_hw: tuple[int, int], out_channels: int = 1
    ) -> None:
        super().__init__(config, image_hw, out_channels, num_depths=0)
        self.num_heights = len(HEIGHTS_M) - 1
        channels = config.context_channels
        self.collapse = nn.Linear(self.num_heights * channels, channels)
        self.measure_centres()

    def bev_features(
        self,
        images: Shaped[Tensor, "B N 3 Hi Wi"],
        pixel_from_camera: Float[Tensor, "B N 3 3"],
        ego_from_camera: Float[Tensor, "B N 4 4"],
        camera_mask: Bool[Tensor, "B N"] | None = None,
    ) -> Float[Tensor, "B C X Y"]:
        """What the boxes above each cell have collected; float32 also under mixed precision."""
        context, _ = self.encode_images(images, camera_mask)
        boxes = find_boxes(
            self.image_hw,
            self.config.image_stride,
            self.config.grid,
            HEIGHTS_M,
            pixel_from_camera,
            ego_from_camera,
            camera_mask,
            self.centers,
        )
        # What the linear layer makes of a box's mean is the mean of what it makes of the features:
        # applied to the images, it leaves one sum a cell instead of one a box.
        of_height = self.collapse.weight.view(
            -1, self.num_heights, self.config.context_channels
        )  # C Z C
        with torch.autocast(context.device.type, enabled=False):
            rows = torch.einsum("bnchw,ozc->bnhwzo", context.to(of_height.dtype), of_height)
            sums = pool_boxes(rows, boxes, self.config.grid)
            return F.relu(sums + self.collapse.bias[:, None, None])
