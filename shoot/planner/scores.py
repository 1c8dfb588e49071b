"""The score of a template: minus the cost along it."""

from collections.abc import Collection

import torch
import torch.nn.functional as F
from jaxtyping import Float
from torch import Tensor

from lss_core.grid import BevGrid
from shoot.planner.reads import Interpolation, OffGrid, TemplateReads, prepare_reads


def score_reads(
    cost_map: Float[Tensor, "B *C X Y"],
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
    cost_map: Float[Tensor, "B *C X Y"],
    templates: Float[Tensor, "K T 2"],
    grid: BevGrid,
    interpolation: Interpolation = "bilinear",
    off_grid: OffGrid = "learned",
    off_grid_cost: Float[Tensor, ""] | float = 0.0,
) -> Float[Tensor, "B K"]:
    """Score each template by the cost along it; high is good, a logit.

    The cost map is read at each of the T waypoints, summed over them and negated, so that a softmax
    over K is the Boltzmann distribution over templates.

    Paper: section 3.3, Eq. 2; of T maps, the cost volume of the planner that it cites (Neural
    Motion Planner). Deviation: waypoints outside the map, see docs/deviations.md.

    Args:
        cost_map: Dimensionless cost per cell, one map for all waypoints, or T of them, the first
            for the first waypoint; X runs forward, Y left, in `ego`. The other arguments may lie on
            other devices than it does.
        templates: Waypoints in metres in `ego`, evenly spaced in time.
        grid: Extent and cell size of `cost_map`.
        interpolation: `bilinear` between cell centres or the `nearest` cell.
        off_grid: Rule for waypoints outside the map: they cost `off_grid_cost` (`learned`), what
            the nearest border cell costs (`border`), or nothing (`zero`).
        off_grid_cost: Cost of one waypoint outside under the rule `learned`.

    Returns:
        Unnormalised scores where `cost_map` lies, differentiable in it and in `off_grid_cost`.

    Raises:
        ValueError: If `cost_map` has other cell counts than `grid` or as many maps as there is no
            use for, or something is of another shape or type or, on the host, not finite.
    """
    check_templates(templates)
    num_maps = check_costs(cost_map, grid, {1, templates.shape[1]})
    if cost_map.device.type == "cpu" and not cost_map.isfinite().all():
        raise ValueError("The cost map must be finite, but holds NaN or infinity.")
    reads = prepare_reads(templates.to(cost_map.device), grid, interpolation, off_grid, num_maps)
    if isinstance(off_grid_cost, Tensor):
        off_grid_cost = off_grid_cost.to(cost_map.device)
    return score_reads(cost_map, reads, off_grid_cost)


def check_costs(cost_map: Tensor, grid: BevGrid, wanted: Collection[int]) -> int:
    """How many maps there are for each sample: as many as wanted, with the cells of a grid.

    Raises:
        ValueError: If they are not.
    """
    if cost_map.ndim not in (3, 4) or not cost_map.is_floating_point():
        raise ValueError(
            f"Cost maps must be floats [B, X, Y] or [B, C, X, Y], got {cost_map.dtype} "
            f"{list(cost_map.shape)}."
        )
    if tuple(cost_map.shape[-2:]) != grid.shape:
        raise ValueError(
            f"The cost map is {tuple(cost_map.shape[-2:])} cells, its grid {grid.shape}."
        )
    num_maps = cost_map.shape[1] if cost_map.ndim == 4 else 1
    if num_maps not in wanted:
        raise ValueError(
            f"There must be {' or '.join(map(str, sorted(wanted)))} cost map(s) for each sample: "
            f"one for all waypoints, or one for each of a template; got {num_maps}."
        )
    return num_maps


def check_templates(templates: Tensor) -> None:
    """Check shape and values.

    Raises:
        ValueError: If they are no finite [K, T, 2].
    """
    if templates.ndim != 3 or templates.shape[-1] != 2 or 0 in templates.shape:
        raise ValueError(f"Templates must be [K, T, 2], got {list(templates.shape)}.")
    if templates.device.type == "cpu" and not templates.isfinite().all():
        raise ValueError("Templates must be finite, but hold NaN or infinity.")
