"""The bird's-eye-view grid: the only place where metres become cells."""

from dataclasses import dataclass
from typing import Annotated

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from lss_core.bounds import Bounds, SettingError, check_settings

# Far beyond what is of use; without a bound a config from strangers could fill the memory.
_MAX_CELLS = 1 << 24
_Place = Annotated[float, Bounds(-10_000.0, 10_000.0)]


@dataclass(frozen=True)
class CellWindow:
    """A rectangle of cells; the stops are not in it.

    Attributes:
        x_start: First row forward.
        x_stop: Row after the last.
        y_start: First column to the left.
        y_stop: Column after the last.
    """

    x_start: int
    x_stop: int
    y_start: int
    y_stop: int

    @property
    def shape(self) -> tuple[int, int]:
        """(X, Y) cell counts."""
        return self.x_stop - self.x_start, self.y_stop - self.y_start


@dataclass(frozen=True)
class BevGrid:
    """A rectangle of the ego frame's ground plane, cut into square cells.

    Maps on it are `[..., X, Y]`: X runs forward, Y to the left. A cell owns its lower edges and not
    its upper ones, so a point on the rectangle's upper border lies outside.

    Attributes:
        x_min_m: Rear border.
        x_max_m: Front border.
        y_min_m: Right border.
        y_max_m: Left border.
        cell_m: Side of a cell.

    Raises:
        ValueError: If a number is out of bounds or a side not a whole, positive number of cells.

    Paper: section 4.1 (-50 m to 50 m both ways at 0.5 m: 200 x 200).
    """

    x_min_m: _Place = -50.0
    x_max_m: _Place = 50.0
    y_min_m: _Place = -50.0
    y_max_m: _Place = 50.0
    cell_m: Annotated[float, Bounds(0.0, 1000.0, low_is_in=False)] = 0.5

    def __post_init__(self) -> None:
        check_settings(self)
        for axis, low_m, high_m in (
            ("x", self.x_min_m, self.x_max_m),
            ("y", self.y_min_m, self.y_max_m),
        ):
            cells = (high_m - low_m) / self.cell_m
            if cells < 0.5 or abs(cells - round(cells)) > 1e-6:
                raise SettingError(
                    f"Grid side {axis} from {low_m} to {high_m} m must be a whole number of "
                    f"{self.cell_m} m cells, got {cells:g}."
                )
        if self.num_x * self.num_y > _MAX_CELLS:
            raise SettingError(
                f"A grid of {self.num_x} x {self.num_y} cells; at most {_MAX_CELLS:,} are possible."
            )

    @property
    def num_x(self) -> int:
        """Number of cells forward."""
        return round((self.x_max_m - self.x_min_m) / self.cell_m)

    @property
    def num_y(self) -> int:
        """Number of cells to the left."""
        return round((self.y_max_m - self.y_min_m) / self.cell_m)

    @property
    def shape(self) -> tuple[int, int]:
        """(X, Y) cell counts."""
        return self.num_x, self.num_y

    def continuous_cells(self, xy_m: Float[Tensor, "*S 2"]) -> Float[Tensor, "*S 2"]:
        """Place of points in cells: 0 at the lower border, 0.5 at the first cell's centre."""
        lower_m = _pair(xy_m, self.x_min_m, self.y_min_m)
        return (xy_m - lower_m) / self.cell_m

    def cells(self, xy_m: Float[Tensor, "*S 2"]) -> tuple[Int[Tensor, "*S 2"], Bool[Tensor, "*S"]]:
        """Cell of each point and whether the point is inside (lower edge in, upper edge out).

        Args:
            xy_m: Points in `ego`; not finite ones count as outside.

        Returns:
            Integer (x, y) cells, valid only where the mask is True; and the mask.
        """
        place = self.continuous_cells(xy_m)
        upper = _pair(place, float(self.num_x), float(self.num_y))
        inside = ((place >= 0.0) & (place < upper)).all(dim=-1)
        cells = torch.where(inside[..., None], place, torch.zeros_like(place)).floor().long()
        return cells, inside

    def centres(self) -> Float[Tensor, "X Y 2"]:
        """Centre of each cell in metres, in `ego`."""
        x_m = self.x_min_m + (torch.arange(self.num_x, dtype=torch.float64) + 0.5) * self.cell_m
        y_m = self.y_min_m + (torch.arange(self.num_y, dtype=torch.float64) + 0.5) * self.cell_m
        return torch.stack(torch.meshgrid(x_m, y_m, indexing="ij"), dim=-1).float()


def _pair(like: Float[Tensor, "*S 2"], x: float, y: float) -> Float[Tensor, "2"]:
    """Two numbers, made where `like` lies: a copy to a GPU would make the host wait."""
    return torch.cat([like.new_full((1,), x), like.new_full((1,), y)])
