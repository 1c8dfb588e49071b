"""The thin Lightning module around the map's network and a task."""

import math
from typing import Any

import pytorch_lightning as pl
import torch
import torch.distributed as dist
from jaxtyping import Float
from torch import Tensor, nn

from lss_core.batch import Batch
from lss_core.depth_targets import batch_depth_bins, depth_loss
from lss_core.model import CameraModel, make_model
from shoot.training.config import OptimConfig, RunConfig
from shoot.training.task import Task, TaskBatch


class TaskModule(pl.LightningModule):
    """Sensors to what a task reads off their map, and the loss that trains it.

    Attributes:
        is_restored: Whether training has begun: what a checkpoint holds is in place.
    """

    def __init__(self, config: RunConfig, task: Task[Any, Any]) -> None:
        super().__init__()
        self.is_restored = False
        self.config = config
        self.task = task
        self.model = make_model(config.model, config.data, task.out_channels)
        self.add_module(task.name, task.new_head())
        self.val_metrics = task.new_metrics()

    def forward(self, sensors: Batch) -> Tensor:
        """What the task reads off the map, [B, ...]."""
        return self.outputs(self.model.forward_batch(sensors))

    def outputs(self, maps: Float[Tensor, "B C X Y"]) -> Tensor:
        """The same off a map that is there already."""
        return self.task.outputs(self._head, maps)

    @property
    def _head(self) -> nn.Module:
        return self.get_submodule(self.task.name)

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

    def training_step(self, batch: TaskBatch, batch_idx: int) -> Tensor:
        """The task's loss, and that of depths if asked for."""
        size = len(batch.sensors.sample_idx)
        weight = self.config.optim.depth_weight
        if weight > 0.0 and isinstance(self.model, CameraModel):
            maps, depth_prob = self.model.forward_with_depth(batch.sensors)
            loss = self.task.loss(self._head, maps, batch)
            config = self.model.config
            bins = batch_depth_bins(
                batch.sensors, self.model.image_hw, config.image_stride, config.depth.depths_m
            )
            of_depth = depth_loss(depth_prob, bins)
            self.log("depth_loss", of_depth, batch_size=size, sync_dist=True)
        else:
            maps = self.model.forward_batch(batch.sensors)
            loss = self.task.loss(self._head, maps, batch)
            of_depth = torch.zeros_like(loss)
        self.log("train_loss", loss, prog_bar=True, batch_size=size, sync_dist=True)
        return loss + weight * of_depth

    def on_train_batch_end(self, *_: Any) -> None:
        """End the last round early if it has fewer steps than the others: it is validated too."""
        if self.trainer.global_step >= self.config.optim.steps:
            self.trainer.should_stop = True

    def validation_step(self, batch: TaskBatch, batch_idx: int) -> None:
        """Add a batch to the running metrics."""
        self.task.measure(self.val_metrics, self(batch.sensors), batch)

    def on_validation_start(self) -> None:
        """Give all processes the same batch statistics before they are used."""
        if dist.is_initialized() and not self.config.sync_batchnorm:
            for buffer in self.model.buffers():
                if buffer.is_floating_point():
                    dist.all_reduce(buffer)
                    buffer /= dist.get_world_size()

    def on_validation_epoch_end(self) -> None:
        """Log the metrics over all processes."""
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
        """Say what these weights belong to."""
        checkpoint.update(self.task.marks)

    def on_load_checkpoint(self, checkpoint: dict[str, Any]) -> None:
        """Refuse weights that belong to something else.

        Raises:
            DataError: If they do.
        """
        self.task.check_weights(checkpoint, "the checkpoint")


def rate_at(optim: OptimConfig, step: int) -> float:
    """Learning rate at a step, as a share of the peak: linear warm-up, then constant or cosine."""
    if step < optim.warmup_steps:
        return (step + 1) / optim.warmup_steps
    if optim.schedule == "constant":
        return 1.0
    done = (step - optim.warmup_steps) / max(1, optim.steps - optim.warmup_steps)
    return 0.5 * (1.0 + math.cos(math.pi * min(1.0, done)))
