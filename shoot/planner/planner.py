"""The planner: cost read along each template, a Boltzmann distribution over them, and its loss."""

from dataclasses import dataclass
from typing import Annotated, Literal

import torch
import torch.nn.functional as F
from jaxtyping import Float, Int
from torch import Tensor, nn

from lss_core.bounds import Bounds, SettingError, check_settings
from lss_core.grid import BevGrid
from shoot.planner.margin import max_margin_loss
from shoot.planner.reads import Interpolation, OffGrid, TemplateReads, prepare_reads, read_waypoints
from shoot.planner.scores import check_costs, check_templates, score_reads


@dataclass(frozen=True)
class PlannerConfig:
    """How costs are laid out and read, and what training asks of them.

    Attributes:
        interpolation: `bilinear` between cell centres, or the `nearest` cell.
        off_grid: What a waypoint outside the map costs: a `learned` scalar, what the `border` cell
            next to it costs, or `zero`.
        learn_temperature: Divide the scores by a learned temperature (not in the paper).
        cost: One `map` c(x, y) for all times, or a `volume` c(x, y, t): a map for each time that
            templates have a waypoint at (Neural Motion Planner).
        loss: `cross_entropy` of the template nearest to what was driven, or `max_margin`: what was
            driven costs less than every template, by a margin (Neural Motion Planner);
            probabilities are not calibrated then.
        margin_per_m: That margin, in cost for each metre between two waypoints of the same time.
            It is the unit of all costs; the default makes 20 waypoints a metre away 2 nats.
    """

    interpolation: Interpolation = "bilinear"
    off_grid: OffGrid = "learned"
    learn_temperature: bool = False
    cost: Literal["map", "volume"] = "map"
    loss: Literal["cross_entropy", "max_margin"] = "cross_entropy"
    margin_per_m: Annotated[float, Bounds(0.0, 1e6, low_is_in=False)] = 0.1

    def __post_init__(self) -> None:
        check_settings(self)
        if self.learn_temperature and self.loss == "max_margin":
            raise SettingError(
                "learn_temperature is on, but max_margin compares costs, which no temperature "
                "changes; choose the loss cross_entropy."
            )

    def num_maps(self, num_steps: int) -> int:
        """Cost maps of templates with as many waypoints."""
        return num_steps if self.cost == "volume" else 1


class Planner(nn.Module):
    """Scores a fixed set of templates on cost maps; templates are a buffer.

    Paper: section 3.3, Eq. 2.

    Attributes:
        num_maps: Cost maps of a sample: 1, or with a cost volume as many as templates have
            waypoints.

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
        check_templates(templates)
        self.grid = grid
        self.config = config
        self.num_maps = config.num_maps(templates.shape[1])
        reads = prepare_reads(templates, grid, config.interpolation, config.off_grid, self.num_maps)
        self.register_buffer("templates", templates.float())
        self.register_buffer("cell_idx", reads.cell_idx, persistent=False)
        self.register_buffer("weight", reads.weight, persistent=False)
        self.register_buffer("num_outside", reads.num_outside, persistent=False)
        self.off_grid_cost = nn.Parameter(
            torch.zeros(()), requires_grad=config.off_grid == "learned"
        )
        self.log_temperature = nn.Parameter(torch.zeros(()), requires_grad=config.learn_temperature)

    def forward(self, cost_map: Float[Tensor, "B *C X Y"]) -> Float[Tensor, "B K"]:
        """Scores (logits) of all templates.

        Args:
            cost_map: Without C, or with as many as `num_maps`.

        Raises:
            ValueError: If it has other cell counts than the planner's grid, or other maps.
        """
        check_costs(cost_map, self.grid, {self.num_maps})
        return self.score(cost_map, self.reads)

    @property
    def reads(self) -> TemplateReads:
        """Which cells of the grid the templates read."""
        return TemplateReads(self.cell_idx, self.weight, self.num_outside)

    def score(
        self, cost_map: Float[Tensor, "B *C X Y"], reads: TemplateReads
    ) -> Float[Tensor, "B K"]:
        """Scores of all templates on a map of the cells that `reads` tells of."""
        scores = score_reads(cost_map, reads, self.off_grid_cost)
        return (
            scores * torch.exp(-self.log_temperature) if self.config.learn_temperature else scores
        )

    @staticmethod
    def loss(scores: Float[Tensor, "B K"], template_idx: Int[Tensor, "B"]) -> Float[Tensor, ""]:
        """Cross-entropy of the template nearest to what was driven (paper, section 3.3)."""
        return F.cross_entropy(scores.float(), template_idx)

    def margin_loss(
        self, cost_map: Float[Tensor, "B *C X Y"], future: Float[Tensor, "B T 2"]
    ) -> Float[Tensor, ""]:
        """The max-margin loss of all templates against the path really driven.

        That path's own cost is read off the map, as a template's is: it need not be one of them.
        In float32 also under mixed precision.

        Paper: not in it; see `max_margin_loss`.

        Args:
            cost_map: As for `forward`.
            future: Driven waypoints in metres in `ego`, at the times of the templates'.
        """
        num_templates, num_steps = self.templates.shape[:2]
        config = self.config
        reads = read_waypoints(
            torch.cat([self.templates, future]),
            self.grid,
            config.interpolation,
            config.off_grid,
            self.num_maps,
        )
        scores = score_reads(cost_map, reads, self.off_grid_cost)
        scores = scores.reshape(len(scores), -1, num_steps)
        # Each sample's own path on its own map.
        driven_cost = -scores[:, num_templates:].diagonal().t()
        away_m = self.templates - future[:, None]
        return max_margin_loss(
            driven_cost, -scores[:, :num_templates], away_m.norm(dim=-1), config.margin_per_m
        )
