"""Depthwise convolutions that train in float32 on CPUs, also under mixed precision."""

import torch
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


def train_depthwise_in_float32(net: nn.Module) -> None:
    """Put a `DepthwiseConv2d` with the same parameters in place of each depthwise convolution.

    Subclasses of Conv2d stay as they are: they have ways of their own.
    """
    for parent in list(net.modules()):
        for name, conv in list(parent.named_children()):
            if type(conv) is not nn.Conv2d or conv.groups == 1 or conv.groups != conv.in_channels:
                continue
            replacement = DepthwiseConv2d(
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
            replacement.weight, replacement.bias = conv.weight, conv.bias
            setattr(parent, name, replacement)
