"""Convolutions that CPUs had better do another way: the same sums, the same parameters."""

from collections.abc import Callable

import torch
import torch.nn.functional as F
from jaxtyping import Float
from torch import Tensor, nn


class DepthwiseConv2d(nn.Conv2d):
    """A depthwise convolution; on CPUs it trains in float32 whatever autocast says.

    Matrix units are of no use to it, and its gradients in bfloat16 take four to five times as long
    as in float32. The result has the input's type, so that what follows goes on in bfloat16. In
    evaluation, where there are no gradients, the detour would only cost.
    """

    def forward(self, x: Float[Tensor, "B C H W"]) -> Float[Tensor, "B C2 H2 W2"]:
        """The convolved input, in its own type."""
        if not (self.training and x.device.type == "cpu" and torch.is_autocast_enabled("cpu")):
            return super().forward(x)
        with torch.autocast("cpu", enabled=False):
            return super().forward(x.float()).to(x.dtype)


class StridedPointwiseConv2d(nn.Conv2d):
    """A 1x1 convolution with a stride, done as one without on the pixels it reads.

    With few input channels, innermost in memory, the gradient of torch 2.14.1's own writes beyond
    its memory on CPUs whose best unit is AVX2.
    """

    def forward(self, x: Float[Tensor, "B C H W"]) -> Float[Tensor, "B C2 H2 W2"]:
        """The convolved input."""
        rows, columns = self.stride
        return F.conv2d(x[..., ::rows, ::columns], self.weight, self.bias)


def suit_cpus(net: nn.Module) -> None:
    """Put a `DepthwiseConv2d` or `StridedPointwiseConv2d` in place of each such convolution.

    They have the same parameters, by the same names. Subclasses of Conv2d stay as they are: they
    have ways of their own.
    """
    _replace(net, _is_depthwise, DepthwiseConv2d)
    _replace(net, _is_strided_pointwise, StridedPointwiseConv2d)


def _is_depthwise(conv: nn.Conv2d) -> bool:
    return conv.groups > 1 and conv.groups == conv.in_channels


def _is_strided_pointwise(conv: nn.Conv2d) -> bool:
    return (
        conv.kernel_size == (1, 1)
        and conv.stride != (1, 1)
        and conv.padding == (0, 0)
        and conv.groups == 1
    )


def _replace(
    net: nn.Module, is_one: Callable[[nn.Conv2d], bool], replacement: type[nn.Conv2d]
) -> None:
    for parent in list(net.modules()):
        for name, conv in list(parent.named_children()):
            if type(conv) is not nn.Conv2d or not is_one(conv):
                continue
            new = replacement(
                conv.in_channels,
                conv.out_channels,
                conv.kernel_size,  # type: ignore[arg-type]
                conv.stride,  # type: ignore[arg-type]
                conv.padding,  # type: ignore[arg-type]
                conv.dilation,  # type: ignore[arg-type]
                conv.groups,
                conv.bias is not None,
                conv.padding_mode,
                device="meta",  # its own parameters are not drawn: they would cost random numbers
            )
            new.weight, new.bias = conv.weight, conv.bias
            setattr(parent, name, new)
