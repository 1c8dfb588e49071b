"""What a driver hands over: where the ego is to be in the next seconds."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lss_core.geometry import FloatArray
from lss_core.grid import BevGrid

Log = NDArray[np.floating[Any]]


@dataclass(frozen=True)
class CostMap:
    """What a planner thinks of the ground around it; pictures show it.

    Attributes:
        cost: [X, Y] cells in `ego` at the time of planning; of a cost for each time their mean.
        grid: Where they lie.
    """

    cost: NDArray[np.floating[Any]]
    grid: BevGrid


@dataclass(frozen=True)
class Plan:
    """A path in time, and what its driver wants shown of how it came about.

    Attributes:
        points_m: [T, 2] in `ego` at the time of planning; the start, the origin, is none of them.
        dt_s: Time of the first point, and between points.
        template_idx: Which template it is, if it is one.
        log_prob: [K] of all templates, in nats, as the driver weighed them in the end; -inf where
            the route masks one.
        is_gate_void: Whether no template stayed on the route, so that the gate masked none.
        templates_m: [K, T, 2] what `log_prob` is over.
        cost_map: What the templates were weighed by, if by that.

    Raises:
        ValueError: If the points are no finite [T, 2] with T of 1 at least.
    """

    points_m: FloatArray
    dt_s: float = 0.25
    template_idx: int | None = None
    log_prob: Log | None = None
    is_gate_void: bool = False
    templates_m: FloatArray | None = None
    cost_map: CostMap | None = None

    def __post_init__(self) -> None:
        shape = self.points_m.shape
        if len(shape) != 2 or shape[0] < 1 or shape[1] != 2 or not np.isfinite(self.points_m).all():
            raise ValueError(f"A plan needs finite points [T, 2], got {shape}.")
