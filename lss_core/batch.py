"""What the models read: images and where each pixel looks, or lidar points."""

from collections.abc import Sequence
from dataclasses import dataclass, field, fields, replace
from typing import Any

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
        every_camera: True if the host knows that no camera is masked, so that it need not wait for
            a GPU to tell. Settled when a batch is moved there.
    """

    images: Shaped[Tensor, "*B N 3 H W"]
    pixel_from_camera: Float[Tensor, "*B N 3 3"]
    ego_from_camera: Float[Tensor, "*B N 4 4"]
    camera_mask: Bool[Tensor, "*B N"]
    sample_idx: Int[Tensor, "*B"]
    points: Float[Tensor, "P 5"]
    point_counts: Int[Tensor, "*B"]
    # No argument: a copy with another mask does not keep it.
    every_camera: bool = field(init=False, default=False)

    @property
    def point_offsets(self) -> Int[Tensor, "*B"]:
        """Where each sample's points begin."""
        return self.point_counts.cumsum(0) - self.point_counts

    def to(self, device: torch.device | str, non_blocking: bool = False) -> "Batch":
        """The same on another device."""
        moved = replace(
            self, **{n: t.to(device, non_blocking=non_blocking) for n, t in self._tensors().items()}
        )
        on_host = self.camera_mask.device.type == "cpu"
        every_camera = bool(self.camera_mask.all()) if on_host else self.every_camera
        object.__setattr__(moved, "every_camera", every_camera)
        return moved

    def pin_memory(self) -> "Batch":
        """The same in page-locked memory, for faster copies to a GPU."""
        return replace(self, **{n: t.pin_memory() for n, t in self._tensors().items()})

    def _tensors(self) -> dict[str, Any]:
        return {f.name: getattr(self, f.name) for f in fields(self) if f.init}


def collate(samples: Sequence[Batch]) -> Batch:
    """Join single samples of equal rigs and image sizes into one batch."""
    stacked = {
        f.name: torch.stack([getattr(sample, f.name) for sample in samples])
        for f in fields(Batch)
        if f.init and f.name != "points"
    }
    return Batch(points=torch.cat([sample.points for sample in samples]), **stacked)
