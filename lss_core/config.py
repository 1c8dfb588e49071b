"""Sizes and choices of the perception half, as frozen dataclasses; defaults are the paper's."""

from dataclasses import dataclass, field
from typing import Literal

from lss_core.grid import BevGrid

# Far beyond what is of use; without bounds a config from strangers could fill the memory.
_MAX_DEPTHS, _MAX_SIDE_PX, _MAX_CHANNELS = 1_000, 8_192, 8_192

CAMERAS = (
    "CAM_FRONT_LEFT",
    "CAM_FRONT",
    "CAM_FRONT_RIGHT",
    "CAM_BACK_LEFT",
    "CAM_BACK",
    "CAM_BACK_RIGHT",
)


@dataclass(frozen=True)
class DepthBins:
    """Depths a pixel may lie at, measured along the camera's z axis.

    Paper: section 4.1 (4 m to 45 m every 1 m: D = 41).

    Attributes:
        min_m: First depth.
        max_m: No depth reaches this.
        step_m: Distance between depths.
    """

    min_m: float = 4.0
    max_m: float = 45.0
    step_m: float = 1.0

    def __post_init__(self) -> None:
        if not (0.0 < self.min_m < self.max_m and self.step_m > 0.0):
            raise ValueError(f"Depth bins need 0 < min_m < max_m and step_m > 0, got {self}.")
        if (self.max_m - self.min_m) / self.step_m > _MAX_DEPTHS:
            raise ValueError(f"{self} are more than {_MAX_DEPTHS} depths.")

    @property
    def depths_m(self) -> tuple[float, ...]:
        """The D depths."""
        count = round((self.max_m - self.min_m) / self.step_m)
        return tuple(self.min_m + i * self.step_m for i in range(count))


@dataclass(frozen=True)
class ImageConfig:
    """How a camera image becomes the network's input.

    Attributes:
        height_px: Rows the network sees.
        width_px: Columns the network sees.
        resize: Smallest and largest factor drawn in training, relative to the factor at which the
            full width fits; evaluation takes 1. Equal numbers: no augmentation.
        crop_bottom: Smallest and largest share of the resized image cut off below in training;
            evaluation takes their mean. The rest of what is too much is cut off above.
        rotate_rad: Largest in-plane rotation in training.
        flip: Whether training mirrors single images (the intrinsics mirror with them).
        horizon: Smallest shares of the network's rows above and below the horizon: a crop that
            leaves less is moved. The default moves none of the crops above on nuScenes' cameras.
    """

    height_px: int = 128
    width_px: int = 352
    resize: tuple[float, float] = (0.877, 1.023)
    crop_bottom: tuple[float, float] = (0.0, 0.22)
    rotate_rad: float = 0.0942
    flip: bool = True
    horizon: tuple[float, float] = (0.15, 0.25)

    def __post_init__(self) -> None:
        if not all(1 <= side <= _MAX_SIDE_PX for side in (self.height_px, self.width_px)):
            raise ValueError(
                f"Images of {self.height_px}x{self.width_px} px; both sides must lie in 1 to "
                f"{_MAX_SIDE_PX}."
            )
        if not (min(self.horizon) >= 0.0 and sum(self.horizon) <= 1.0):
            raise ValueError(
                f"horizon is {self.horizon}, but must be two shares of 0 or more that add up to at "
                "most 1."
            )


@dataclass(frozen=True)
class ModelConfig:
    """The network from images or lidar points to map.

    Attributes:
        backbone: Name of a timm model for the images, or `plain-16-32-64-128` (see ImageEncoder).
        pretrained: `timm` (downloads ImageNet weights), `none`, or the path of a weights file.
        context_channels: C, the length of a pixel's context vector or of a lidar pillar's features.
        image_stride: Pixels per feature cell, 8 or 16.
        neck_channels: Width of the convolutions that join the backbone's two strides.
        stem_channels: Width of the BEV network's first stage (paper: 64, then 128, 256).
        decoder_channels: Width of the BEV network's decoder; half of it at full resolution.
        frustum: Which pixel a feature cell stands for. `cell`: the cell's centre; `sampled`: where
            the network looks, measured at its first weights; `released`: stretched to the image's
            edges as in the released perception code.
        depth: Depth bins.
        grid: Bird's-eye-view grid.
        z_min_m: Points below are dropped.
        z_max_m: Points at or above are dropped.
        head_init_std: Standard deviation of the last layer's weights at the start of training.
    """

    backbone: str = "efficientnet_b0"
    pretrained: str = "timm"
    context_channels: int = 64
    image_stride: int = 16
    neck_channels: int = 512
    stem_channels: int = 64
    decoder_channels: int = 256
    frustum: Literal["cell", "sampled", "released"] = "cell"
    depth: DepthBins = field(default_factory=DepthBins)
    grid: BevGrid = field(default_factory=BevGrid)
    z_min_m: float = -10.0
    z_max_m: float = 10.0
    head_init_std: float = 1e-3

    def __post_init__(self) -> None:
        for name in ("context_channels", "neck_channels", "stem_channels", "decoder_channels"):
            if not 1 <= getattr(self, name) <= _MAX_CHANNELS:
                raise ValueError(
                    f"{name} is {getattr(self, name)}, but must lie in 1 to {_MAX_CHANNELS}."
                )


@dataclass(frozen=True)
class DataConfig:
    """Which data, and what is done to it on the way in.

    Attributes:
        root: Folder that holds `samples`, `maps` and the version's folder.
        version: Name of the tables' folder.
        image: Image size and augmentation.
        cameras: Channels used, in this order.
        lidar_scans: 0: the planner sees images. More: it sees this many lidar scans instead, the
            keyframe's and those before it.
        ego_motion: Whether each camera's own pose at its own time is used (the released code does
            not).
        skip_bad: Leave out samples whose files are absent or damaged, or whose calibration or poses
            cannot be, count and list them, instead of stopping.
        drop_cameras: Cameras hidden at random per training sample (paper, section 5.3).
        extrinsic_noise_rad: Standard deviation of rotation noise on `ego_from_camera` in training.
        extrinsic_noise_m: Standard deviation of translation noise on `ego_from_camera` in training.
    """

    root: str = "data/nuscenes"
    version: str = "v1.0-trainval"
    image: ImageConfig = field(default_factory=ImageConfig)
    cameras: tuple[str, ...] = CAMERAS
    lidar_scans: int = 0
    ego_motion: bool = True
    skip_bad: bool = False
    drop_cameras: int = 0
    extrinsic_noise_rad: float = 0.0
    extrinsic_noise_m: float = 0.0

    def __post_init__(self) -> None:
        if self.lidar_scans < 0:
            raise ValueError(f"lidar_scans must be 0 or more, got {self.lidar_scans}.")
