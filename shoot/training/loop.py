"""Training: a thin Lightning module and the loop's settings around model, planner and metrics."""

import logging
import math
import os
from contextlib import nullcontext, suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytorch_lightning as pl
import torch
import torch.distributed as dist
from lightning_fabric.utilities.exceptions import MisconfigurationException
from pytorch_lightning.callbacks import LearningRateMonitor, ModelCheckpoint
from pytorch_lightning.strategies import DDPStrategy
from pytorch_lightning.utilities import rank_zero_only
from torch import Tensor

from lss_core.batch import Batch
from lss_core.data.drives import KnownScene
from lss_core.data.usable import LEFT_OUT, save_left_out
from lss_core.depth_targets import batch_depth_bins, depth_loss
from lss_core.errors import DataError
from lss_core.files import sole_writer
from lss_core.grid import BevGrid
from lss_core.legible import legible
from lss_core.model import CameraModel, make_model
from lss_core.progress import on_terminal
from shoot.metrics.ranks import PlanningMetrics
from shoot.planner import Planner, share_on_grid
from shoot.templates import TemplateSet
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
from shoot.training.checkpoint_file import WholeCheckpoints, read_checkpoint, write_weights
from shoot.training.config import OptimConfig, Precision, TrainConfig
from shoot.training.data import PlanBatch, PlanningData, check_shares
from shoot.training.device import choose_device
from shoot.training.event_file import EventFile
from shoot.training.metrics_file import MetricsFile
from shoot.training.motion import TrainingMotion
from shoot.training.precision import agreed_precision, fastest_precision
from shoot.training.run_folder import LAST, RunFolder
from shoot.training.run_scenes import RunScenes
from shoot.training.signals import EndOnSignal

logger = logging.getLogger(__name__)

# What PyTorch says of a batch norm that has nothing to take a mean over.
_LONE_VALUE = "Expected more than 1 value per channel"
_TO_GO_ON = ("optimizer_states", "lr_schedulers", "loops", "callbacks", "global_step")


