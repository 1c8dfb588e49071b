"""What the models read: images, where each pixel looks, and which cameras are there."""

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace

import torch
from jaxtyping import Bool, Float, Int, Shaped
from torch import Tensor


@dataclass(frozen=True)
class Batch:
    """One or more samples of a camera rig; a single sample has no leading B.

    Attributes:
        images: RGB, uint8 in 0..255 (or float in 0..1).
        pixel_from_camera: Intrinsics with the augmentation folded in.
        ego_from_camera: Camera pose in the ego frame of the sample's lidar time.
        camera_mask: False where a camera is missing or dropped.
        sample_idx: Row of the sample in its `SampleIndex`.
    """

    images: Shaped[Tensor, "*B N 3 H W"]
    pixel_from_camera: Float[Tensor, "*B N 3 3"]
    ego_from_camera: Float[Tensor, "*B N 4 4"]
    camera_mask: Bool[Tensor, "*B N"]
    sample_idx: Int[Tensor, "*B"]

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
    """Stack single samples of equal rigs and image sizes into one batch."""
    return Batch(
        **{
            f.name: torch.stack([getattr(sample, f.name) for sample in samples])
            for f in fields(Batch)
        }
    )
