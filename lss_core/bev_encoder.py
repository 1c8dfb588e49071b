"""From splatted context to the output map: three ResNet-18 stages and a small decoder."""

import torch
import torch.nn.functional as F
from jaxtyping import Float
from torch import Tensor, nn
from torchvision.models.resnet import BasicBlock


class BevEncoder(nn.Module):
    """A map of the same cells as the input, any number of cells.

    A 7x7 convolution of stride 2, then ResNet-18's first three stages: x1 (2 cells), x2 (4),
    x3 (8). x3 is upsampled, joined with x1, mixed, upsampled to all cells and read out.

    Paper: section 4.1. Deviation: upsampling does not align corners, see docs/deviations.md.

    Args:
        in_channels: C.
        out_channels: Channels of the map. A single one has no bias: it would be the same cost
            everywhere.
        stem_channels: Width of the first stage; the next ones have two and four times as much.
        decoder_channels: Width of the two convolutions after joining; the one at full resolution
            has half of it.
        head_init_std: Standard deviation of the last layer's weights at the start. Small: sums over
            trajectories then start almost equal, which trains faster.
    """

    def __init__(
        self,
        in_channels: int,
        out_channels: int = 1,
        stem_channels: int = 64,
        decoder_channels: int = 256,
        head_init_std: float = 1e-3,
    ) -> None:
        super().__init__()
        c1, c2, c3 = stem_channels, 2 * stem_channels, 4 * stem_channels
        self.stem = nn.Sequential(
            nn.Conv2d(in_channels, c1, 7, stride=2, padding=3, bias=False),
            nn.BatchNorm2d(c1),
            nn.ReLU(inplace=True),
        )
        self.stage1 = nn.Sequential(BasicBlock(c1, c1), BasicBlock(c1, c1))
        self.stage2 = _stage(c1, c2)
        self.stage3 = _stage(c2, c3)
        wide, narrow = decoder_channels, decoder_channels // 2
        self.mix = nn.Sequential(*_conv_bn_relu(c3 + c1, wide), *_conv_bn_relu(wide, wide))
        self.smooth = nn.Sequential(*_conv_bn_relu(wide, narrow))
        self.head = nn.Conv2d(narrow, out_channels, 1, bias=out_channels > 1)
        for module in self.modules():
            if isinstance(module, nn.Conv2d):
                nn.init.kaiming_normal_(module.weight, mode="fan_out", nonlinearity="relu")
        nn.init.normal_(self.head.weight, std=head_init_std)
        if self.head.bias is not None:
            nn.init.zeros_(self.head.bias)

    def forward(self, bev: Float[Tensor, "B Cin X Y"]) -> Float[Tensor, "B Cout X Y"]:
        """The output map, on the input's cells."""
        x1 = self.stage1(self.stem(bev))
        x3 = self.stage3(self.stage2(x1))
        joined = self.mix(torch.cat([_resize(x3, x1.shape[-2:]), x1], dim=1))
        output: Tensor = self.head(self.smooth(_resize(joined, bev.shape[-2:])))
        return output


def _resize(x: Float[Tensor, "B C X Y"], shape: torch.Size) -> Float[Tensor, "B C X2 Y2"]:
    return F.interpolate(x, size=tuple(shape), mode="bilinear", align_corners=False)


def _stage(in_channels: int, out_channels: int) -> nn.Sequential:
    """A ResNet-18 stage that halves the resolution."""
    shortcut = nn.Sequential(
        nn.Conv2d(in_channels, out_channels, 1, stride=2, bias=False),
        nn.BatchNorm2d(out_channels),
    )
    return nn.Sequential(
        BasicBlock(in_channels, out_channels, stride=2, downsample=shortcut),
        BasicBlock(out_channels, out_channels),
    )


def _conv_bn_relu(in_channels: int, out_channels: int) -> tuple[nn.Module, ...]:
    return (
        nn.Conv2d(in_channels, out_channels, 3, padding=1, bias=False),
        nn.BatchNorm2d(out_channels),
        nn.ReLU(inplace=True),
    )
