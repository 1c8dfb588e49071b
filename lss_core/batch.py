"""What the models read: images and where each pixel looks, or lidar points."""

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace

import torch
from jaxtyping import Bool, Float, Int, Shaped
from torch import Tensor


@dataclass(frozen=True)
class Batch:
    """One or more samples; a single sample has no leading B.

    A batch of lidar scans has no cameras (N = 0), one of images no points (P = 0).

    Attributes:
        images: RGB, uint8 in 0..255 (or float in 0..1).
        pixel_from_camera: Intrinsics with the augmentation folded in.
        ego_from_camera: Camera pose in the ego frame of the sample's lidar time.
        camera_mask: False where a camera is missing or dropped.
        sample_idx: Row of the sample in its `SampleIndex`.
        points: x, y, z in metres in `ego`, intensity 0 to 255, age in seconds; those of a batch's
            samples one after the other.
        point_counts: How many of them each sample has.
    """

    images: Shaped[Tensor, "*B N 3 H W"]
    pixel_from_camera: Float[Tensor, "*B N 3 3"]
    ego_from_camera: Float[Tensor, "*B N 4 4"]
    camera_mask: Bool[Tensor, "*B N"]
    sample_idx: Int[Tensor, "*B"]
    points: Float[Tensor, "P 5"]
    point_counts: Int[Tensor, "*B"]

    @property
    def point_offsets(self) -> Int[Tensor, "*B"]:
        """Where each sample's points begin."""
        return self.point_counts.cumsum(0) - self.point_counts

    def to(self, device: torch.device | str, non_blocking: bool = False) -> "Batch":
        """The same on another device."""
        moved = {
            f.name: getattr(self, f.name).to(device, non_blocking=non_blocking)
            for f in fields(self)
        }
        return replace(self, **moved)

    def pin_memory(self) -> "Batch":
        """The same in page-locked memory, for faster copies to a GPU."""
        return replace(self, **{f.name: getattr(self, f.name).pin_memory() for f in fields(self)})


def collate(samples: Sequence[Batch]) -> Batch:
    """Join single samples of equal rigs and image sizes into one batch."""
    stacked = {
        f.name: torch.stack([getattr(sample, f.name) for sample in samples])
        for f in fields(Batch)
        if f.name != "points"
    }
    return Batch(points=torch.cat([sample.points for sample in samples]), **stacked)
