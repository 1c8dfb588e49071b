"""A small camera model's sizes, and a rig of cameras that look around, each tilted a little."""

import math

import torch
from torch import Tensor

from lss_core.config import DepthBins, ModelConfig
from lss_core.grid import BevGrid

IMAGE_HW = (64, 96)
SMALL = ModelConfig(
    backbone="plain-8-12-16-20",
    pretrained="none",
    context_channels=6,
    image_stride=8,
    neck_channels=8,
    stem_channels=4,
    decoder_channels=8,
    depth=DepthBins(4.0, 24.0, 2.0),
    grid=BevGrid(-8.0, 16.0, -12.0, 12.0, 1.0),
    head_init_std=0.1,
)


def rig(num_samples: int = 2, num_cameras: int = 3) -> tuple[Tensor, Tensor, Tensor]:
    """Images, intrinsics and poses of cameras that look around, each tilted a little."""
    generator = torch.Generator().manual_seed(0)
    images = torch.randint(
        0, 256, (num_samples, num_cameras, 3, *IMAGE_HW), generator=generator, dtype=torch.uint8
    )
    intrinsics = torch.tensor([[60.0, 0.0, 46.0], [0.0, 62.0, 30.0], [0.0, 0.0, 1.0]])
    poses = torch.zeros(num_samples, num_cameras, 4, 4)
    look = torch.tensor([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
    for n in range(num_cameras):
        yaw_rad, tilt_rad = 0.3 + 1.1 * n, 0.05 * (n + 1)
        cos, sin = math.cos(yaw_rad), math.sin(yaw_rad)
        turn = torch.tensor([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])
        cos, sin = math.cos(tilt_rad), math.sin(tilt_rad)
        tilt = torch.tensor([[1.0, 0.0, 0.0], [0.0, cos, -sin], [0.0, sin, cos]])
        poses[:, n, :3, :3] = turn @ look @ tilt
        poses[:, n, :3, 3] = torch.tensor([0.3 + 0.2 * n, 0.1 * n, 1.6])
    poses[..., 3, 3] = 1.0
    return images, intrinsics.expand(num_samples, num_cameras, 3, 3).clone(), poses
