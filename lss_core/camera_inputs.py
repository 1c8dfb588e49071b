"""What a camera model refuses to be given: images and calibrations that do not fit."""

import torch
from jaxtyping import Shaped
from torch import Tensor


def check_cameras(
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


def check_range(images: Shaped[Tensor, "M 3 Hi Wi"]) -> None:
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
