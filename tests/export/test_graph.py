"""The graph to export says what the planner says, whatever the planner is told."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from exported_run import Exported

from lss_core.errors import DataError
from shoot.export.card import make_card
from shoot.export.graph import PlannerGraph
from shoot.export.samples import inputs_of
from shoot.planner import PlannerConfig
from shoot.training.planning.task import PlanningModule


@pytest.mark.parametrize(
    ("planner", "lift"),
    [
        (PlannerConfig(), "depth"),
        (PlannerConfig(cost="volume", off_grid="border"), "depth"),
        (PlannerConfig(learn_temperature=True, interpolation="nearest"), "uniform"),
    ],
)
def test_probabilities_and_costs_are_the_planners(
    exported: Exported, planner: PlannerConfig, lift: str
) -> None:
    torch.manual_seed(0)
    config = exported.run.config
    config = replace(config, planner=planner, model=replace(config.model, lift=lift))
    module = PlanningModule(config, exported.run.templates).eval()
    with torch.no_grad():
        module.model.bev_encoder.head.weight *= 3000.0
        module.planner.off_grid_cost.fill_(0.3)
        module.planner.log_temperature.fill_(0.4)
        expected = module(exported.sensors).softmax(dim=-1)
        costs = module.cost_maps(exported.sensors)
    assert expected.std() > 0.005
    graph = PlannerGraph(module)
    window, card = graph.window, make_card(replace(exported.run, config=config), graph)
    for b in range(3):
        inputs = {n: torch.tensor(v) for n, v in inputs_of(card, exported.sensors, b).items()}
        with torch.no_grad():
            prob, cost_map = graph(**inputs)
        torch.testing.assert_close(prob[0], expected[b], rtol=1e-4, atol=1e-5)
        seen = costs[b, :, window.x_start : window.x_stop, window.y_start : window.y_stop]
        torch.testing.assert_close(cost_map[0], seen, rtol=1e-3, atol=1e-3)


@pytest.mark.parametrize("lift", ["cnn", "oft"])
def test_other_lifts_are_refused(exported: Exported, lift: str) -> None:
    config = exported.run.config
    config = replace(config, model=replace(config.model, lift=lift))
    with pytest.raises(DataError, match=f"whose lift is '{lift}' cannot be exported"):
        PlannerGraph(PlanningModule(config, exported.run.templates))


def test_lidar_planners_are_refused(exported: Exported) -> None:
    config = exported.run.config
    config = replace(config, data=replace(config.data, lidar_scans=1))
    with pytest.raises(DataError, match="sees lidar scans cannot be exported"):
        PlannerGraph(PlanningModule(config, exported.run.templates))


def test_the_card_says_which_cells_the_cost_map_shows(exported: Exported) -> None:
    told, grid = exported.card["cost_map"], exported.graph.grid
    points = exported.run.templates.points
    inside = points[np.abs(points).max(axis=-1) < 20.0]
    assert len(inside)
    low_m = np.array([told["x_min_m"], told["y_min_m"]])
    high_m = low_m + grid.cell_m * np.array([told["num_x"], told["num_y"]])
    on_grid = (inside >= [grid.x_min_m, grid.y_min_m]).all(-1) & (
        inside < [grid.x_max_m, grid.y_max_m]
    ).all(-1)
    assert ((inside >= low_m) & (inside < high_m))[on_grid].all()
