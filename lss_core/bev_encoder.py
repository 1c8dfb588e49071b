"""From splatted context to the output map: three ResNet-18 stages and a small decoder."""

from typing import NamedTuple

import torch
import torch.nn.functional as F
from jaxtyping import Float
from torch import Tensor, nn
from torchvision.models.resnet import BasicBlock

from lss_core.config import ModelConfig
from lss_core.convolutions import suit_cpus
from lss_core.grid import CellWindow


class BevEncoder(nn.Module):
    """A map of the same cells as the input, any number of cells.

    A 7x7 convolution of stride 2, then ResNet-18's first three stages: x1 (2 cells), x2 (4),
    x3 (8). x3 is upsampled, joined with x1, mixed, upsampled to all cells and read out.

    Paper: section 4.1. Deviation: upsampling does not align corners, see docs/deviations.md.

    Args:
        in_channels: C.
        out_channels: Channels of the map. They have no bias: as a cost it would be the same
            everywhere, and what else needs one adds it.
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
        self.head = nn.Conv2d(narrow, out_channels, 1, bias=False)
        suit_cpus(self)
        for module in self.modules():
            if isinstance(module, nn.Conv2d):
                nn.init.kaiming_normal_(module.weight, mode="fan_out", nonlinearity="relu")
        nn.init.normal_(self.head.weight, std=head_init_std)

    def forward(
        self, bev: Float[Tensor, "B Cin X Y"], window: CellWindow | None = None
    ) -> Float[Tensor, "B Cout X2 Y2"]:
        """The output map, on the input's cells.

        Args:
            bev: Context per cell.
            window: Give only these cells of the map, the same values for less: two thirds of the
                work lie in the decoder, which then runs where it is needed. Not for training:
                batch statistics would be the window's.
        """
        x1 = self.stage1(self.stem(bev))
        x3 = self.stage3(self.stage2(x1))
        joined = torch.cat([_resize(x3, x1.shape[-2:]), x1], dim=1)
        if window is None:
            fine = _resize(self.mix(joined), bev.shape[-2:])
            output: Tensor = self.head(self.smooth(fine))
            return output
        rows = _Cut.of(window.x_start, window.x_stop, bev.shape[-2], x1.shape[-2])
        columns = _Cut.of(window.y_start, window.y_stop, bev.shape[-1], x1.shape[-1])
        mixed = self.mix(joined[..., rows.coarse, columns.coarse])
        fine = _resize(mixed, (rows.fine_size, columns.fine_size))[..., rows.fine, columns.fine]
        output = self.head(self.smooth(fine)[..., rows.output, columns.output])
        return output


def make_bev_encoder(config: ModelConfig, out_channels: int) -> BevEncoder:
    """The network of the map, as wide as a configuration says.

    Args:
        config: Sizes; the input has `context_channels`.
        out_channels: Channels of the map.
    """
    return BevEncoder(
        in_channels=config.context_channels,
        out_channels=out_channels,
        stem_channels=config.stem_channels,
        decoder_channels=config.decoder_channels,
        head_init_std=config.head_init_std,
    )


class _Cut(NamedTuple):
    """What the decoder needs of one axis for a range of output cells.

    Attributes:
        coarse: Cells of the joined map, at half the resolution.
        fine_size: What they are upsampled to.
        fine: Of these, the output cells and one more on each side.
        output: Of these, the output cells.
    """

    coarse: slice
    fine_size: int
    fine: slice
    output: slice

    @staticmethod
    def of(start: int, stop: int, num_fine: int, num_coarse: int) -> "_Cut":
        """The cut for cells `start` to `stop` of `num_fine`."""
        if num_fine != 2 * num_coarse:  # the cells of the two maps do not line up
            low, high, first, fine_size = 0, num_coarse, 0, num_fine
        else:
            # The last convolution looks one fine cell far, upsampling one coarse cell, the two
            # convolutions before it two more.
            low, high = max(0, start // 2 - 4), min(num_coarse, -(-stop // 2) + 4)
            first, fine_size = 2 * low, 2 * (high - low)
        fine_start, fine_stop = max(0, start - 1), min(num_fine, stop + 1)
        return _Cut(
            slice(low, high),
            fine_size,
            slice(fine_start - first, fine_stop - first),
            slice(start - fine_start, stop - fine_start),
        )


def _resize(
    x: Float[Tensor, "B C X Y"], shape: torch.Size | tuple[int, int]
) -> Float[Tensor, "B C X2 Y2"]:
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
