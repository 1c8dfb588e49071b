"""Lift and splat at paper size: one embedding bag against the paper's cumulative sum.

The fast sides keep freed memory, as training does.
"""

from collections.abc import Callable
from typing import Any

import torch
from torch import Tensor

from benchmarks import paper_size
from lss_core.camera import frustum_points
from lss_core.splat import SplatIndex, build_splat_index, pool
from lss_core.splat_reference import lift_splat_cumsum
from shoot.training.allocation import keep_freed_memory

NUM_SAMPLES = 4
_STRIDE = paper_size.MODEL.image_stride
_GRID = paper_size.MODEL.grid


def features() -> tuple[Tensor, Tensor]:
    """[B, N, C, H, W] context and [B, N, D, H, W] depth probabilities, as a network gives them."""
    random = torch.Generator().manual_seed(0)
    height, width = (side // _STRIDE for side in paper_size.IMAGE_HW)
    depths = len(paper_size.MODEL.depth.depths_m)
    channels = paper_size.MODEL.context_channels
    shape = (NUM_SAMPLES * 6, channels + depths, height, width)
    features = torch.randn(shape, generator=random).contiguous(memory_format=torch.channels_last)
    depth_prob = features[:, :depths].permute(0, 2, 3, 1).softmax(dim=-1).permute(0, 3, 1, 2)
    context = features[:, depths:]
    return (
        context.view(NUM_SAMPLES, 6, *context.shape[1:]),
        depth_prob.view(NUM_SAMPLES, 6, *depth_prob.shape[1:]),
    )


def _points() -> Tensor:
    depths_m = paper_size.MODEL.depth.depths_m
    return frustum_points(paper_size.IMAGE_HW, _STRIDE, depths_m, *paper_size.rig(NUM_SAMPLES))


def _index() -> SplatIndex:
    return build_splat_index(_points(), _GRID)


def _plain_map(context: Tensor, depth_prob: Tensor) -> Tensor:
    return lift_splat_cumsum(context, depth_prob, _points(), _GRID)


def _there_and_back(splat: Callable[[Tensor, Tensor], Tensor]) -> Callable[[], Any]:
    context, depth_prob = (values.requires_grad_() for values in features())
    gradient = torch.randn(
        (NUM_SAMPLES, context.shape[2], *_GRID.shape), generator=torch.Generator().manual_seed(1)
    ).contiguous(memory_format=torch.channels_last)

    def run() -> Any:
        return torch.autograd.grad(splat(context, depth_prob), (context, depth_prob), gradient)

    return run


def plain_training() -> Callable[[], Any]:
    """Forward and backward by cumulative sums."""
    return _there_and_back(_plain_map)


def fast_training_new() -> Callable[[], Any]:
    """Forward and backward by an embedding bag whose index is built anew at each call."""
    keep_freed_memory()
    return _there_and_back(lambda context, prob: pool(context, prob, _index(), _GRID))


def fast_training_static() -> Callable[[], Any]:
    """Forward and backward by an embedding bag whose calibration has been seen before."""
    keep_freed_memory()
    index = _index()
    return _there_and_back(lambda context, prob: pool(context, prob, index, _GRID))


def plain_forward() -> Callable[[], Any]:
    """Forward by cumulative sums."""
    context, depth_prob = features()
    return torch.no_grad()(lambda: _plain_map(context, depth_prob))


def fast_forward_static() -> Callable[[], Any]:
    """Forward by an embedding bag whose calibration has been seen before."""
    keep_freed_memory()
    context, depth_prob = features()
    index = _index()
    return torch.no_grad()(lambda: pool(context, depth_prob, index, _GRID))
