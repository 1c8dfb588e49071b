"""Run a trained planner over samples: checkpoint and data in, probabilities and cost maps out."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray

from lss_core.errors import DataError
from lss_core.progress import progress
from shoot.prediction.disturbance import UNDISTURBED, Disturbance
from shoot.prediction.fast import FastPlanner
from shoot.prediction.opening import load_module, read_batches, to_read_now
from shoot.templates import TemplateSet
from shoot.training.planning.config import TrainConfig
from shoot.training.planning.data import LabelledSplit, PlanBatch
from shoot.training.planning.run_folder import PlanningRun
from shoot.training.planning.task import Planning, PlanningModule


@dataclass(frozen=True)
class TrainedRun:
    """A run ready to predict.

    Attributes:
        config: What it was told, with the data it is to read now.
        templates: What it chooses from.
        module: In evaluation mode.
        folder: Where it is.
        disturbance: What is done to its cameras before it sees them.
    """

    config: TrainConfig
    templates: TemplateSet
    module: PlanningModule
    folder: PlanningRun
    disturbance: Disturbance = UNDISTURBED

    @property
    def task(self) -> Planning:
        """What it was trained for."""
        return self.module.task

    @property
    def device(self) -> torch.device:
        """Where the module is."""
        return self.module.device


def open_run(
    folder: str | Path,
    checkpoint: str = "last",
    root: str | None = None,
    version: str | None = None,
    templates: str | None = None,
    skip_bad: bool = False,
    cameras: tuple[str, ...] | None = None,
) -> TrainedRun:
    """Load a run's config, templates and weights.

    Args:
        folder: Run folder.
        checkpoint: `last`, or `best` by validation top-10.
        root: Data root, if not the one it was trained on.
        version: Version, if not the one it was trained on.
        templates: Template file, if not the run's own copy; must be the same templates.
        skip_bad: Leave out samples that cannot be used, also if the run did not.
        cameras: Channels, if not those it was trained on; of any number.

    Raises:
        DataError: If something is missing or does not fit together.
    """
    run = PlanningRun(Path(folder))
    config = to_read_now(run.config(), root, version, skip_bad, cameras)
    template_set = TemplateSet.load(templates) if templates else run.templates()
    module = load_module(run, checkpoint, lambda: PlanningModule(config, template_set))
    return TrainedRun(config, template_set, module, run)


def batches(
    run: TrainedRun, split: LabelledSplit, positions: NDArray[np.int64]
) -> Iterator[PlanBatch]:
    """Batches of the samples at the given positions, in order, without augmentation."""
    return read_batches(run.task, run.config, split, positions, run.device, run.disturbance)


@torch.no_grad()
def predict(run: TrainedRun, split: LabelledSplit, fast: bool = False) -> NDArray[np.float32]:
    """[S, K] log-probabilities of the templates for every sample of a split.

    Args:
        run: Trained planner.
        split: What to predict.
        fast: By `FastPlanner`.

    Raises:
        DataError: If they are not finite, or an image is missing or damaged.
    """
    positions = np.arange(len(split.labels))
    planner = FastPlanner(run.module) if fast else run.module
    parts = []
    with progress("Predicting samples", len(positions)) as advance:
        for batch in batches(run, split, positions):
            parts.append(planner(batch.sensors).log_softmax(dim=-1).float().cpu().numpy())
            advance(len(batch.template_idx))
    return check_scores(np.concatenate(parts))


def check_scores(log_prob: NDArray[np.float32]) -> NDArray[np.float32]:
    """The same log-probabilities, if they are any.

    Raises:
        DataError: If they are not finite.
    """
    if not np.isfinite(log_prob).all():
        raise DataError(
            "The planner gives no finite scores: its training has diverged; train it with a lower "
            "--optim.learning-rate."
        )
    return log_prob
