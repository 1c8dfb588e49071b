"""In mixed precision only the networks round: geometry, splat and score sums stay float32."""

from typing import Any

import numpy as np
import pytest
import torch
from tally import throw
from torch import Tensor
from world_fixture import TinyRun

from lss_core.camera import frustum_points
from lss_core.model import CameraModel
from lss_core.splat_reference import lift_splat_cumsum
from shoot.planner import TemplateReads
from shoot.prediction.run import batches, open_run
from shoot.training.planning.data import load_split


def score_sums(cost_map: Tensor, reads: TemplateReads, off_grid_cost: Tensor) -> Tensor:
    """[B, K] scores in float64: a sum of weighted cells for each template."""
    cells = cost_map.double().flatten(1)[:, reads.cell_idx]
    inside = (cells * reads.weight.double()).sum(dim=-1)
    return -(inside + reads.num_outside.double() * off_grid_cost.double())


def worst(result: Tensor, expected: Tensor) -> float:
    """Greatest error, as a share of the greatest value."""
    return float((result.double() - expected).abs().max() / expected.abs().max())


@pytest.mark.parametrize("with_gradient", [False, True])
def test_a_bfloat16_planner_sums_in_float32(with_gradient: bool, tiny_run: TinyRun) -> None:
    trained = open_run(tiny_run.folder)
    module, model = trained.module.train(with_gradient), trained.module.model
    assert isinstance(model, CameraModel)
    split = load_split(trained.config.data, "val", trained.templates)
    sensors = next(batches(trained, split, np.arange(8))).sensors
    seen: dict[str, Any] = {}
    model.image_encoder.register_forward_hook(lambda _, __, result: seen.update(lift=result))
    model.bev_encoder.register_forward_hook(
        lambda _, given, result: seen.update(pooled=given[0], cost=result[:, 0])
    )
    with (
        throw("bfloat16 forward passes of a planner", "splat and scores as float64 has them"),
        torch.set_grad_enabled(with_gradient),
        torch.autocast("cpu", torch.bfloat16),
    ):
        scores = module(sensors)
        context, depth_prob = (
            part.detach().unflatten(0, sensors.camera_mask.shape) for part in seen["lift"]
        )
        assert context.dtype == torch.bfloat16  # the network did run in it
        points = frustum_points(
            model.image_hw,
            model.config.image_stride,
            model.config.depth.depths_m,
            sensors.pixel_from_camera,
            sensors.ego_from_camera,
            model.first_px,
        )
        assert model.first_px is not None
        assert points.dtype == torch.float32
        assert seen["pooled"].dtype == scores.dtype == torch.float32
    expected = lift_splat_cumsum(context.double(), depth_prob.double(), points, model.config.grid)
    assert worst(seen["pooled"].detach(), expected) < 1e-6
    planner = module.planner
    expected = score_sums(seen["cost"].detach(), planner.reads, planner.off_grid_cost.detach())
    assert worst(scores.detach(), expected) < 1e-6
    # What rounds to bfloat16 anywhere on the way is far off.
    assert worst(scores.detach().bfloat16(), expected) > 1e-4
