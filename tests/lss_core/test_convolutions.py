"""Convolutions done another way: the same sums, the same parameters, and no memory overwritten."""

import os
import subprocess
import sys

import pytest
import timm
import torch
from torch import nn

from lss_core.bev_encoder import BevEncoder
from lss_core.convolutions import DepthwiseConv2d, StridedPointwiseConv2d, suit_cpus
from lss_core.image_encoder import ImageEncoder

pytestmark = pytest.mark.trains


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
    suit_cpus(net)
    assert torch.equal(torch.random.get_rng_state(), parameters), "it drew random numbers"
    kinds = [type(module) is DepthwiseConv2d for module in net.modules()]
    assert sum(kinds) == 2  # the grouped one whose groups have two channels each stays
    assert list(net.state_dict()) == list(state)
    images = torch.randn(2, 3, 20, 24)
    assert torch.equal(net(images), same(images))


def test_all_of_an_efficientnet_are_found() -> None:
    net = timm.create_model("efficientnet_b0", features_only=True)
    num = sum(isinstance(m, nn.Conv2d) and m.groups == m.in_channels for m in net.modules())
    suit_cpus(net)
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


def _shortcut(stride: tuple[int, int], bias: bool) -> nn.Sequential:
    torch.manual_seed(0)
    return nn.Sequential(nn.Conv2d(4, 6, 1, stride=stride, bias=bias)).double()


@pytest.mark.parametrize("stride", [(2, 2), (3, 3), (1, 2)])
@pytest.mark.parametrize("size", [(8, 12), (9, 11), (1, 1)])
@pytest.mark.parametrize("bias", [True, False])
def test_a_strided_1x1_convolution_is_a_plain_one_on_the_pixels_it_reads(
    stride: tuple[int, int], size: tuple[int, int], bias: bool
) -> None:
    net, same = _shortcut(stride, bias), _shortcut(stride, bias)
    suit_cpus(net)
    assert type(net[0]) is StridedPointwiseConv2d
    assert list(net.state_dict()) == list(same.state_dict())
    image = torch.randn(2, 4, *size, dtype=torch.float64, requires_grad=True)
    result, expected = net(image), same(image)
    torch.testing.assert_close(result, expected)
    weights = torch.randn_like(expected)
    for ours, theirs in zip(
        torch.autograd.grad((result * weights).sum(), [image, *net.parameters()]),
        torch.autograd.grad((expected * weights).sum(), [image, *same.parameters()]),
        strict=True,
    ):
        torch.testing.assert_close(ours, theirs)


def test_no_network_of_ours_has_a_strided_1x1_convolution_left() -> None:
    nets = [
        ImageEncoder("plain-4-6-8", "none", 5, 7, 8, neck_channels=8),
        ImageEncoder("resnet50", "none", 5, 7, 8, neck_channels=8),
        BevEncoder(3, 1, stem_channels=2, decoder_channels=4),
    ]
    for net in nets:
        strided = [
            module
            for module in net.modules()
            if isinstance(module, nn.Conv2d)
            and module.kernel_size == (1, 1)
            and module.stride != (1, 1)
        ]
        assert strided
        assert all(type(module) is StridedPointwiseConv2d for module in strided)


_BACKWARD = """
import torch
from lss_core.convolutions import suit_cpus

torch.manual_seed(0)
net = torch.nn.Sequential(torch.nn.Conv2d({inputs}, 8, 1, stride=2, bias=False))
suit_cpus(net)
for _ in range(60):
    x = torch.rand(12, {inputs}, 8, 24).contiguous(memory_format=torch.channels_last)
    net(x.requires_grad_()).square().sum().backward()
print("ended well")
"""


@pytest.mark.parametrize("inputs", [2, 3, 4, 6])
def test_its_gradient_overwrites_no_memory_on_older_processors(inputs: int) -> None:
    # In a process of its own: torch's own convolution ends it here, or spoils what comes later.
    ended = subprocess.run(
        [sys.executable, "-c", _BACKWARD.format(inputs=inputs)],
        env={**os.environ, "ONEDNN_MAX_CPU_ISA": "AVX2", "OMP_NUM_THREADS": "1"},
        capture_output=True,
        text=True,
        check=False,
    )
    assert (ended.returncode, ended.stdout.strip()) == (0, "ended well"), ended.stderr
