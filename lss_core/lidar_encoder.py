"""From lidar points to a map of pillars: PointPillars' first network, in plain PyTorch."""

import math
from collections.abc import Iterator
from typing import Any

import torch
from jaxtyping import Float, Int
from torch import Tensor, nn

from lss_core.grid import BevGrid

# Of a point: x, y from its cell's centre, z, intensity, age.
_POINT_FEATURES = 5
# Of a pillar: x, y of its cell; mean x, y, z of its points.
_PILLAR_FEATURES = 5
_HEIGHT_M = 3.0
# What stays in the cache of a processor.
_PIECE_ROWS = 8192


class PillarEncoder(nn.Module):
    """Each cell's largest features over the points above it; zero where there are none.

    PointPillars' layer: linear in what is known of a point and of its place in the pillar, largest
    over the pillar's points, batch norm, rectified. What all points of a pillar share is added
    after the maximum, and batch norm follows it, too: both leave the maximum where it is (but for
    a channel whose scale has become negative), for a fraction of the work. A pillar has no limit
    of points.

    Paper: section 5.6 (its lidar planners are PointPillars').

    Args:
        grid: Cells.
        channels: C of the map.
        z_min_m: Points below are dropped.
        z_max_m: Points at or above are dropped.
    """

    def __init__(self, grid: BevGrid, channels: int, z_min_m: float, z_max_m: float) -> None:
        super().__init__()
        self.grid = grid
        self.channels = channels
        self.z_min_m, self.z_max_m = z_min_m, z_max_m
        self.of_point = nn.Linear(_POINT_FEATURES, channels, bias=False)
        self.of_pillar = nn.Linear(_PILLAR_FEATURES, channels, bias=False)
        # Over pillars, which take the place of samples; of two dimensions, as all others are.
        self.norm = nn.BatchNorm2d(channels)

    def forward(
        self, points: Float[Tensor, "P 5"], offsets: Int[Tensor, " B"]
    ) -> Float[Tensor, "B C X Y"]:
        """The map of each sample; float32 also under mixed precision.

        Args:
            points: x, y, z in metres in `ego`, intensity 0 to 255, age in seconds; the samples'
                one after the other. Those outside the grid or its heights are dropped.
            offsets: Where each sample's begin.
        """
        num_x, num_y = self.grid.shape
        num_pillars = len(offsets) * num_x * num_y
        with torch.autocast(points.device.type, enabled=False):
            features, pillar_idx = self._features(points.to(self.norm.weight.dtype), offsets)
            pillars = features.new_zeros(num_pillars, self.channels)
            if len(features):
                largest = _LargestOfEach.apply(
                    features, self.of_point.weight, pillar_idx, num_pillars
                )
                occupied, shared = self._shared_features(features, pillar_idx, num_pillars)
                values = largest[occupied] + self.of_pillar(shared)
                values = self.norm(values[:, :, None, None])[:, :, 0, 0].relu()
                pillars = pillars.index_copy(0, occupied, values)
        output = pillars.view(len(offsets), num_x, num_y, self.channels)
        return output.permute(0, 3, 1, 2)

    def _features(
        self, points: Float[Tensor, "P 5"], offsets: Int[Tensor, " B"]
    ) -> tuple[Float[Tensor, "Q F"], Int[Tensor, " Q"]]:
        """Of the points within reach, in units that make all about one; and their pillars.

        Pillars are counted through all samples.
        """
        num_x, num_y = self.grid.shape
        cells, inside = self.grid.cells(points[:, :2])
        inside &= (points[:, 2] >= self.z_min_m) & (points[:, 2] < self.z_max_m)
        kept = inside.nonzero()[:, 0]
        # The last sample that begins at or before the point; empty ones begin where the next does.
        sample = torch.searchsorted(offsets, kept, right=True) - 1
        cells, points = cells[kept], points[kept]
        pillar_idx = (sample * num_x + cells[:, 0]) * num_y + cells[:, 1]
        from_centre = self.grid.continuous_cells(points[:, :2]) - cells - 0.5
        units = points.new_tensor([1.0 / _HEIGHT_M, 1.0 / 255.0, 1.0])
        return torch.cat([2.0 * from_centre, points[:, 2:] * units], dim=1), pillar_idx

    def _shared_features(
        self, features: Float[Tensor, "Q F"], pillar_idx: Int[Tensor, " Q"], num_pillars: int
    ) -> tuple[Int[Tensor, " O"], Float[Tensor, "O F2"]]:
        """The pillars that have points, and what their points share."""
        places = torch.cat([features[:, :3], torch.ones_like(features[:, :1])], dim=1)
        sums = places.new_zeros(num_pillars, 4).index_add_(0, pillar_idx, places)
        occupied = sums[:, 3].nonzero()[:, 0]
        sums = sums[occupied]
        num_x, num_y = self.grid.shape
        cell = torch.stack([occupied // num_y % num_x, occupied % num_y], dim=1)
        middle = 2.0 * (cell + 0.5) / cell.new_tensor([num_x, num_y]) - 1.0
        return occupied, torch.cat([middle.to(sums.dtype), sums[:, :3] / sums[:, 3:]], dim=1)


class _LargestOfEach(torch.autograd.Function):
    """Largest value of a linear layer over each group of rows; its gradient goes to the weights.

    Autograd's own way makes five arrays of all rows and channels, and its gradient of a maximum
    looks for ties. Here a piece of the rows at a time stays in the processor's cache, forward and
    backward. A GPU takes all rows at once.
    """

    @staticmethod
    def forward(
        ctx: Any,
        features: Float[Tensor, "Q F"],
        weight: Float[Tensor, "C F"],
        group: Int[Tensor, " Q"],
        num_groups: int,
    ) -> Float[Tensor, "G C"]:
        """[G, C]; minus infinity where a group has no rows."""
        values = features.new_empty(len(features), len(weight))
        largest = features.new_full((num_groups, len(weight)), -math.inf)
        for rows in _pieces(features):
            torch.mm(features[rows], weight.t(), out=values[rows])
            index = group[rows, None].expand(-1, len(weight))
            largest.scatter_reduce_(0, index, values[rows], "amax")
        ctx.save_for_backward(features, group, values, largest)
        return largest

    @staticmethod
    def backward(
        ctx: Any, *gradients: Float[Tensor, "G C"]
    ) -> tuple[None, Float[Tensor, "C F"], None, None]:
        """Of several rows that share the largest value, each gets the whole gradient."""
        features, group, values, largest = ctx.saved_tensors
        (gradient,) = gradients
        of_weight = gradient.new_zeros(gradient.shape[1], features.shape[1])
        for rows in _pieces(features):
            own = group[rows]
            has_largest = values[rows] == largest[own]
            of_weight.addmm_((gradient[own] * has_largest).t(), features[rows])
        return None, of_weight, None, None


def _pieces(rows: Float[Tensor, "Q F"]) -> Iterator[slice]:
    step = _PIECE_ROWS if rows.device.type == "cpu" else max(1, len(rows))
    return (slice(start, start + step) for start in range(0, len(rows), step))
