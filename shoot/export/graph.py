"""What is exported of a planner: images and a ready splat index in, probabilities out."""

import torch
from jaxtyping import Float, Int, UInt8
from torch import Tensor, nn

from lss_core.errors import DataError
from lss_core.grid import CellWindow
from lss_core.model import CameraModel
from shoot.training.planning.task import PlanningModule


class PlannerGraph(nn.Module):
    """A trained planner of one sample, in operations that any runtime has.

    Which feature cell lies at which depth in which cell of the grid is worked out before, of the
    calibration (`numpy_index`). Here contexts are gathered, multiplied with their depths'
    probabilities and added up by cell. The decoder runs only around the cells that templates read.

    Attributes:
        window: The cells of the grid that the cost map shows.

    Args:
        module: Trained; its weights are shared, not copied.

    Raises:
        DataError: If it does not see images, or puts them on its map in another way than by depths.
    """

    cell_idx: Tensor
    weight: Tensor
    num_outside: Tensor

    def __init__(self, module: PlanningModule) -> None:
        super().__init__()
        model, planner = module.model, module.planner
        if not isinstance(model, CameraModel):
            sees = (
                "that sees lidar scans"
                if module.config.data.lidar_scans
                else f"whose lift is '{module.config.model.lift}'"
            )
            raise DataError(
                f"A planner {sees} cannot be exported, only one that lifts images by depths."
            )
        self.model = model
        self.planner = planner
        self.grid = planner.grid
        self.window: CellWindow = planner.reads.window(planner.grid)
        reads = planner.reads.within(self.window, planner.grid)
        self.register_buffer("cell_idx", reads.cell_idx, persistent=False)
        self.register_buffer("weight", reads.weight, persistent=False)
        self.register_buffer("num_outside", reads.num_outside, persistent=False)
        self.eval()

    def forward(
        self, images: UInt8[Tensor, "1 N 3 Hi Wi"], splat_index: Int[Tensor, "3 P"]
    ) -> tuple[Float[Tensor, "1 K"], Float[Tensor, "1 C X2 Y2"]]:
        """Probabilities of the templates, and the cost map they were read from.

        Args:
            images: RGB, 0 to 255, one after the other; of a missing camera anything.
            splat_index: For each point the feature cell (counted through cameras, rows, columns),
                its depth, and the grid's cell (X outer) that it lies in; the cell after the last
                one takes points that lie in none.
        """
        context, depth_prob = self.model.image_encoder(
            self.model.network_images(images.flatten(0, 1))
        )
        bev = self._splat(context, depth_prob, splat_index)
        costs: Tensor = self.model.bev_encoder(bev, self.window)
        return self._scores(costs).softmax(dim=-1), costs

    def _splat(
        self,
        context: Float[Tensor, "N C H W"],
        depth_prob: Float[Tensor, "N D H W"],
        splat_index: Int[Tensor, "3 P"],
    ) -> Float[Tensor, "1 C X Y"]:
        pixel_idx, depth_idx, cell_idx = splat_index.unbind()
        num_channels, num_depths = context.shape[1], depth_prob.shape[1]
        rows = context.permute(0, 2, 3, 1).reshape(-1, num_channels)
        weights = depth_prob.permute(0, 2, 3, 1).reshape(-1)
        points = rows.index_select(0, pixel_idx)
        points = points * weights.index_select(0, pixel_idx * num_depths + depth_idx)[:, None]
        # One cell more, for points in none: so that a list can be filled up to a fixed length.
        cells = points.new_zeros(self.grid.num_x * self.grid.num_y + 1, num_channels)
        cells = cells.scatter_add(0, cell_idx[:, None].expand_as(points), points)
        return cells[:-1].view(1, *self.grid.shape, num_channels).permute(0, 3, 1, 2)

    def _scores(self, costs: Float[Tensor, "1 C X2 Y2"]) -> Float[Tensor, "1 K"]:
        read = costs.flatten().index_select(0, self.cell_idx.flatten()).view_as(self.weight)
        cost = (read * self.weight).sum(dim=-1) + self.num_outside * self.planner.off_grid_cost
        scores = -cost[None]
        if self.planner.config.learn_temperature:
            scores = scores * torch.exp(-self.planner.log_temperature)
        return scores
