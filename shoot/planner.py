"""The planner: cost read along each template, a Boltzmann distribution over them, and its loss."""

from dataclasses import dataclass, replace
from typing import Literal

import torch
import torch.nn.functional as F
from jaxtyping import Float, Int
from torch import Tensor, nn

from lss_core.bounds import check_settings
from lss_core.grid import BevGrid, CellWindow

Interpolation = Literal["bilinear", "nearest"]
OffGrid = Literal["learned", "border", "zero"]


@dataclass(frozen=True)
class PlannerConfig:
    """How the cost map is read.

    Attributes:
        interpolation: `bilinear` between cell centres, or the `nearest` cell.
        off_grid: What a waypoint outside the map costs: a `learned` scalar, what the `border` cell
            next to it costs, or `zero`.
        learn_temperature: Divide the scores by a learned temperature (not in the paper).
    """

    interpolation: Interpolation = "bilinear"
    off_grid: OffGrid = "learned"
    learn_temperature: bool = False

    def __post_init__(self) -> None:
        check_settings(self)


@dataclass(frozen=True)
class TemplateReads:
    """Which cells each template reads, as a sparse K x (X Y) matrix: templates do not move.

    Attributes:
        cell_idx: [K, R] flat cells.
        weight: [K, R] share of each; 0 where a read is void.
        num_outside: [K] waypoints outside the map that no cell answers for.
    """

    cell_idx: Int[Tensor, "K R"]
    weight: Float[Tensor, "K R"]
    num_outside: Float[Tensor, "K"]

    def window(self, grid: BevGrid) -> CellWindow:
        """The least rectangle of the grid's cells that holds all reads."""
        cells = self.cell_idx[self.weight > 0.0]
        if not len(cells):
            return CellWindow(0, 1, 0, 1)
        rows, columns = cells // grid.num_y, cells % grid.num_y
        return CellWindow(
            int(rows.min()), int(rows.max()) + 1, int(columns.min()), int(columns.max()) + 1
        )

    def within(self, window: CellWindow, grid: BevGrid) -> "TemplateReads":
        """The same reads of a map that has only the cells of a window around them all."""
        rows = self.cell_idx // grid.num_y - window.x_start
        columns = self.cell_idx % grid.num_y - window.y_start
        moved = rows * window.shape[1] + columns
        return replace(self, cell_idx=torch.where(self.weight > 0.0, moved, 0))


def share_on_grid(templates: Float[Tensor, "K T 2"], grid: BevGrid) -> float:
    """Share of all waypoints (metres in `ego`) that lie on the grid, 0 to 1."""
    return float(grid.cells(templates.double())[1].double().mean())


def prepare_reads(
    templates: Float[Tensor, "K T 2"],
    grid: BevGrid,
    interpolation: Interpolation = "bilinear",
    off_grid: OffGrid = "learned",
) -> TemplateReads:
    """Work out once which cells the templates read.

    A waypoint is inside by the grid's rule (lower edge in, upper out). Inside, within half a cell
    of the border, the bilinear neighbours that would lie outside are the border cells themselves.
    """
    num_x, num_y = grid.shape
    points = templates.double()
    inside = grid.cells(points)[1]
    # A cell's value stands at its centre.
    place = grid.continuous_cells(points) - 0.5
    upper = place.new_tensor([num_x - 1, num_y - 1])
    place = place.clamp(min=torch.zeros_like(upper), max=upper)
    if interpolation == "nearest":
        # Round half up, so that a point on an edge reads the cell that owns the edge.
        corners = (place + 0.5).floor().clamp(max=upper)[..., None, :]
        share = torch.ones_like(corners[..., 0])
    else:
        low = place.floor().clamp(max=(upper - 1).clamp(min=0))
        steps = place.new_tensor([[0, 0], [0, 1], [1, 0], [1, 1]])
        corners = low[..., None, :] + steps
        share = (1.0 - (place[..., None, :] - corners).abs()).clamp(min=0.0).prod(dim=-1)
        corners = corners.clamp(max=upper)
    if off_grid != "border":
        share = share * inside[..., None]
    cells = (corners[..., 0] * num_y + corners[..., 1]).long()
    outside = (~inside).sum(dim=-1).float()
    return TemplateReads(
        cell_idx=cells.flatten(1),
        weight=share.flatten(1).float(),
        num_outside=outside if off_grid == "learned" else torch.zeros_like(outside),
    )


def score_reads(
    cost_map: Float[Tensor, "B X Y"],
    reads: TemplateReads,
    off_grid_cost: Float[Tensor, ""] | float = 0.0,
) -> Float[Tensor, "B K"]:
    """Minus the summed cost of each template's reads; float32 also under mixed precision."""
    with torch.autocast(device_type=cost_map.device.type, enabled=False):
        cells_by_batch = cost_map.float().flatten(1).t().contiguous()
        cost = F.embedding_bag(
            reads.cell_idx, cells_by_batch, mode="sum", per_sample_weights=reads.weight
        )
        return -(cost + (reads.num_outside * off_grid_cost)[:, None]).t()


