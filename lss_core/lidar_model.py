"""Points of lidar scans in, a bird's-eye-view map out."""

from jaxtyping import Float, Int
from torch import Tensor, nn

from lss_core.batch import Batch
from lss_core.bev_encoder import make_bev_encoder
from lss_core.config import ModelConfig
from lss_core.lidar_encoder import PillarEncoder


class LidarModel(nn.Module):
    """Pillars of lidar points, and the same network behind them as behind the cameras'.

    Paper: section 5.6 (planning from lidar, with PointPillars).

    Args:
        config: Sizes and choices; `context_channels` is the length of a pillar's features, and what
            is about images plays no part.
        out_channels: Channels of the map.
    """

    def __init__(self, config: ModelConfig, out_channels: int = 1) -> None:
        super().__init__()
        self.config = config
        self.pillar_encoder = PillarEncoder(
            config.grid, config.context_channels, config.z_min_m, config.z_max_m
        )
        self.bev_encoder = make_bev_encoder(config, out_channels)

    def forward(
        self, points: Float[Tensor, "P 5"], offsets: Int[Tensor, " B"]
    ) -> Float[Tensor, "B Cout X Y"]:
        """The map on the grid's cells.

        Args:
            points: x, y, z in metres in `ego`, intensity 0 to 255, age in seconds; the samples'
                one after the other.
            offsets: Where each sample's begin.

        Raises:
            ValueError: If the points have other columns, or are no floats.
        """
        if points.ndim != 2 or points.shape[1] != 5 or not points.is_floating_point():
            raise ValueError(
                f"Points must be floats [P, 5] (x, y, z, intensity, age), got {points.dtype} "
                f"{list(points.shape)}."
            )
        output: Tensor = self.bev_encoder(self.pillar_encoder(points, offsets))
        return output

    def forward_batch(self, batch: Batch) -> Float[Tensor, "B Cout X Y"]:
        """The map of each sample of a batch."""
        output: Tensor = self(batch.points, batch.point_offsets)
        return output
