"""What training adds to Lightning's loop: progress, time, true steps, several processes as one."""

import json
import logging
import subprocess
import time
from pathlib import Path
from typing import Any

import pytorch_lightning as pl
from pytorch_lightning.callbacks import Callback, RichProgressBar
from pytorch_lightning.plugins import LayerSync
from pytorch_lightning.strategies.launchers import _SubprocessScriptLauncher
from pytorch_lightning.utilities import rank_zero_only
from torch import nn

from lss_core.errors import DataError
from lss_core.files import write_atomically
from lss_core.progress import SAY_EVERY_S
from lss_core.sync_batchnorm import share_statistics

logger = logging.getLogger(__name__)

_SAID = 2  # exit status of a process that has said what is wrong


class RoundProgress(RichProgressBar):
    """Which round, its steps, and the loss.

    Args:
        steps: Steps of the run.
        round_steps: Steps of a round.
    """

    def __init__(self, steps: int, round_steps: int) -> None:
        super().__init__(refresh_rate=5)
        self.num_rounds = -(-steps // round_steps)
        self.round_steps = round_steps

    def _get_train_description(self, current_epoch: int) -> str:
        return f"Round {self.trainer.global_step // self.round_steps + 1} of {self.num_rounds}"

    def get_metrics(
        self, trainer: pl.Trainer, pl_module: pl.LightningModule
    ) -> dict[str, int | str | float | dict[str, float]]:
        """All but Lightning's number of the run."""
        items = super().get_metrics(trainer, pl_module)
        items.pop("v_num", None)
        return items


class RoundLines(Callback):
    """The same as lines of a log: the loss now and then, and what each validation has found.

    Args:
        of_validation: What to say of one, with the names of metrics in braces.
    """

    def __init__(self, of_validation: str) -> None:
        self._of_validation = of_validation
        self._said_s = time.monotonic()

    @rank_zero_only
    def on_train_batch_end(self, trainer: pl.Trainer, *_: Any) -> None:
        """Say the loss if nothing was said for a while."""
        if time.monotonic() - self._said_s >= SAY_EVERY_S:
            self._say(trainer, "loss {train_loss:.3f}")

    @rank_zero_only
    def on_validation_end(self, trainer: pl.Trainer, pl_module: pl.LightningModule) -> None:
        """Say how well it does."""
        self._say(trainer, self._of_validation)

    def _say(self, trainer: pl.Trainer, text: str) -> None:
        found = text.format_map(trainer.callback_metrics)
        logger.info("Step %d of %d: %s", trainer.global_step, trainer.max_steps, found)
        self._said_s = time.monotonic()


class TrueStep(Callback):
    """Logs under the step of the run; after a resumption Lightning counts one too many."""

    def on_train_batch_start(
        self, trainer: pl.Trainer, pl_module: pl.LightningModule, batch: object, batch_idx: int
    ) -> None:
        """Set the number that loggers are given."""
        trainer.fit_loop.epoch_loop._batches_that_stepped = trainer.global_step


class TrainingTime(Callback):
    """How long the run's rounds have taken, validation included, over all its resumptions.

    Args:
        file: Written at the end of the run: a JSON object with `train_s`.
    """

    def __init__(self, file: Path) -> None:
        self._file = file
        self._before_s = 0.0
        self._started_s: float | None = None

    def on_train_start(self, trainer: pl.Trainer, pl_module: pl.LightningModule) -> None:
        """Start the clock."""
        self._started_s = time.monotonic()

    def state_dict(self) -> dict[str, float]:
        """What a checkpoint keeps: lost work is not counted."""
        since_s = 0.0 if self._started_s is None else time.monotonic() - self._started_s
        return {"train_s": self._before_s + since_s}

    def load_state_dict(self, state_dict: dict[str, float]) -> None:
        """Go on from a checkpoint's time."""
        self._before_s = state_dict["train_s"]

    @rank_zero_only
    def on_fit_end(self, trainer: pl.Trainer, pl_module: pl.LightningModule) -> None:
        """Write it down; if a kill came between the last checkpoint and this, on resuming."""
        if self._started_s is None and self._file.exists():
            return
        with write_atomically(self._file) as stream:
            stream.write((json.dumps(self.state_dict()) + "\n").encode())


class JointStatistics(LayerSync):
    """Batch norms that see the samples of all processes, on CPUs as well as on GPUs."""

    def apply(self, model: nn.Module) -> nn.Module:
        """Convert them; Lightning asks for it only where there are several processes."""
        assert isinstance(model, pl.LightningModule)
        return share_statistics(model, model.trainer.strategy.root_device)

    def revert(self, model: nn.Module) -> nn.Module:
        """Leave them: without other processes they are what they were."""
        return model


class EndTogether(Callback):
    """When one of several processes cannot go on, it says why, and the others end in silence.

    Lightning leaves them waiting for each other, or each with a traceback of a broken connection.
    """

    def on_exception(
        self, trainer: pl.Trainer, pl_module: pl.LightningModule, exception: BaseException
    ) -> None:
        """End the processes this one has started, or find that one of them has ended the run."""
        if isinstance(exception, KeyboardInterrupt):
            logger.warning("Interrupted; --resume goes on after the last validation.")
        launcher = trainer.strategy.launcher
        started = launcher.procs if isinstance(launcher, _SubprocessScriptLauncher) else []
        if isinstance(exception, (DataError, OSError)):
            for process in started:
                process.kill()
        elif any(_ended_with(process) == _SAID for process in started):
            raise SystemExit(_SAID) from exception


def _ended_with(process: "subprocess.Popen[bytes]") -> int | None:
    """Exit status; a process that has lost its connections needs a moment to end."""
    try:
        return process.wait(timeout=3.0)
    except subprocess.TimeoutExpired:
        return None
