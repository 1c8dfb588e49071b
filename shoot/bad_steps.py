"""Steps whose numbers are no numbers: they change nothing, are counted, and end the run if many."""

import logging
from typing import Any

import pytorch_lightning as pl
import torch
from pytorch_lightning.callbacks import Callback
from torch import Tensor
from torch.optim import Optimizer

from lss_core.errors import DataError
from shoot.datamodule import PlanBatch, PlanningData

logger = logging.getLogger(__name__)


class SkipBadSteps(Callback):
    """Leave out steps with a NaN or infinite gradient, as a loss that is none gives, too.

    Weights, the optimiser's moments and batch statistics stay as they were before the step, which
    counts as one of the run's steps all the same. After too many in a row the run ends and names
    the last batch. (In 16-mixed such steps belong to the search for a scale; torch's scaler leaves
    them out, and only the statistics are put back here.)

    Attributes:
        num_skipped: Steps left out so far, over resumptions too.

    Args:
        limit: As many in a row end the run.
        last: Name of the checkpoint to go on from, for the message.
    """

    def __init__(self, limit: int, last: str) -> None:
        self.num_skipped = 0
        self._limit = limit
        self._last = last
        self._in_a_row = 0
        self._statistics: dict[str, Tensor] = {}
        self._batch: PlanBatch | None = None

    def on_train_batch_start(
        self, trainer: pl.Trainer, pl_module: pl.LightningModule, batch: PlanBatch, batch_idx: int
    ) -> None:
        """Keep what a forward pass changes."""
        self._batch = batch
        self._statistics = {
            name: buffer.clone()
            for name, buffer in pl_module.named_buffers()
            if name.rpartition(".")[2] in ("running_mean", "running_var", "num_batches_tracked")
        }

    def on_before_optimizer_step(
        self, trainer: pl.Trainer, pl_module: pl.LightningModule, optimizer: Optimizer
    ) -> None:
        """Look at the gradient, which is the same in all processes of a run.

        Raises:
            DataError: If too many steps in a row had none.
        """
        gradients = [p.grad for p in pl_module.parameters() if p.grad is not None]
        if torch.stack([g.isfinite().all() for g in gradients]).all():
            self._in_a_row = 0
            return
        for name, buffer in pl_module.named_buffers():
            if name in self._statistics:
                buffer.copy_(self._statistics[name])
        if trainer.precision == "16-mixed":
            return
        # Without gradients the optimiser passes parameters over.
        optimizer.zero_grad(set_to_none=True)
        self.num_skipped += 1
        self._in_a_row += 1
        tokens = self._tokens(trainer)
        logger.warning(
            "Step %d left out: its gradient is not finite (samples %s).",
            trainer.global_step,
            tokens,
        )
        if self._in_a_row >= self._limit:
            raise DataError(
                f"{self._in_a_row} steps in a row had no finite gradient, the last with samples "
                f"{tokens}; look at them, or train with a lower --optim.learning-rate, going on "
                f"from '{self._last}' (--resume)."
            )

    def on_train_end(self, trainer: pl.Trainer, pl_module: pl.LightningModule) -> None:
        """Say how many there were."""
        if self.num_skipped:
            logger.warning("%d steps were left out.", self.num_skipped)

    def state_dict(self) -> dict[str, Any]:
        """What a checkpoint keeps."""
        return {"num_skipped": self.num_skipped}

    def load_state_dict(self, state_dict: dict[str, Any]) -> None:
        """Go on counting."""
        self.num_skipped = state_dict["num_skipped"]

    def _tokens(self, trainer: pl.Trainer) -> str:
        data = trainer.datamodule  # type: ignore[attr-defined]
        assert isinstance(data, PlanningData)
        assert self._batch is not None
        tokens = data.train_split.index.sample_token[self._batch.sensors.sample_idx.tolist()]
        return ", ".join(tokens.tolist())
