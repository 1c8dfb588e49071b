"""Training of a network for a task: the loop, and what a run does before and after it."""

import logging
import math
import os
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytorch_lightning as pl
import torch.distributed as dist
from lightning_fabric.utilities.exceptions import MisconfigurationException
from pytorch_lightning.callbacks import LearningRateMonitor, ModelCheckpoint
from pytorch_lightning.strategies import DDPStrategy
from pytorch_lightning.utilities import rank_zero_only

from lss_core.data.usable import LEFT_OUT, save_left_out
from lss_core.errors import DataError
from lss_core.files import sole_writer
from lss_core.legible import legible
from lss_core.progress import on_terminal
from shoot.training.allocation import keep_freed_memory
from shoot.training.bad_steps import SkipBadSteps
from shoot.training.callbacks import (
    EndTogether,
    JointStatistics,
    RoundLines,
    RoundProgress,
    TrainingTime,
    TrueStep,
)
from shoot.training.checkpoint_file import read_checkpoint, write_weights
from shoot.training.config import Precision, RunConfig
from shoot.training.data import TaskData
from shoot.training.device import choose_device
from shoot.training.event_file import EventFile
from shoot.training.metrics_file import MetricsFile
from shoot.training.module import TaskModule
from shoot.training.precision import agreed_precision, fastest_precision
from shoot.training.run_folder import LAST, RunFolder
from shoot.training.run_scenes import RunScenes
from shoot.training.samplers import check_shares
from shoot.training.signals import EndOnSignal
from shoot.training.task import Task
from shoot.training.whole_checkpoints import WholeCheckpoints

logger = logging.getLogger(__name__)

# What PyTorch says of a batch norm that has nothing to take a mean over.
_LONE_VALUE = "Expected more than 1 value per channel"
_TO_GO_ON = ("optimizer_states", "lr_schedulers", "loops", "callbacks", "global_step")


def fit(config: RunConfig, task: Task[Any, Any]) -> Path:
    """Train a network for a task; returns the run folder.

    The loop runs in rounds of `val_every` steps: train, validate, write `checkpoints/last.ckpt`
    and, when the task's best metric is better than before, `checkpoints/best.ckpt`. A killed run
    resumes at the last whole round and ends with the weights it would have had.

    Raises:
        DataError: If data, task or the run folder are not as they should be.
        OSError: If the run folder cannot be written, as where the disk is full.
    """
    keep_freed_memory()
    check_shares(config.optim.batch_size, math.prod(_processes(config)))
    run = RunFolder(Path(config.out))
    # Of several processes of one run the first keeps others out.
    is_first = int(os.environ.get("RANK", os.environ.get("LOCAL_RANK", "0"))) == 0
    with sole_writer(run.folder) if is_first else nullcontext():
        return _fit(config, run, task)


def _fit(config: RunConfig, run: RunFolder, task: Task[Any, Any]) -> Path:
    if config.precision == "auto":
        config = replace(config, precision=_settle_precision(config, run))
    resume_from = run.begin(config, task)
    if resume_from is not None:
        checkpoint = read_checkpoint(resume_from)
        task.check_weights(checkpoint, f"'{resume_from}'")
        # What is not there Lightning passes over in silence.
        lacks = [name for name in _TO_GO_ON if not checkpoint.get(name)]
        if lacks:
            raise DataError(
                f"'{resume_from}' cannot be gone on from, it lacks {', '.join(lacks)}; restore it, "
                "or begin a new run."
            )
    pl.seed_everything(config.seed, workers=True, verbose=False)
    data = TaskData(config, task)
    _keep_scenes(run, data.scenes, task, resume_from is not None)
    rank_zero_only(save_left_out)(run.folder / LEFT_OUT, data.left_out)
    rank_zero_only(task.save_training)(run.folder, data.train_split)
    try:
        module = TaskModule(config, task)
        trainer = make_trainer(config, run, task, resume_from is not None)
    except (ValueError, MisconfigurationException) as error:
        raise DataError(f"These settings make no run: {error}") from error
    logger.info(
        "Training on %d samples (%d left out), validating on %d; %.2f M parameters, %s.",
        len(data.train_split),
        data.train_split.num_left_out,
        len(data.val_split),
        sum(p.numel() for p in module.parameters()) / 1e6,
        config.precision,
    )
    try:
        trainer.fit(module, datamodule=data, ckpt_path=resume_from, weights_only=True)
    except (LookupError, TypeError, ValueError, AttributeError, RuntimeError) as error:
        if _LONE_VALUE in str(error):
            raise DataError(
                f"A batch of {config.optim.batch_size} leaves batch norm a single value; choose a "
                "larger batch, image or grid."
            ) from error
        if resume_from is None or module.is_restored:
            raise
        raise DataError(
            f"'{resume_from}' is no checkpoint of this run ({type(error).__name__}: "
            f"{str(error)[:200]}); restore it, or begin a new run."
        ) from error
    if trainer.is_global_zero:
        write_weights(run.weights_file, module.state_dict(), task.marks)
    return run.folder


