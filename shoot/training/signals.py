"""Ending on SIGINT and SIGTERM: the step under way ends, and a checkpoint is written."""

import logging
import os
import signal
from pathlib import Path
from types import FrameType
from typing import Any

import pytorch_lightning as pl
import torch
from pytorch_lightning.callbacks import Callback
from pytorch_lightning.strategies.launchers import _SubprocessScriptLauncher

logger = logging.getLogger(__name__)

_SIGNALS = (signal.SIGINT, signal.SIGTERM)


class EndOnSignal(Callback):
    """The first signal lets the step under way end, with a checkpoint; the second ends at once.

    The process ends with status 128 plus the signal's number, as shells have it. A signal during
    validation lets it end, whose checkpoint follows anyway. With several processes all end at the
    same step, whichever got the signal.

    Args:
        last: The checkpoint to resume from.
        round_steps: Steps after which a checkpoint is written anyway.
        steps: Steps of the run.
    """

    def __init__(self, last: Path, round_steps: int, steps: int) -> None:
        self._last = last
        self._round_steps = round_steps
        self._steps = steps
        self._signal = 0
        self._before: dict[int, Any] = {}
        self._launched: list[Any] = []

    def on_train_start(self, trainer: pl.Trainer, pl_module: pl.LightningModule) -> None:
        """Listen to signals, in place of Lightning."""
        launcher = trainer.strategy.launcher
        self._launched = launcher.procs if isinstance(launcher, _SubprocessScriptLauncher) else []
        self._before = {number: signal.signal(number, self._note) for number in _SIGNALS}

    def teardown(self, trainer: pl.Trainer, pl_module: pl.LightningModule, stage: str) -> None:
        """Leave them to whoever listened before."""
        for number, handler in self._before.items():
            signal.signal(number, handler)
        self._before = {}

    def on_train_batch_end(self, trainer: pl.Trainer, *_: Any) -> None:
        """Write a checkpoint and end, if asked to; at the end of a round it is written anyway."""
        step = trainer.global_step
        if step % self._round_steps and step < self._steps:
            self._end(trainer, with_checkpoint=True)

    def on_train_batch_start(self, trainer: pl.Trainer, *_: Any) -> None:
        """End before a round, if asked to in the validation before it."""
        if trainer.global_step % self._round_steps == 0:
            self._end(trainer, with_checkpoint=False)

    def _end(self, trainer: pl.Trainer, with_checkpoint: bool) -> None:
        number = self._signal
        if trainer.world_size > 1:
            shared = torch.tensor(float(number), device=trainer.strategy.root_device)
            number = round(float(trainer.strategy.reduce(shared, reduce_op="max")))
        if number:
            if with_checkpoint:
                trainer.save_checkpoint(self._last)
            logger.warning("Ended at step %d; --resume goes on there.", trainer.global_step)
            raise SystemExit(128 + number)

    def _note(self, number: int, _: FrameType | None) -> None:
        if self._signal:
            for process in self._launched:
                process.kill()
            os._exit(128 + number)
        self._signal = number
        logger.warning("Ending after this step; another signal ends at once.")
