"""Images of any number of cameras in, a bird's-eye-view map out."""

import torch
from jaxtyping import Bool, Float, Shaped
from torch import Tensor

from lss_core.batch import Batch
from lss_core.camera import frustum_points
from lss_core.config import DepthBins, ModelConfig
from lss_core.images_to_map import ImagesToMap, mask_of
from lss_core.splat import SplatCache, SplatIndex, build_splat_index, pool


class CameraModel(ImagesToMap):
    """Lift, splat, and encode the map.

    With `lift="uniform"` all depths of a pixel have the same probability, and none is learned.

    Attributes:
        cache: Splat indices of the calibrations seen last.

    Paper: section 3; 3.1 for depths that are not learned.

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
        super().__init__(config, image_hw, out_channels, num_depths=len(config.depth.depths_m))
        self.cache = SplatCache()
        self.measure_centres()

    def forward_with_depth(
        self, batch: Batch
    ) -> tuple[Float[Tensor, "B Cout X Y"], Float[Tensor, "B N D H W"]]:
        """The map of each sample of a batch, and the depths that its features were put at."""
        context, depth_prob = self.encode_images(batch.images, mask_of(batch))
        index = self.splat_index(batch.pixel_from_camera, batch.ego_from_camera, mask_of(batch))
        output: Tensor = self.bev_encoder(pool(context, depth_prob, index, self.config.grid))
        return output, depth_prob

    def bev_features(
        self,
        images: Shaped[Tensor, "B N 3 Hi Wi"],
        pixel_from_camera: Float[Tensor, "B N 3 3"],
        ego_from_camera: Float[Tensor, "B N 4 4"],
        camera_mask: Bool[Tensor, "B N"] | None = None,
    ) -> Float[Tensor, "B C X Y"]:
        """Context summed into the grid's cells, before the map's own network."""
        context, depth_prob = self.encode_images(images, camera_mask)
        index = self.splat_index(pixel_from_camera, ego_from_camera, camera_mask)
        return pool(context, depth_prob, index, self.config.grid)

    def splat_index(
        self,
        pixel_from_camera: Float[Tensor, "B N 3 3"],
        ego_from_camera: Float[Tensor, "B N 4 4"],
        camera_mask: Bool[Tensor, "B N"] | None = None,
    ) -> SplatIndex:
        """The splat index of a batch; from the cache if it lies on the host and is known."""
        if camera_mask is None:
            camera_mask = pixel_from_camera.new_ones(pixel_from_camera.shape[:2], dtype=torch.bool)
        if pixel_from_camera.device.type != "cpu":
            return self._build_index(pixel_from_camera, ego_from_camera, camera_mask)
        key = self.cache.key(pixel_from_camera, ego_from_camera, camera_mask)
        index = self.cache.get(key)
        if index is None:
            index = self._build_index(pixel_from_camera, ego_from_camera, camera_mask)
            self.cache.put(key, index)
        return index

    def _build_index(
        self,
        pixel_from_camera: Float[Tensor, "B N 3 3"],
        ego_from_camera: Float[Tensor, "B N 4 4"],
        camera_mask: Bool[Tensor, "B N"],
    ) -> SplatIndex:
        points_ego = frustum_points(
            self.image_hw,
            self.config.image_stride,
            _depths_m(self.config.depth, pixel_from_camera.device),
            pixel_from_camera,
            ego_from_camera,
            centers=self.centers,
        )
        return build_splat_index(
            points_ego, self.config.grid, self.config.z_min_m, self.config.z_max_m, camera_mask
        )


def _depths_m(depth: DepthBins, device: torch.device) -> Float[Tensor, "D"]:
    """`depth.depths_m` to the bit, made on a device: copied there, the host would wait."""
    steps = torch.arange(len(depth.depths_m), dtype=torch.float64, device=device)
    return depth.min_m + steps * depth.step_m
