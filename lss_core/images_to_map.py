"""What all models of images share: each image through one network, the map's network behind."""

from abc import ABC, abstractmethod
from typing import Literal

import torch
from jaxtyping import Bool, Float, Shaped
from torch import Tensor, nn

from lss_core.batch import Batch
from lss_core.bev_encoder import make_bev_encoder
from lss_core.camera_inputs import check_cameras, check_range
from lss_core.config import ModelConfig
from lss_core.feature_centres import first_feature_px
from lss_core.image_encoder import ImageEncoder


class ImagesToMap(nn.Module, ABC):
    """Images of any number of cameras in, a map out; how images reach the map is the models' own.

    Attributes:
        first_px: (u, v) of the pixel that feature cell (0, 0) looks at; None unless measured.

    Args:
        config: Sizes and choices.
        image_hw: Height and width of the images in pixels.
        out_channels: Channels of the map.
        num_depths: Depths that the image network gives probabilities of; 0: none.

    Raises:
        ValueError: If the images are not a whole number of feature cells.
        DataError: If the backbone or its weights cannot be had.
    """

    first_px: Tensor | None

    def __init__(
        self, config: ModelConfig, image_hw: tuple[int, int], out_channels: int, num_depths: int
    ) -> None:
        super().__init__()
        if any(side % config.image_stride for side in image_hw):
            raise ValueError(
                f"Images of {image_hw[0]}x{image_hw[1]} px are not a whole number of feature "
                f"cells; choose multiples of image_stride={config.image_stride}."
            )
        self.config = config
        self.image_hw = image_hw
        self.image_encoder = ImageEncoder(
            backbone=config.backbone,
            pretrained=config.pretrained,
            num_depths=num_depths,
            context_channels=config.context_channels,
            stride=config.image_stride,
            neck_channels=config.neck_channels,
            learns_depth=config.lift != "uniform",
            freezes_backbone=config.freeze_encoder,
        )
        self.bev_encoder = make_bev_encoder(config, out_channels)

    @abstractmethod
    def bev_features(
        self,
        images: Shaped[Tensor, "B N 3 Hi Wi"],
        pixel_from_camera: Float[Tensor, "B N 3 3"],
        ego_from_camera: Float[Tensor, "B N 4 4"],
        camera_mask: Bool[Tensor, "B N"] | None = None,
    ) -> Float[Tensor, "B C X Y"]:
        """What the images say of the grid's cells, before the map's own network."""

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
        bev = self.bev_features(images, pixel_from_camera, ego_from_camera, camera_mask)
        output: Tensor = self.bev_encoder(bev)
        return output

    def forward_batch(self, batch: Batch) -> Float[Tensor, "B Cout X Y"]:
        """The map of each sample of a batch."""
        output: Tensor = self(
            batch.images, batch.pixel_from_camera, batch.ego_from_camera, mask_of(batch)
        )
        return output

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
            depth_prob = flat.new_zeros(0, self.image_encoder.num_depths, height, width)
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

    def measure_centres(self) -> None:
        """Measure where features look, once; kept with the weights, which training fits to it."""
        measured = self.config.frustum == "sampled"
        self.register_buffer(
            "first_px",
            torch.tensor(first_feature_px(self.image_encoder, self.config.image_stride))
            if measured
            else None,
        )

    @property
    def centers(self) -> Literal["cell", "released"] | Tensor:
        """Which pixels feature cells stand for, as `lss_core.camera.frustum_points` takes it."""
        frustum = self.config.frustum
        if frustum == "sampled":
            assert self.first_px is not None
            return self.first_px
        return frustum


def mask_of(batch: Batch) -> Bool[Tensor, "B N"] | None:
    """A batch's mask of cameras; None where it is known to hide nothing."""
    return None if batch.every_camera else batch.camera_mask


def _spread(values: Float[Tensor, "P ..."], present: Bool[Tensor, "M"]) -> Float[Tensor, "M ..."]:
    """Rows put back where `present`, zeros elsewhere."""
    result = values.new_zeros(len(present), *values.shape[1:])
    return result.masked_scatter(present.view(-1, *[1] * (values.ndim - 1)), values)
