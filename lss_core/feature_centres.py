"""Which pixel a network's features look at, measured at the network itself."""

import math

import torch
from torch import Tensor

from lss_core.image_encoder import ImageEncoder

_CELLS = 8  # of features on each side of the one that is asked
_DRAWS = 4


def first_feature_px(encoder: ImageEncoder, stride: int, seed: int = 0) -> tuple[float, float]:
    """Column and row of the pixel that feature cell (0, 0) looks at, as the weights are now.

    That is the centroid of the gradient's absolute values: by how much each pixel moves what a
    feature cell says, over some random images and random sums of its channels. It is the cell's own
    centre, (stride - 1) / 2, only where a network pads more to the right and below than to the left
    and above; most pad alike, so that each of their strides looks half a pixel up and left. A
    network that nothing moves, as one of zeros, looks at the centre.

    Args:
        encoder: Asked in evaluation mode; left as it was, gradients and random numbers included.
        stride: Pixels per feature cell.
        seed: Of images and sums.

    Deviation: the paper does not say which pixel a feature stands for, see docs/deviations.md.
    """
    generator = torch.Generator().manual_seed(seed)
    side_px = 2 * _CELLS * stride
    device = encoder.mean.device
    images = torch.rand(_DRAWS, 3, side_px, side_px, generator=generator).to(device)
    was_training = encoder.training
    encoder.eval()
    with torch.autocast(device.type, enabled=False), torch.enable_grad():
        images.requires_grad_()
        asked = torch.cat(encoder(images), dim=1)[:, :, _CELLS, _CELLS]
        sums = torch.randn(asked.shape, generator=generator).to(device)
        (gradient,) = torch.autograd.grad((asked * sums).sum(), images)
    encoder.train(was_training)
    influence = gradient.double().abs().sum(dim=(0, 1))  # H W
    if not 0.0 < float(influence.sum()) < math.inf:
        return (stride - 1) / 2, (stride - 1) / 2
    first_row_px, first_column_px = (
        _centroid(influence.sum(dim=other)) - _CELLS * stride for other in (1, 0)
    )
    return first_column_px, first_row_px


def _centroid(weight: Tensor) -> float:
    place = torch.arange(len(weight), dtype=weight.dtype, device=weight.device)
    return float((weight * place).sum() / weight.sum())
