"""Which cells of which cost map a template reads: worked out once, since templates do not move."""

from dataclasses import dataclass, replace
from typing import Literal

import torch
from jaxtyping import Float, Int
from torch import Tensor

from lss_core.grid import BevGrid, CellWindow

Interpolation = Literal["bilinear", "nearest"]
OffGrid = Literal["learned", "border", "zero"]


@dataclass(frozen=True)
class TemplateReads:
    """Which cells each template reads, as a sparse K x (C X Y) matrix: templates do not move.

    Attributes:
        cell_idx: [K, R] flat cells of all maps, one map after the other.
        weight: [K, R] share of each; 0 where a read is void.
        num_outside: [K] waypoints outside the map that no cell answers for.
    """

    cell_idx: Int[Tensor, "K R"]
    weight: Float[Tensor, "K R"]
    num_outside: Float[Tensor, "K"]

    def window(self, grid: BevGrid) -> CellWindow:
        """The least rectangle of the grid's cells that holds the reads of all maps."""
        cells = self.cell_idx[self.weight > 0.0] % (grid.num_x * grid.num_y)
        if not len(cells):
            return CellWindow(0, 1, 0, 1)
        rows, columns = cells // grid.num_y, cells % grid.num_y
        return CellWindow(
            int(rows.min()), int(rows.max()) + 1, int(columns.min()), int(columns.max()) + 1
        )

    def within(self, window: CellWindow, grid: BevGrid) -> "TemplateReads":
        """The same reads of maps that have only the cells of a window around them all."""
        maps = self.cell_idx // (grid.num_x * grid.num_y)
        rows = self.cell_idx // grid.num_y % grid.num_x - window.x_start
        columns = self.cell_idx % grid.num_y - window.y_start
        moved = (maps * window.shape[0] + rows) * window.shape[1] + columns
        return replace(self, cell_idx=torch.where(self.weight > 0.0, moved, 0))


def share_on_grid(templates: Float[Tensor, "K T 2"], grid: BevGrid) -> float:
    """Share of all waypoints (metres in `ego`) that lie on the grid, 0 to 1."""
    return float(grid.cells(templates.double())[1].double().mean())


def prepare_reads(
    templates: Float[Tensor, "K T 2"],
    grid: BevGrid,
    interpolation: Interpolation = "bilinear",
    off_grid: OffGrid = "learned",
    num_maps: int = 1,
) -> TemplateReads:
    """Work out once which cells the templates read.

    Args:
        templates: Waypoints in metres in `ego`.
        grid: Of the maps.
        interpolation: `bilinear` between cell centres or the `nearest` cell.
        off_grid: Rule for waypoints outside the maps, see `PlannerConfig`.
        num_maps: 1: all waypoints read the same map. T: waypoint t reads map t.
    """
    num_templates, num_steps = templates.shape[:2]
    each = read_waypoints(templates, grid, interpolation, off_grid, num_maps)
    return TemplateReads(
        cell_idx=each.cell_idx.reshape(num_templates, -1),
        weight=each.weight.reshape(num_templates, -1),
        num_outside=each.num_outside.reshape(num_templates, num_steps).sum(dim=-1),
    )


def read_waypoints(
    templates: Float[Tensor, "K T 2"],
    grid: BevGrid,
    interpolation: Interpolation = "bilinear",
    off_grid: OffGrid = "learned",
    num_maps: int = 1,
) -> TemplateReads:
    """The reads of each of the K T waypoints by itself, as if it were a template of one waypoint.

    A waypoint is inside by the grid's rule (lower edge in, upper out). Inside, within half a cell
    of the border, the bilinear neighbours that would lie outside are the border cells themselves.
    Arguments are those of `prepare_reads`.
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
    map_idx = torch.arange(num_maps, device=place.device).expand(templates.shape[1])
    cells = (map_idx[:, None] * num_x + corners[..., 0]) * num_y + corners[..., 1]
    outside = (~inside).flatten().float()
    return TemplateReads(
        cell_idx=cells.long().flatten(0, 1),
        weight=share.float().flatten(0, 1),
        num_outside=outside if off_grid == "learned" else torch.zeros_like(outside),
    )