class PlanningModule(pl.LightningModule):
    """Sensors to scores of all templates, and the loss that trains it.

    Attributes:
        is_restored: Whether training has begun: what a checkpoint holds is in place.

    Paper: sections 3.3 and 5.6.
    """

    def __init__(self, config: TrainConfig, templates: TemplateSet) -> None:
        super().__init__()
        self.is_restored = False
        self.config = config
        self.templates_sha256 = templates.sha256
        self.model = make_model(config.model, config.data)
        self.planner = Planner(torch.tensor(templates.points), config.model.grid, config.planner)
        self.val_metrics = PlanningMetrics()

    def forward(self, sensors: Batch) -> Tensor:
        """[B, K] scores (logits) of the templates."""
        scores: Tensor = self.planner(self.cost_map(sensors))
        return scores

    def cost_map(self, sensors: Batch) -> Tensor:
        """[B, X, Y] cost per cell."""
        return self.model.forward_batch(sensors)[:, 0]

    def on_train_start(self) -> None:
        """Look at what Lightning does not: a checkpoint's moments must be those of the weights.

        Raises:
            ValueError: If they are not.
        """
        for optimizer in self.trainer.optimizers:
            for parameter, state in optimizer.state.items():
                moments = [value for value in state.values() if torch.is_tensor(value)]
                if any(value.ndim and value.shape != parameter.shape for value in moments):
                    raise ValueError("the optimiser's moments have other shapes than the weights")
        self.is_restored = True

    def training_step(self, batch: PlanBatch, batch_idx: int) -> Tensor:
        """Cross-entropy of the template nearest to what was driven, and of depths if asked for."""
        size = len(batch.template_idx)
        weight = self.config.optim.depth_weight
        if weight > 0.0 and isinstance(self.model, CameraModel):
            output, depth_prob = self.model.forward_with_depth(batch.sensors)
            loss = self.planner.loss(self.planner(output[:, 0]), batch.template_idx)
            config = self.model.config
            bins = batch_depth_bins(
                batch.sensors, self.model.image_hw, config.image_stride, config.depth.depths_m
            )
            of_depth = depth_loss(depth_prob, bins)
            self.log("depth_loss", of_depth, batch_size=size, sync_dist=True)
        else:
            loss = self.planner.loss(self(batch.sensors), batch.template_idx)
            of_depth = torch.zeros_like(loss)
        self.log("train_loss", loss, prog_bar=True, batch_size=size, sync_dist=True)
        return loss + weight * of_depth

    def on_train_batch_end(self, *_: Any) -> None:
        """End the last round early if it has fewer steps than the others: it is validated too."""
        if self.trainer.global_step >= self.config.optim.steps:
            self.trainer.should_stop = True

    def validation_step(self, batch: PlanBatch, batch_idx: int) -> None:
        """Add a batch to the running metrics."""
        log_prob = self(batch.sensors).log_softmax(dim=-1)
        self.val_metrics.update(log_prob, batch.template_idx)

    def on_validation_start(self) -> None:
        """Give all processes the same batch statistics before they are used."""
        if dist.is_initialized() and not self.config.sync_batchnorm:
            for buffer in self.model.buffers():
                if buffer.is_floating_point():
                    dist.all_reduce(buffer)
                    buffer /= dist.get_world_size()

    def on_validation_epoch_end(self) -> None:
        """Log top-k accuracies (per cent) and NLL over all processes."""
        # Already reduced over processes by the metric.
        self.log_dict({f"val_{name}": v for name, v in self.val_metrics.compute().items()})
        self.val_metrics.reset()

    def configure_optimizers(self) -> Any:
        """Adam and the schedule, by step."""
        optim = self.config.optim
        optimizer = torch.optim.Adam(
            self.parameters(),
            lr=optim.learning_rate,
            weight_decay=optim.weight_decay,
            fused=True,
        )
        schedule = torch.optim.lr_scheduler.LambdaLR(optimizer, lambda step: rate_at(optim, step))
        return {
            "optimizer": optimizer,
            "lr_scheduler": {"scheduler": schedule, "interval": "step"},
        }

    def on_save_checkpoint(self, checkpoint: dict[str, Any]) -> None:
        """Say which templates these weights belong to."""
        checkpoint["templates_sha256"] = self.templates_sha256

    def on_load_checkpoint(self, checkpoint: dict[str, Any]) -> None:
        """Refuse weights that belong to other templates.

        Raises:
            DataError: If they do.
        """
        check_templates(checkpoint, self.templates_sha256, "the checkpoint")


def rate_at(optim: OptimConfig, step: int) -> float:
    """Learning rate at a step, as a share of the peak: linear warm-up, then constant or cosine."""
    if step < optim.warmup_steps:
        return (step + 1) / optim.warmup_steps
    if optim.schedule == "constant":
        return 1.0
    done = (step - optim.warmup_steps) / max(1, optim.steps - optim.warmup_steps)
    return 0.5 * (1.0 + math.cos(math.pi * min(1.0, done)))


def check_templates(checkpoint: dict[str, Any], sha256: str, name: str) -> None:
    """Check that a checkpoint was trained with these templates.

    Raises:
        DataError: If not.
    """
    trained_with = checkpoint.get("templates_sha256")
    if trained_with != sha256:
        raise DataError(
            f"{name} was trained with other templates (sha256 {str(trained_with)[:12]}..., these "
            f"are {sha256[:12]}...); give it its own template file."
        )


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


