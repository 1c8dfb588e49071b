"""What a run reads: the splits of its task, held apart, and their loaders."""

from typing import Any

import numpy as np
import pytorch_lightning as pl
import torch
from torch.utils.data import DataLoader, Sampler

from lss_core.data.padding import check_padding
from lss_core.data.usable import LeftOut
from lss_core.errors import DataError
from shoot.jobs.lost_processes import quiet_loader
from shoot.training.config import RunConfig
from shoot.training.device import choose_device
from shoot.training.run_scenes import FITTED_ON, RunScenes, check_apart, check_unseen
from shoot.training.samplers import ShareSampler, StepSampler, check_shares
from shoot.training.split import SampleSplit
from shoot.training.task import Task, TaskBatch

MIN_VAL_BATCH = 8


class TaskData(pl.LightningDataModule):
    """Loaders of a training run.

    Raises:
        DataError: If the data is not as it should be, or training and validation share a scene or
            a drive.

    Attributes:
        scenes: Those trained and validated on, and those that something of the task was fitted on.
    """

    def __init__(self, config: RunConfig, task: Task[Any, Any]) -> None:
        super().__init__()
        self.config = config
        self.task = task
        # Only training looks at the lidar to learn depths.
        self._with_points = config.optim.depth_weight > 0.0
        self.train_split: SampleSplit = task.load_split(
            config.data, config.train_split, with_points=self._with_points
        )
        if not config.data.lidar_scans:
            train = self.train_split
            check_padding(train.index, config.data, train.rows, training=True)
        self.val_split: SampleSplit = task.load_split(config.data, config.val_split)
        shared = set(self.train_split.scene_names) & set(self.val_split.scene_names)
        if shared:
            raise DataError(
                f"Splits '{config.train_split}' and '{config.val_split}' share {len(shared)} "
                f"scenes ('{min(shared)}' is one); a result on them would be worth nothing."
            )
        trained, validated = self.train_split.scenes, self.val_split.scenes
        check_apart(validated, trained, config.val_split, config.train_split)
        if not config.allow_seen_scenes:
            check_unseen(validated, task.fitted_on, FITTED_ON)
        # Of older templates only the tokens are known.
        by_token = {scene.token: scene for scene in (*trained, *validated)}
        fitted = tuple(by_token.get(scene.token, scene) for scene in task.fitted_on)
        self.scenes = RunScenes(trained, validated, fitted)

    @property
    def left_out(self) -> dict[str, tuple[LeftOut, ...]]:
        """What cannot be used, by split."""
        return {
            self.config.train_split: self.train_split.left_out,
            self.config.val_split: self.val_split.left_out,
        }

    def train_dataloader(self) -> DataLoader[TaskBatch]:
        """Batches of one round of `val_every` steps."""
        config = self.config
        rank, world = self._share()
        check_shares(config.optim.batch_size, world)
        sampler = StepSampler(
            len(self.train_split),
            config.val_every,
            config.optim.batch_size,
            config.seed,
            rank,
            world,
            lambda: self.trainer.global_step if self.trainer else 0,
        )
        return self._loader(self.train_split, sampler, config.optim.batch_size // world)

    def val_dataloader(self) -> DataLoader[TaskBatch]:
        """The validation samples, or `val_samples` of them evenly spread."""
        config = self.config
        num = len(self.val_split)
        wanted = min(config.val_samples or num, num)
        positions = np.linspace(0, num - 1, wanted).round().astype(np.int64)
        rank, world = self._share()
        if wanted < world:
            raise DataError(
                f"{wanted} validation samples cannot be shared by {world} processes; validate on "
                "more (--val-samples) or use fewer processes."
            )
        sampler = ShareSampler(positions, rank, world)
        # Without gradients a sample needs a fraction of the memory.
        share = max(MIN_VAL_BATCH, 2 * config.optim.batch_size // world)
        return self._loader(self.val_split, sampler, share)

    def transfer_batch_to_device(
        self, batch: TaskBatch, device: torch.device, dataloader_idx: int
    ) -> TaskBatch:
        """The batch on the device; pages that are locked are copied while the host goes on."""
        return batch.to(device, non_blocking=True)

    def _share(self) -> tuple[int, int]:
        return (self.trainer.global_rank, self.trainer.world_size) if self.trainer else (0, 1)

    def _loader(
        self, split: SampleSplit, sampler: Sampler[tuple[int, int]], batch_size: int
    ) -> DataLoader[TaskBatch]:
        workers = self.config.num_workers
        with_points = split is self.train_split and self._with_points
        return DataLoader(
            self.task.dataset(split, self.config, with_points),
            batch_size=batch_size,
            sampler=sampler,
            num_workers=workers,
            collate_fn=self.task.collate,
            pin_memory=choose_device(self.config.accelerator).type == "cuda",
            persistent_workers=workers > 0,
            worker_init_fn=quiet_loader,
        )
