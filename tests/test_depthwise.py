"""Depthwise convolutions under mixed precision: float32 arithmetic, the same parameters."""

import timm
import torch
from torch import nn

from lss_core.depthwise import DepthwiseConv2d, train_depthwise_in_float32


def _net() -> nn.Sequential:
    torch.manual_seed(0)
    return nn.Sequential(
        nn.Conv2d(3, 8, 3),
        nn.Conv2d(8, 8, 5, stride=2, padding=2, groups=8),
        nn.Sequential(nn.Conv2d(8, 16, 3, groups=8, bias=False, dilation=2), nn.Conv2d(16, 4, 1)),
        nn.Conv2d(4, 4, 3, groups=2),
    )


def test_depthwise_ones_are_replaced_and_nothing_changes() -> None:
    net, same = _net(), _net()
    parameters, state = torch.random.get_rng_state(), net.state_dict()
    train_depthwise_in_float32(net)
    assert torch.equal(torch.random.get_rng_state(), parameters), "it drew random numbers"
    kinds = [type(module) is DepthwiseConv2d for module in net.modules()]
    assert sum(kinds) == 2  # the grouped one whose groups have two channels each stays
    assert list(net.state_dict()) == list(state)
    images = torch.randn(2, 3, 20, 24)
    assert torch.equal(net(images), same(images))


def test_all_of_an_efficientnet_are_found() -> None:
    net = timm.create_model("efficientnet_b0", features_only=True)
    num = sum(isinstance(m, nn.Conv2d) and m.groups == m.in_channels for m in net.modules())
    train_depthwise_in_float32(net)
    assert num == sum(isinstance(module, DepthwiseConv2d) for module in net.modules()) == 16


def test_float32_inside_and_the_input_s_type_outside() -> None:
    torch.manual_seed(0)
    conv = DepthwiseConv2d(4, 4, 5, padding=2, groups=4)
    images = torch.randn(2, 4, 16, 16)
    exact = conv(images.bfloat16().float())
    with torch.autocast("cpu", torch.bfloat16):
        result = conv(images.bfloat16())
        (gradient,) = torch.autograd.grad(conv(images.bfloat16()).float().sum(), conv.weight)
    assert result.dtype == torch.bfloat16
    assert torch.equal(result, exact.bfloat16())
    (expected,) = torch.autograd.grad(conv(images.bfloat16().float()).sum(), conv.weight)
    torch.testing.assert_close(gradient, expected, rtol=1e-6, atol=1e-4)
