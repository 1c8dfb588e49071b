"""Gradients before they are used: clipped; steps without a finite one are left out and counted."""

import logging
from typing import Any

import pytorch_lightning as pl
import torch
from jaxtyping import Float
from pytorch_lightning.callbacks import Callback
from torch import Tensor
from torch.amp.grad_scaler import GradScaler
from torch.optim import Optimizer

from lss_core.errors import DataError
from shoot.training.data import TaskData
from shoot.training.task import TaskBatch

logger = logging.getLogger(__name__)

_STATISTICS = ("running_mean", "running_var", "num_batches_tracked")


def clip_gradients(
    optimizer: Optimizer, clip_norm: float, scaler: GradScaler | None = None
) -> Float[Tensor, ""]:
    """The norm of all gradients together; they are scaled down to `clip_norm` if it is larger.

    It is not finite if one of them is not, nor if the sum of their squares is beyond float32, as
    that of finite gradients past some 1e19 is.

    Args:
        optimizer: Whose parameters.
        clip_norm: Largest norm.
        scaler: Of a loss in float16, if there is one. A fused optimiser divides by its scale within
            its step only, so that is done here, once; its step then does not do it again.
    """
    if scaler is not None:
        scaler.unscale_(optimizer)
    parameters = [p for group in optimizer.param_groups for p in group["params"]]
    return torch.nn.utils.clip_grad_norm_(parameters, clip_norm)


class SkipBadSteps(Callback):
    """Clip gradients, and leave out steps without a finite one, as a loss that is none gives, too.

    Weights, the optimiser's moments and batch statistics stay as they were before the step, which
    counts as one of the run's steps all the same. After too many in a row the run ends and names
    the last batch. (In 16-mixed such steps belong to the search for a scale: they are not counted.)

    The norm that clipping needs says whether all gradients are finite. Asking for it is the one
    time a step waits for the device.

    Attributes:
        num_skipped: Steps left out so far, over resumptions too.

    Args:
        clip_norm: Largest norm of a gradient.
        limit: As many bad steps in a row end the run.
        last: Name of the checkpoint to go on from, for the message.
    """

    def __init__(self, clip_norm: float, limit: int, last: str) -> None:
        self.num_skipped = 0
        self._clip_norm = clip_norm
        self._limit = limit
        self._last = last
        self._in_a_row = 0
        # By type, as copies of many tensors at once must be: the module's own, and as they were.
        self._statistics: list[tuple[list[Tensor], list[Tensor]]] = []
        self._batch: TaskBatch | None = None

    def on_train_start(self, trainer: pl.Trainer, pl_module: pl.LightningModule) -> None:
        """Find what a forward pass changes, and room to keep it."""
        by_type: dict[torch.dtype, list[Tensor]] = {}
        for name, buffer in pl_module.named_buffers():
            if name.rpartition(".")[2] in _STATISTICS:
                by_type.setdefault(buffer.dtype, []).append(buffer)
        self._statistics = [
            (own, [torch.empty_like(buffer) for buffer in own]) for own in by_type.values()
        ]

    def on_train_batch_start(
        self, trainer: pl.Trainer, pl_module: pl.LightningModule, batch: TaskBatch, batch_idx: int
    ) -> None:
        """Keep what a forward pass changes."""
        self._batch = batch
        for own, kept in self._statistics:
            torch._foreach_copy_(kept, own)

    def on_before_optimizer_step(
        self, trainer: pl.Trainer, pl_module: pl.LightningModule, optimizer: Optimizer
    ) -> None:
        """Clip the gradient, which is the same in all processes of a run, and look at its norm.

        Raises:
            DataError: If too many steps in a row had none.
        """
        scaler = getattr(trainer.precision_plugin, "scaler", None)
        norm = clip_gradients(optimizer, self._clip_norm, scaler)
        pl_module.log("grad_norm", norm)
        if norm.isfinite():
            self._in_a_row = 0
            return
        for own, kept in self._statistics:
            torch._foreach_copy_(own, kept)
        # Without gradients the optimiser passes parameters over.
        optimizer.zero_grad(set_to_none=True)
        if scaler is not None:
            return
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
        assert isinstance(data, TaskData)
        assert self._batch is not None
        tokens = data.train_split.index.sample_token[self._batch.sensors.sample_idx.tolist()]
        return ", ".join(tokens.tolist())