def train(config: TrainConfig) -> Path:
    """Train a planner; returns the run folder.

    The loop runs in rounds of `val_every` steps: train, validate, write `checkpoints/last.ckpt`
    and, when top-10 is better than before, `checkpoints/best.ckpt`. A killed run resumes at the
    last whole round and ends with the weights it would have had.

    Raises:
        DataError: If data, templates or the run folder are not as they should be.
        OSError: If the run folder cannot be written, as where the disk is full.
    """
    keep_freed_memory()
    check_shares(config.optim.batch_size, math.prod(_processes(config)))
    templates = TemplateSet.load(config.templates)
    check_grid(templates, config.model.grid)
    run = RunFolder(Path(config.out))
    # Of several processes of one run the first keeps others out.
    is_first = int(os.environ.get("RANK", os.environ.get("LOCAL_RANK", "0"))) == 0
    with sole_writer(run.folder) if is_first else nullcontext():
        return _train(config, run, templates)


def _train(config: TrainConfig, run: RunFolder, templates: TemplateSet) -> Path:
    if config.precision == "auto":
        config = replace(config, precision=_settle_precision(config, run))
    resume_from = run.begin(config, templates)
    if resume_from is not None:
        checkpoint = read_checkpoint(resume_from)
        check_templates(checkpoint, templates.sha256, f"'{resume_from}'")
        # What is not there Lightning passes over in silence.
        lacks = [name for name in _TO_GO_ON if not checkpoint.get(name)]
        if lacks:
            raise DataError(
                f"'{resume_from}' cannot be gone on from, it lacks {', '.join(lacks)}; restore it, "
                "or begin a new run."
            )
    pl.seed_everything(config.seed, workers=True, verbose=False)
    data = PlanningData(config, templates)
    _keep_scenes(run, data.scenes, templates, resume_from is not None)
    rank_zero_only(save_left_out)(run.folder / LEFT_OUT, data.left_out)
    rank_zero_only(TrainingMotion.of(data.train_split).save)(run.motion_file)
    try:
        module = PlanningModule(config, templates)
        trainer = make_trainer(config, run, resume_from is not None)
    except (ValueError, MisconfigurationException) as error:
        raise DataError(f"These settings make no run: {error}") from error
    logger.info(
        "Training on %d samples (%d left out), validating on %d; %.2f M parameters, %s.",
        len(data.train_split.labels),
        data.train_split.futures.num_left_out,
        len(data.val_split.labels),
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
        write_weights(run.weights_file, module.state_dict(), templates.sha256)
    return run.folder


def _keep_scenes(
    run: RunFolder, scenes: RunScenes, templates: TemplateSet, is_resumed: bool
) -> None:
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
        trained = scenes.trained
        with suppress(DataError):
            tokens = TrainingMotion.load(run.motion_file, templates).scene_token.tolist()
            trained = tuple(KnownScene("", token) for token in tokens)
        scenes.check_resumes(replace(scenes, trained=trained), run.folder)
    rank_zero_only(scenes.save)(run.scenes_file)


def make_trainer(config: TrainConfig, run: RunFolder, resume: bool = False) -> pl.Trainer:
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
                monitor="val_top10",
                mode="max",
                enable_version_counter=False,
            ),
            ModelCheckpoint(
                run.checkpoints, filename=Path(LAST).stem, enable_version_counter=False
            ),
            LearningRateMonitor("step"),
            RoundProgress(config.optim.steps, config.val_every) if on_terminal() else RoundLines(),
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


def _settle_precision(config: TrainConfig, run: RunFolder) -> Precision:
    """What a run was begun with, if it goes on; else what is fastest for its first process."""
    with_torchrun = dist.is_torchelastic_launched()
    started_by_first = int(os.environ.get("LOCAL_RANK", "0")) > 0 and not with_torchrun
    decided = (config.resume or started_by_first) and run.config_file.exists()
    begun_with = run.config().precision if decided else "auto"
    if begun_with != "auto":
        return begun_with
    device = choose_device(config.accelerator)
    return agreed_precision(device) if with_torchrun else fastest_precision(device)


def _processes(config: TrainConfig) -> tuple[int, int]:
    """Processes on this machine, and machines; torchrun has decided both when it started us."""
    if not dist.is_torchelastic_launched():
        return config.devices, config.num_nodes
    local = int(os.environ["LOCAL_WORLD_SIZE"])
    return local, int(os.environ["WORLD_SIZE"]) // local
