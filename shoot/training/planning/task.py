"""Planning as a task of a run: cost maps, templates, and the one nearest to what was driven."""

import logging
from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

import torch
from jaxtyping import Float
from pytorch_lightning.utilities import rank_zero_only
from torch import Tensor, nn
from torchmetrics import Metric

from lss_core.batch import Batch
from lss_core.config import DataConfig
from lss_core.data.drives import KnownScene
from lss_core.errors import DataError
from lss_core.grid import BevGrid
from shoot.metrics.ranks import PlanningMetrics
from shoot.planner import Planner, share_on_grid
from shoot.templates import TemplateSet
from shoot.training.config import RunConfig
from shoot.training.loop import fit
from shoot.training.module import TaskModule
from shoot.training.planning.config import TrainConfig
from shoot.training.planning.data import (
    LabelledSplit,
    PlanBatch,
    PlanningDataset,
    collate_plans,
    load_split,
)
from shoot.training.planning.focal_lengths import FocalLengths
from shoot.training.planning.mark import TEMPLATES_MARK, check_mark
from shoot.training.planning.motion import TrainingMotion
from shoot.training.planning.run_folder import PlanningRun
from shoot.training.task import Best

logger = logging.getLogger(__name__)


class Planning:
    """Ranks templates by the cost along them; see `Task` for what is asked of it.

    The map has one channel, or with a cost volume one for each waypoint of a template.

    Paper: sections 3.3 and 5.6.
    """

    name = "planner"
    best = Best("top10", "max")
    progress = "validation top-10 {val_top10:.1f} %, NLL {val_nll:.3f} nats"

    def __init__(self, config: TrainConfig, templates: TemplateSet) -> None:
        self.templates = templates
        self._file = config.templates
        self._data = config.data
        self._grid, self._reading = config.model.grid, config.planner
        self.out_channels = config.planner.num_maps(templates.points.shape[1])
        self.marks: Mapping[str, str] = {TEMPLATES_MARK: templates.sha256}
        self.fitted_on = templates.scenes

    def load_split(self, data: DataConfig, split: str, with_points: bool = False) -> LabelledSplit:
        """Keyframes with a whole future, labelled with the nearest template."""
        return load_split(data, split, self.templates, with_points=with_points)

    def dataset(
        self, split: LabelledSplit, config: RunConfig, with_points: bool = False
    ) -> PlanningDataset:
        """Their sensors, futures and labels."""
        return PlanningDataset(split, config.data, config.seed, with_points)

    def collate(self, samples: Sequence[PlanBatch]) -> PlanBatch:
        """As one batch."""
        return collate_plans(samples)

    def new_head(self) -> Planner:
        """The templates, and what costs them beside the map."""
        return Planner(torch.tensor(self.templates.points), self._grid, self._reading)

    def outputs(self, head: nn.Module, maps: Float[Tensor, "B C X Y"]) -> Float[Tensor, "B K"]:
        """Scores (logits) of the templates."""
        scores: Tensor = head(maps)
        return scores

    def loss(
        self, head: nn.Module, maps: Float[Tensor, "B C X Y"], batch: PlanBatch
    ) -> Float[Tensor, ""]:
        """Cross-entropy of the template nearest to what was driven, or the max-margin loss."""
        if self._reading.loss == "max_margin":
            assert isinstance(head, Planner)
            return head.margin_loss(maps, batch.future)
        return Planner.loss(self.outputs(head, maps), batch.template_idx)

    def new_metrics(self) -> PlanningMetrics:
        """Top-k accuracies in per cent, NLL in nats."""
        return PlanningMetrics()

    def measure(self, metrics: Metric, outputs: Float[Tensor, "B K"], batch: PlanBatch) -> None:
        """Add where the nearest template is ranked, and how probable it is."""
        metrics.update(outputs.log_softmax(dim=-1), batch.template_idx)

    def save(self, folder: Path) -> None:
        """Write the run's own copy of the templates."""
        self.templates.save(PlanningRun(folder).templates_file)

    def check_folder(self, folder: Path) -> None:
        """Check that its copy, if it has one yet, is of these templates.

        Raises:
            DataError: If not.
        """
        file = PlanningRun(folder).templates_file
        if file.exists() and TemplateSet.load(file).sha256 != self.templates.sha256:
            raise DataError(
                f"'{folder}' was trained with other templates than '{self._file}'; give it its own "
                "ones."
            )

    def check_weights(self, stored: Mapping[str, Any], name: str) -> None:
        """Check that they were trained with these templates.

        Raises:
            DataError: If not.
        """
        check_mark(stored, self.templates, name)

    def save_training(self, folder: Path, split: LabelledSplit) -> None:
        """Write what baselines are fitted to, and which lenses were seen through."""
        TrainingMotion.of(split).save(PlanningRun(folder).motion_file)
        seen = None if self._data.lidar_scans else FocalLengths.of(split, self._data.image)
        if seen is not None:
            seen.save(folder)

    def trained_on(self, folder: Path) -> tuple[KnownScene, ...]:
        """Those of the motion it keeps, by token."""
        with suppress(DataError):
            motion = TrainingMotion.load(PlanningRun(folder).motion_file, self.templates)
            return tuple(KnownScene("", token) for token in motion.scene_token.tolist())
        return ()


class PlanningModule(TaskModule):
    """Sensors to scores of all templates.

    Paper: sections 3.3 and 5.6.
    """

    task: Planning
    planner: Planner

    def __init__(self, config: TrainConfig, templates: TemplateSet) -> None:
        super().__init__(config, Planning(config, templates))

    def cost_maps(self, sensors: Batch) -> Float[Tensor, "B C X Y"]:
        """Cost per cell, of all times or of each waypoint's."""
        return self.model.forward_batch(sensors)


def train(config: TrainConfig) -> Path:
    """Train a planner; returns the run folder. See `loop.fit`.

    Raises:
        DataError: If data, templates or the run folder are not as they should be.
        OSError: If the run folder cannot be written, as where the disk is full.
    """
    templates = TemplateSet.load(config.templates)
    check_grid(templates, config.model.grid)
    return fit(config, Planning(config, templates))


def check_grid(templates: TemplateSet, grid: BevGrid) -> None:
    """Check that templates can be told apart on a grid; warn where most of them leaves it.

    Raises:
        DataError: If no waypoint of any template lies on the grid.
    """
    share = share_on_grid(torch.tensor(templates.points), grid)
    if share == 0.0:
        (x_min_m, y_min_m), (x_max_m, y_max_m) = (
            templates.points.reshape(-1, 2).min(axis=0),
            templates.points.reshape(-1, 2).max(axis=0),
        )
        raise DataError(
            f"No waypoint of the templates lies on the grid: they reach from x = {x_min_m:.1f} to "
            f"{x_max_m:.1f} m and y = {y_min_m:.1f} to {y_max_m:.1f} m, the grid from x = "
            f"{grid.x_min_m:g} to {grid.x_max_m:g} m and y = {grid.y_min_m:g} to "
            f"{grid.y_max_m:g} m; choose another grid (--model.grid.x-min-m and so on)."
        )
    if share < 0.5:
        rank_zero_only(logger.warning)(
            "Only %.0f %% of the templates' waypoints lie on the grid; what the others cost the "
            "map does not say.",
            100.0 * share,
        )