def _keep_scenes(run: RunFolder, scenes: RunScenes, task: Task[Any, Any], is_resumed: bool) -> None:
    """Write which scenes a run sees; one that is resumed must see those it has seen.

    Raises:
        DataError: If it does not.
    """
    begun = RunScenes.load(run.scenes_file) if is_resumed else None
    if begun is not None:
        scenes.check_resumes(begun, run.folder)
        return
    if is_resumed:
        logger.warning(
            "'%s' has no %s: what it was validated on cannot be compared, and what it was trained "
            "on by token at best.",
            legible(str(run.folder)),
            run.scenes_file.name,
        )
        trained = task.trained_on(run.folder) or scenes.trained
        scenes.check_resumes(replace(scenes, trained=trained), run.folder)
    rank_zero_only(scenes.save)(run.scenes_file)


def make_trainer(
    config: RunConfig, run: RunFolder, task: Task[Any, Any], resume: bool = False
) -> pl.Trainer:
    """Lightning's loop for a run; `resume` goes on with its record of metrics."""
    if config.precision == "auto":
        raise ValueError("Settle the precision first, as `train` does.")
    device = choose_device(config.accelerator)
    devices, num_nodes = _processes(config)
    many = devices > 1 or num_nodes > 1 or dist.is_torchelastic_launched()
    # Buffers are the same everywhere, or averaged before validation: no need to send them at every
    # forward pass, of which validation may have different numbers.
    strategy = DDPStrategy(broadcast_buffers=False) if many else "auto"
    return pl.Trainer(
        default_root_dir=run.folder,
        accelerator=device.type,
        devices=devices,
        num_nodes=num_nodes,
        strategy=strategy,
        precision=config.precision,
        deterministic=config.deterministic,
        # The kernels that are tried and found the fastest may be others in each run.
        benchmark=device.type == "cuda" and not config.deterministic,
        plugins=[
            WholeCheckpoints(),
            *([JointStatistics()] if many and config.sync_batchnorm else []),
        ],
        max_steps=config.optim.steps,
        max_epochs=-1,  # not counted: after a resumption Lightning is one too many
        num_sanity_val_steps=0,
        use_distributed_sampler=False,
        log_every_n_steps=min(10, config.val_every),
        logger=[
            MetricsFile(run.metrics_file, resume),
            EventFile(run.events),
        ],
        callbacks=[
            TrueStep(),  # before those that log
            ModelCheckpoint(
                run.checkpoints,
                filename="best",
                monitor=f"val_{task.best.metric}",
                mode=task.best.mode,
                enable_version_counter=False,
            ),
            ModelCheckpoint(
                run.checkpoints, filename=Path(LAST).stem, enable_version_counter=False
            ),
            LearningRateMonitor("step"),
            RoundProgress(config.optim.steps, config.val_every)
            if on_terminal()
            else RoundLines(task.progress),
            TrainingTime(run.time_file),
            SkipBadSteps(
                config.optim.clip_norm, config.optim.max_bad_steps, str(run.checkpoints / LAST)
            ),
            EndOnSignal(run.checkpoints / LAST, config.val_every, config.optim.steps),
            EndTogether(),
        ],
        enable_progress_bar=on_terminal(),
        enable_model_summary=False,
    )


def _settle_precision(config: RunConfig, run: RunFolder) -> Precision:
    """What a run was begun with, if it goes on; else what is fastest for its first process."""
    with_torchrun = dist.is_torchelastic_launched()
    started_by_first = int(os.environ.get("LOCAL_RANK", "0")) > 0 and not with_torchrun
    decided = (config.resume or started_by_first) and run.config_file.exists()
    begun_with = run.read_config(type(config)).precision if decided else "auto"
    if begun_with != "auto":
        return begun_with
    device = choose_device(config.accelerator)
    return agreed_precision(device) if with_torchrun else fastest_precision(device)


def _processes(config: RunConfig) -> tuple[int, int]:
    """Processes on this machine, and machines; torchrun has decided both when it started us."""
    if not dist.is_torchelastic_launched():
        return config.devices, config.num_nodes
    local = int(os.environ["LOCAL_WORLD_SIZE"])
    return local, int(os.environ["WORLD_SIZE"]) // local
