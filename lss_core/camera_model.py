"""Images of any number of cameras in, a bird's-eye-view map out."""

from typing import Literal

import torch
from jaxtyping import Bool, Float, Shaped
from torch import Tensor, nn

from lss_core.batch import Batch
from lss_core.bev_encoder import make_bev_encoder
from lss_core.camera import frustum_points
from lss_core.camera_inputs import check_cameras, check_range
from lss_core.config import DepthBins, ModelConfig
from lss_core.feature_centres import first_feature_px
from lss_core.image_encoder import ImageEncoder
from lss_core.splat import SplatCache, SplatIndex, build_splat_index, pool


class CameraModel(nn.Module):
    """Lift, splat, and encode the map.

    Attributes:
        cache: Splat indices of the calibrations seen last.
        first_px: (u, v) of the pixel that feature cell (0, 0) looks at; None unless measured.

    Paper: section 3.

    Args:
        config: Sizes and choices.
        image_hw: Height and width of the images in pixels.
        out_channels: Channels of the map.

    Raises:
        ValueError: If the images are not a whole number of feature cells.
        DataError: If the backbone or its weights cannot be had.
    """

    first_px: Tensor | None

    def __init__(
        self, config: ModelConfig, image_hw: tuple[int, int], out_channels: int = 1
    ) -> None:
        super().__init__()
        if any(side % config.image_stride for side in image_hw):
            raise ValueError(
                f"Images of {image_hw[0]}x{image_hw[1]} px are not a whole number of feature "
                f"cells; choose multiples of image_stride={config.image_stride}."
            )
        self.config = config
        self.image_hw = image_hw
        self.cache = SplatCache()
        self.image_encoder = ImageEncoder(
            backbone=config.backbone,
            pretrained=config.pretrained,
            num_depths=len(config.depth.depths_m),
            context_channels=config.context_channels,
            stride=config.image_stride,
            neck_channels=config.neck_channels,
        )
        self.bev_encoder = make_bev_encoder(config, out_channels)
        # Measured once, and kept with the weights, which training then fits to it.
        measured = config.frustum == "sampled"
        self.register_buffer(
            "first_px",
            torch.tensor(first_feature_px(self.image_encoder, config.image_stride))
            if measured
            else None,
        )

    def forward(
        self,
        images: Shaped[Tensor, "B N 3 Hi Wi"],
        pixel_from_camera: Float[Tensor, "B N 3 3"],
        ego_from_camera: Float[Tensor, "B N 4 4"],
        camera_mask: Bool[Tensor, "B N"] | None = None,
    ) -> Float[Tensor, "B Cout X Y"]:
        """The map on the grid's cells; any number of cameras.

        Args:
            images: RGB, uint8 in 0..255 or float in 0..1.
            pixel_from_camera: Intrinsics with the augmentation folded in.
            ego_from_camera: Camera poses.
            camera_mask: False where a camera is not there; its image and calibration play no part.
                None: all are there. With a mask the host waits for a GPU to see how many.

        Raises:
            ValueError: If shapes do not belong together, or images are of another type or range.
                Values are only looked at on the host.
        """
        check_cameras(images, pixel_from_camera, ego_from_camera, camera_mask)
        bev = self.splat(images, pixel_from_camera, ego_from_camera, camera_mask)
        output: Tensor = self.bev_encoder(bev)
        return output

    def forward_batch(self, batch: Batch) -> Float[Tensor, "B Cout X Y"]:
        """The map of each sample of a batch."""
        output: Tensor = self(
            batch.images, batch.pixel_from_camera, batch.ego_from_camera, _mask(batch)
        )
        return output

    def forward_with_depth(
        self, batch: Batch
    ) -> tuple[Float[Tensor, "B Cout X Y"], Float[Tensor, "B N D H W"]]:
        """The map of each sample of a batch, and the depths that its features were put at."""
        context, depth_prob = self.encode_images(batch.images, _mask(batch))
        index = self.splat_index(batch.pixel_from_camera, batch.ego_from_camera, _mask(batch))
        output: Tensor = self.bev_encoder(pool(context, depth_prob, index, self.config.grid))
        return output, depth_prob

    def splat(
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

    def encode_images(
        self, images: Shaped[Tensor, "B N 3 Hi Wi"], camera_mask: Bool[Tensor, "B N"] | None = None
    ) -> tuple[Float[Tensor, "B N C H W"], Float[Tensor, "B N D H W"]]:
        """Context and depth probabilities of each image; zeros for masked cameras.

        Masked images do not pass the network, so they leave no trace in batch statistics either.
        """
        num_samples, num_cameras = images.shape[:2]
        flat = images.flatten(0, 1)
        present = None
        if camera_mask is not None and not camera_mask.all():
            present = camera_mask.flatten()
            flat = flat[present]
        check_range(flat)
        flat = self.network_images(flat)
        height, width = (side // self.config.image_stride for side in self.image_hw)
        if len(flat):
            context, depth_prob = self.image_encoder(flat)
        else:
            context = flat.new_zeros(0, self.config.context_channels, height, width)
            depth_prob = flat.new_zeros(0, len(self.config.depth.depths_m), height, width)
        if present is not None:
            context, depth_prob = _spread(context, present), _spread(depth_prob, present)
        shape = (num_samples, num_cameras)
        return context.unflatten(0, shape), depth_prob.unflatten(0, shape)

    def network_images(self, images: Shaped[Tensor, "M 3 Hi Wi"]) -> Float[Tensor, "M 3 Hi Wi"]:
        """Images as the image encoder takes them: in 0..1, channels innermost in memory.

        Raises:
            ValueError: If they are not of the size the model was made for, or neither uint8 nor
                floats.
        """
        if tuple(images.shape[-2:]) != self.image_hw:
            raise ValueError(
                f"The model was made for images of {self.image_hw} px (height, width), got "
                f"{tuple(images.shape[-2:])}."
            )
        if images.dtype == torch.uint8:
            images = images.float() / 255.0
        elif not images.is_floating_point():
            raise ValueError(
                f"Images must be uint8 (0 to 255) or floats (0 to 1), got {images.dtype}; convert "
                "them, as by images.to(torch.uint8)."
            )
        return images.contiguous(memory_format=torch.channels_last)

    @property
    def _centers(self) -> Literal["cell", "released"] | Tensor:
        frustum = self.config.frustum
        if frustum == "sampled":
            assert self.first_px is not None
            return self.first_px
        return frustum

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
            centers=self._centers,
        )
        return build_splat_index(
            points_ego, self.config.grid, self.config.z_min_m, self.config.z_max_m, camera_mask
        )


def _mask(batch: Batch) -> Bool[Tensor, "B N"] | None:
    """None where it is known to hide nothing."""
    return None if batch.every_camera else batch.camera_mask


def _depths_m(depth: DepthBins, device: torch.device) -> Float[Tensor, "D"]:
    """`depth.depths_m` to the bit, made on a device: copied there, the host would wait."""
    steps = torch.arange(len(depth.depths_m), dtype=torch.float64, device=device)
    return depth.min_m + steps * depth.step_m


def _spread(values: Float[Tensor, "P ..."], present: Bool[Tensor, "M"]) -> Float[Tensor, "M ..."]:
    """Rows put back where `present`, zeros elsewhere."""
    result = values.new_zeros(len(present), *values.shape[1:])
    return result.masked_scatter(present.view(-1, *[1] * (values.ndim - 1)), values)