def score_templates(
    cost_map: Float[Tensor, "B X Y"],
    templates: Float[Tensor, "K T 2"],
    grid: BevGrid,
    interpolation: Interpolation = "bilinear",
    off_grid: OffGrid = "learned",
    off_grid_cost: Float[Tensor, ""] | float = 0.0,
) -> Float[Tensor, "B K"]:
    """Score each template by the cost along it; high is good, a logit.

    The cost map is read at each of the T waypoints, summed over them and negated, so that a softmax
    over K is the Boltzmann distribution over templates.

    Paper: section 3.3, Eq. 2. Deviation: waypoints outside the map, see docs/deviations.md.

    Args:
        cost_map: Dimensionless cost per cell; X runs forward, Y left, in `ego`. The other arguments
            may lie on other devices than it does.
        templates: Waypoints in metres in `ego`, evenly spaced in time.
        grid: Extent and cell size of `cost_map`.
        interpolation: `bilinear` between cell centres or the `nearest` cell.
        off_grid: Rule for waypoints outside the map: they cost `off_grid_cost` (`learned`), what
            the nearest border cell costs (`border`), or nothing (`zero`).
        off_grid_cost: Cost of one waypoint outside under the rule `learned`.

    Returns:
        Unnormalised scores where `cost_map` lies, differentiable in it and in `off_grid_cost`.

    Raises:
        ValueError: If `cost_map` has other cell counts than `grid`, or something is of another
            shape or type or, on the host, not finite.
    """
    _check_cost_map(cost_map, grid)
    _check_templates(templates)
    if cost_map.device.type == "cpu" and not cost_map.isfinite().all():
        raise ValueError("The cost map must be finite, but holds NaN or infinity.")
    reads = prepare_reads(templates.to(cost_map.device), grid, interpolation, off_grid)
    if isinstance(off_grid_cost, Tensor):
        off_grid_cost = off_grid_cost.to(cost_map.device)
    return score_reads(cost_map, reads, off_grid_cost)


def _check_cost_map(cost_map: Tensor, grid: BevGrid) -> None:
    if cost_map.ndim != 3 or not cost_map.is_floating_point():
        raise ValueError(
            f"Cost maps must be floats [B, X, Y], got {cost_map.dtype} {list(cost_map.shape)}."
        )
    if tuple(cost_map.shape[1:]) != grid.shape:
        raise ValueError(
            f"The cost map is {tuple(cost_map.shape[1:])} cells, its grid {grid.shape}."
        )


def _check_templates(templates: Tensor) -> None:
    if templates.ndim != 3 or templates.shape[-1] != 2 or 0 in templates.shape:
        raise ValueError(f"Templates must be [K, T, 2], got {list(templates.shape)}.")
    if templates.device.type == "cpu" and not templates.isfinite().all():
        raise ValueError("Templates must be finite, but hold NaN or infinity.")


class Planner(nn.Module):
    """Scores a fixed set of templates on cost maps; templates are a buffer.

    Paper: section 3.3, Eq. 2.

    Raises:
        ValueError: If the templates are no finite [K, T, 2].
    """

    templates: Tensor
    cell_idx: Tensor
    weight: Tensor
    num_outside: Tensor

    def __init__(
        self,
        templates: Float[Tensor, "K T 2"],
        grid: BevGrid,
        config: PlannerConfig = PlannerConfig(),
    ) -> None:
        super().__init__()
        _check_templates(templates)
        self.grid = grid
        self.config = config
        reads = prepare_reads(templates, grid, config.interpolation, config.off_grid)
        self.register_buffer("templates", templates.float())
        self.register_buffer("cell_idx", reads.cell_idx, persistent=False)
        self.register_buffer("weight", reads.weight, persistent=False)
        self.register_buffer("num_outside", reads.num_outside, persistent=False)
        self.off_grid_cost = nn.Parameter(
            torch.zeros(()), requires_grad=config.off_grid == "learned"
        )
        self.log_temperature = nn.Parameter(torch.zeros(()), requires_grad=config.learn_temperature)

    def forward(self, cost_map: Float[Tensor, "B X Y"]) -> Float[Tensor, "B K"]:
        """Scores (logits) of all templates.

        Raises:
            ValueError: If `cost_map` has other cell counts than the planner's grid.
        """
        _check_cost_map(cost_map, self.grid)
        return self.score(cost_map, self.reads)

    @property
    def reads(self) -> TemplateReads:
        """Which cells of the grid the templates read."""
        return TemplateReads(self.cell_idx, self.weight, self.num_outside)

    def score(self, cost_map: Float[Tensor, "B X Y"], reads: TemplateReads) -> Float[Tensor, "B K"]:
        """Scores of all templates on a map of the cells that `reads` tells of."""
        scores = score_reads(cost_map, reads, self.off_grid_cost)
        return (
            scores * torch.exp(-self.log_temperature) if self.config.learn_temperature else scores
        )

    @staticmethod
    def loss(scores: Float[Tensor, "B K"], template_idx: Int[Tensor, "B"]) -> Float[Tensor, ""]:
        """Cross-entropy of the template nearest to what was driven (paper, section 3.3)."""
        return F.cross_entropy(scores.float(), template_idx)
