"""The paper's sizes: six 128 x 352 images of a rig, 41 depths, 64 channels, 200 x 200 cells."""

import math
from dataclasses import replace

import torch
from torch import Tensor

from lss_core.batch import Batch
from lss_core.config import ModelConfig
from lss_core.grid import BevGrid

IMAGE_HW = (128, 352)
MODEL = ModelConfig(pretrained="none")
_YAWS_DEG = (55.0, 0.0, -55.0, 110.0, 180.0, -110.0)


def rig(num_samples: int, num_cameras: int = 6) -> tuple[Tensor, Tensor]:
    """[B, N, 3, 3] pixel_from_camera and [B, N, 4, 4] ego_from_camera; each sample's is another.

    The samples' cars pitch a little, as real ones do: no two calibrations are the same.
    """
    pixel_from_camera = torch.tensor([[278.0, 0.0, 175.5], [0.0, 278.0, 50.0], [0.0, 0.0, 1.0]])
    ego_from_camera = torch.eye(4).repeat(num_samples, num_cameras, 1, 1)
    for b in range(num_samples):
        for n in range(num_cameras):
            yaw = (
                math.radians(_YAWS_DEG[n])
                if num_cameras == len(_YAWS_DEG)
                else 2.0 * math.pi * n / num_cameras
            )
            ego_from_camera[b, n, :3, :3] = _looking(yaw, 0.002 * b)
            offset_m = (1.0 + 0.7 * math.cos(yaw), 0.5 * math.sin(yaw), 1.5)
            ego_from_camera[b, n, :3, 3] = torch.tensor(offset_m)
    return pixel_from_camera.expand(num_samples, num_cameras, 3, 3).contiguous(), ego_from_camera


def _looking(yaw_rad: float, pitch_rad: float) -> Tensor:
    """[3, 3] rotation of a level camera turned to the left, then nodding down."""
    ahead = torch.tensor([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
    cos, sin = math.cos(yaw_rad), math.sin(yaw_rad)
    turn = torch.tensor([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])
    cos, sin = math.cos(pitch_rad), math.sin(pitch_rad)
    nod = torch.tensor([[cos, 0.0, sin], [0.0, 1.0, 0.0], [-sin, 0.0, cos]])
    return nod @ turn @ ahead


def batch(num_samples: int, num_cameras: int = 6) -> Batch:
    """Images of noise and their calibration; always the same."""
    random = torch.Generator().manual_seed(0)
    pixel_from_camera, ego_from_camera = rig(num_samples, num_cameras)
    shape = (num_samples, num_cameras, 3, *IMAGE_HW)
    return Batch(
        images=torch.randint(0, 256, shape, dtype=torch.uint8, generator=random),
        pixel_from_camera=pixel_from_camera,
        ego_from_camera=ego_from_camera,
        camera_mask=torch.ones(num_samples, num_cameras, dtype=torch.bool),
        sample_idx=torch.arange(num_samples),
        points=torch.zeros(0, 5),
        point_counts=torch.zeros(num_samples, dtype=torch.long),
    )


def with_grid(cells_a_side: int) -> ModelConfig:
    """The paper's model on a grid of the same extent with more or fewer cells."""
    return replace(MODEL, grid=BevGrid(cell_m=100.0 / cells_a_side))
