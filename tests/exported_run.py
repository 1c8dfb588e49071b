"""The tiny run as it is exported: scores that differ, the graph, its card, samples to try it on."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import torch
from world_fixture import TinyRun

from lss_core.batch import Batch
from shoot.export.card import make_card
from shoot.export.graph import PlannerGraph
from shoot.prediction.run import TrainedRun, batches, open_run


@dataclass(frozen=True)
class Exported:
    """A planner to export, and what PyTorch says of some samples.

    Attributes:
        run: Opened.
        graph: Of its module.
        card: Of both.
        sensors: Three samples of the validation scenes.
    """

    run: TrainedRun
    graph: PlannerGraph
    card: dict[str, Any]
    sensors: Batch

    def without(self, *cameras: int) -> Batch:
        """The samples without some of their cameras; noise stands where their images were."""
        mask, images = self.sensors.camera_mask.clone(), self.sensors.images.clone()
        random = torch.Generator().manual_seed(0)
        for camera in cameras:
            mask[:, camera] = False
            shape = images[:, camera].shape
            images[:, camera] = torch.randint(0, 256, shape, dtype=torch.uint8, generator=random)
        return replace(self.sensors, images=images, camera_mask=mask)

    @torch.no_grad()
    def expected(self, sensors: Batch) -> np.ndarray:
        """[B, K] probabilities by the trained module itself."""
        prob: np.ndarray = self.run.module(sensors).softmax(dim=-1).numpy()
        return prob


def export_tiny(tiny_run: TinyRun) -> Exported:
    """The tiny run, ready to be written."""
    run = open_run(tiny_run.folder)
    run.module.cpu()
    with torch.no_grad():
        run.module.model.bev_encoder.head.weight *= 100.0  # a few steps leave scores almost equal
    graph = PlannerGraph(run.module)
    split = run.task.load_split(run.config.data, "val")
    sensors = next(iter(batches(run, split, np.arange(3)))).sensors
    return Exported(run, graph, make_card(run, graph), sensors)
