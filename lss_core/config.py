"""Sizes and choices of the perception half, as frozen dataclasses; defaults are the paper's."""

import math
from dataclasses import dataclass, field
from typing import Annotated, Literal

from lss_core.bounds import Bounds, SettingError, check_order, check_range, check_settings
from lss_core.grid import BevGrid

# Far beyond what is of use; without bounds a config from strangers could fill the memory.
_MAX_DEPTHS = 1_000
_Side = Annotated[int, Bounds(1, 8_192)]
_Channels = Annotated[int, Bounds(1, 8_192)]
_Depth = Annotated[float, Bounds(0.0, 10_000.0, low_is_in=False)]
_Height = Annotated[float, Bounds(-1_000.0, 1_000.0)]

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

    min_m: _Depth = 4.0
    max_m: _Depth = 45.0
    step_m: _Depth = 1.0

    def __post_init__(self) -> None:
        check_settings(self)
        check_order("min_m", self.min_m, "max_m", self.max_m)
        if not 1 <= round((self.max_m - self.min_m) / self.step_m) <= _MAX_DEPTHS:
            raise SettingError(
                f"step_m is {self.step_m:g}, but from min_m {self.min_m:g} to max_m {self.max_m:g} "
                f"there must be 1 to {_MAX_DEPTHS} depths."
            )

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

    height_px: _Side = 128
    width_px: _Side = 352
    resize: Annotated[tuple[float, float], Bounds(0.1, 10.0)] = (0.877, 1.023)
    crop_bottom: Annotated[tuple[float, float], Bounds(0.0, 0.95)] = (0.0, 0.22)
    rotate_rad: Annotated[float, Bounds(0.0, math.pi)] = 0.0942
    flip: bool = True
    horizon: Annotated[tuple[float, float], Bounds(0.0, 1.0)] = (0.15, 0.25)

    def __post_init__(self) -> None:
        check_settings(self)
        check_range("resize", self.resize)
        check_range("crop_bottom", self.crop_bottom)
        if sum(self.horizon) > 1.0:
            raise SettingError(
                f"horizon is {self.horizon}, but must be two shares that add up to at most 1."
            )


@dataclass(frozen=True)
class ModelConfig:
    """The network from images or lidar points to map.

    Attributes:
        backbone: Name of a timm model for the images, or `plain-16-32-64-128` (see ImageEncoder).
        pretrained: `timm` (downloads ImageNet weights), `none`, or the path of a file with a timm
            model's weights, or a run's (weights.safetensors), of which the backbone is taken.
        context_channels: C, the length of a pixel's context vector or of a lidar pillar's features.
        image_stride: Pixels per feature cell, 8 or 16.
        neck_channels: Width of the convolutions that join the backbone's two strides.
        stem_channels: Width of the BEV network's first stage (paper: 64, then 128, 256).
        decoder_channels: Width of the BEV network's decoder; half of it at full resolution.
        frustum: Which pixel a feature cell stands for. `sampled`: the one where the network looks,
            measured at its first weights; `cell`: the cell's centre; `released`: stretched to the
            image's edges as in the released perception code.
        lift: How images reach the map. `depth`: the paper's, by depths that are learned; `uniform`:
            by all depths alike. Its rivals (section 5.1): `oft` by projecting boxes of space, `cnn`
            by convolutions that know no calibration.
        freeze_encoder: Keep the image backbone as it is at the start, batch statistics included;
            with `pretrained="none"` its features are random.
        depth: Depth bins.
        grid: Bird's-eye-view grid.
        z_min_m: Points below are dropped.
        z_max_m: Points at or above are dropped.
        head_init_std: Standard deviation of the last layer's weights at the start of training.
    """

    backbone: str = "efficientnet_b0"
    pretrained: str = "timm"
    context_channels: _Channels = 64
    image_stride: Literal[8, 16] = 16
    neck_channels: _Channels = 512
    stem_channels: _Channels = 64
    decoder_channels: Annotated[int, Bounds(2, 8_192)] = 256
    frustum: Literal["sampled", "cell", "released"] = "sampled"
    lift: Literal["depth", "uniform", "cnn", "oft"] = "depth"
    freeze_encoder: bool = False
    depth: DepthBins = field(default_factory=DepthBins)
    grid: BevGrid = field(default_factory=BevGrid)
    z_min_m: _Height = -10.0
    z_max_m: _Height = 10.0
    head_init_std: Annotated[float, Bounds(0.0, 10.0)] = 1e-3

    def __post_init__(self) -> None:
        check_settings(self)
        check_order("z_min_m", self.z_min_m, "z_max_m", self.z_max_m)


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
    lidar_scans: Annotated[int, Bounds(0, 1_000)] = 0
    ego_motion: bool = True
    skip_bad: bool = False
    drop_cameras: Annotated[int, Bounds(0, 1_000)] = 0
    extrinsic_noise_rad: Annotated[float, Bounds(0.0, math.pi)] = 0.0
    extrinsic_noise_m: Annotated[float, Bounds(0.0, 100.0)] = 0.0

    def __post_init__(self) -> None:
        check_settings(self)
        check_cameras(self.cameras)
        if not self.lidar_scans and self.drop_cameras >= len(self.cameras):
            raise SettingError(
                f"drop_cameras is {self.drop_cameras}, but must be less than the number of "
                f"cameras, {len(self.cameras)}."
            )


def check_cameras(cameras: tuple[str, ...]) -> None:
    """Refuse a choice of no camera, or of one twice.

    Raises:
        SettingError: If it is such.
    """
    if not cameras:
        raise SettingError(f"cameras is empty, but must name one or more, such as {CAMERAS[1]}.")
    twice = sorted({camera for camera in cameras if cameras.count(camera) > 1})
    if twice:
        raise SettingError(f"cameras names {twice[0]} twice, but must name each once.")
