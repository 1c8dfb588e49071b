"""What both formats are traced with: example inputs, and which of their sizes stay open."""

from typing import Any

import torch
from torch import Tensor
from torch.export import Dim

from shoot.export.graph import PlannerGraph

_MAX_CAMERAS = 64
_MAX_POINTS = 2**31 - 1  # some releases of torch want a bound


def example_inputs(graph: PlannerGraph) -> dict[str, Tensor]:
    """By name, images of two cameras and an index of two points, where the graph lies."""
    device = graph.weight.device
    return {
        "images": torch.zeros(1, 2, 3, *graph.model.image_hw, dtype=torch.uint8, device=device),
        "splat_index": torch.zeros(3, 2, dtype=torch.long, device=device),
    }


def dynamic_shapes() -> dict[str, Any]:
    """By input, the axes whose size stays open: how many cameras and how many points."""
    return {
        "images": {1: Dim("num_cameras", min=1, max=_MAX_CAMERAS)},
        "splat_index": {1: Dim("num_points", max=_MAX_POINTS)},
    }
