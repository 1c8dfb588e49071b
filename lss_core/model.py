"""The models: what the sensors of a car see in, a bird's-eye-view map out."""

from typing import Literal

import torch
from jaxtyping import Bool, Float, Int, Shaped
from torch import Tensor, nn

from lss_core.batch import Batch
from lss_core.bev_encoder import BevEncoder
from lss_core.camera import frustum_points
from lss_core.config import DataConfig, DepthBins, ModelConfig
from lss_core.feature_centres import first_feature_px
from lss_core.image_encoder import ImageEncoder
from lss_core.lidar_encoder import PillarEncoder
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
        self.bev_encoder = _bev_encoder(config, out_channels)
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
        _check_cameras(images, pixel_from_camera, ego_from_camera, camera_mask)
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
        _check_range(flat)
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


class LidarModel(nn.Module):
    """Pillars of lidar points, and the same network behind them as behind the cameras'.

    Paper: section 5.6 (planning from lidar, with PointPillars).

    Args:
        config: Sizes and choices; `context_channels` is the length of a pillar's features, and what
            is about images plays no part.
        out_channels: Channels of the map.
    """

    def __init__(self, config: ModelConfig, out_channels: int = 1) -> None:
        super().__init__()
        self.config = config
        self.pillar_encoder = PillarEncoder(
            config.grid, config.context_channels, config.z_min_m, config.z_max_m
        )
        self.bev_encoder = _bev_encoder(config, out_channels)

    def forward(
        self, points: Float[Tensor, "P 5"], offsets: Int[Tensor, " B"]
    ) -> Float[Tensor, "B Cout X Y"]:
        """The map on the grid's cells.

        Args:
            points: x, y, z in metres in `ego`, intensity 0 to 255, age in seconds; the samples'
                one after the other.
            offsets: Where each sample's begin.

        Raises:
            ValueError: If the points have other columns, or are no floats.
        """
        if points.ndim != 2 or points.shape[1] != 5 or not points.is_floating_point():
            raise ValueError(
                f"Points must be floats [P, 5] (x, y, z, intensity, age), got {points.dtype} "
                f"{list(points.shape)}."
            )
        output: Tensor = self.bev_encoder(self.pillar_encoder(points, offsets))
        return output

    def forward_batch(self, batch: Batch) -> Float[Tensor, "B Cout X Y"]:
        """The map of each sample of a batch."""
        output: Tensor = self(batch.points, batch.point_offsets)
        return output


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


def _check_cameras(
    images: Shaped[Tensor, "..."],
    pixel_from_camera: Shaped[Tensor, "..."],
    ego_from_camera: Shaped[Tensor, "..."],
    camera_mask: Shaped[Tensor, "..."] | None,
) -> None:
    """Refuse shapes that do not belong together; broadcasting would make one of them."""
    places = tuple(images.shape[:2])
    wanted = {
        "pixel_from_camera": (pixel_from_camera, (*places, 3, 3)),
        "ego_from_camera": (ego_from_camera, (*places, 4, 4)),
    }
    if images.ndim != 5 or images.shape[2] != 3:
        raise ValueError(f"Images must be [B, N, 3, H, W], got {list(images.shape)}.")
    if camera_mask is not None:
        wanted["camera_mask"] = (camera_mask, places)
        if camera_mask.dtype != torch.bool:
            raise ValueError(f"camera_mask must be bool, got {camera_mask.dtype}.")
    for name, (tensor, shape) in wanted.items():
        if tuple(tensor.shape) != shape:
            raise ValueError(
                f"{name} must be {list(shape)}, as there are {places[0]} x {places[1]} images, got "
                f"{list(tensor.shape)}."
            )


def _check_range(images: Shaped[Tensor, "M 3 Hi Wi"]) -> None:
    """Refuse float images that are not in 0..1, where looking costs little."""
    if not images.is_floating_point() or images.device.type != "cpu" or not images.numel():
        return
    low, high = (float(value) for value in images.detach().aminmax())
    # Resampling may go a little beyond.
    if not (low >= -0.1 and high <= 1.1):
        raise ValueError(
            f"Float images must lie in 0 to 1, got {low:g} to {high:g}; divide them by 255, or "
            "give uint8."
        )


def _bev_encoder(config: ModelConfig, out_channels: int) -> BevEncoder:
    return BevEncoder(
        in_channels=config.context_channels,
        out_channels=out_channels,
        stem_channels=config.stem_channels,
        decoder_channels=config.decoder_channels,
        head_init_std=config.head_init_std,
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
