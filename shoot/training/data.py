"""Samples with what the driver did next: Batch, future and template label, and their loaders."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytorch_lightning as pl
import torch
from jaxtyping import Float, Int
from numpy.typing import NDArray
from torch import Tensor
from torch.utils.data import DataLoader, Dataset, Sampler

from lss_core.batch import Batch, collate
from lss_core.config import DataConfig
from lss_core.data.dataset import CameraDataset, LidarDataset
from lss_core.data.drives import KnownScene, know_scenes
from lss_core.data.padding import check_padding
from lss_core.data.samples import SampleIndex, load_index, rows_of_split
from lss_core.data.usable import LeftOut, Needs, usable_rows, usable_scenes
from lss_core.errors import DataError
from shoot.templates import TemplateSet
from shoot.training.config import TrainConfig
from shoot.training.device import choose_device
from shoot.training.run_scenes import FITTED_ON, RunScenes, check_apart, check_unseen
from shoot.trajectories import Futures, mine_futures

MIN_VAL_BATCH = 8


@dataclass(frozen=True)
class PlanBatch:
    """What a planner sees, and what the driver did.

    Attributes:
        sensors: Images and calibration; nothing in it knows the future.
        future: Driven positions in `ego`, metres.
        template_idx: The template nearest to `future`.
    """

    sensors: Batch
    future: Float[Tensor, "*B T 2"]
    template_idx: Int[Tensor, "*B"]

    def to(self, device: torch.device | str, non_blocking: bool = False) -> "PlanBatch":
        """The same on another device."""
        return PlanBatch(
            self.sensors.to(device, non_blocking),
            self.future.to(device, non_blocking=non_blocking),
            self.template_idx.to(device, non_blocking=non_blocking),
        )

    def pin_memory(self) -> "PlanBatch":
        """The same in page-locked memory."""
        return PlanBatch(
            self.sensors.pin_memory(), self.future.pin_memory(), self.template_idx.pin_memory()
        )


def collate_plans(samples: Sequence[PlanBatch]) -> PlanBatch:
    """Stack single samples into one batch."""
    return PlanBatch(
        collate([sample.sensors for sample in samples]),
        torch.stack([sample.future for sample in samples]),
        torch.stack([sample.template_idx for sample in samples]),
    )


@dataclass(frozen=True)
class LabelledSplit:
    """The keyframes of a split that have a whole future and all their files.

    Attributes:
        index: Of the data set.
        futures: Theirs; `futures.sample` are the rows.
        labels: [S] nearest templates.
        left_out: Keyframes that cannot be used.
    """

    index: SampleIndex
    futures: Futures
    labels: NDArray[np.int64]
    left_out: tuple[LeftOut, ...] = ()

    @property
    def scene_names(self) -> NDArray[np.character]:
        """[S] name of each sample's scene."""
        names: NDArray[np.character] = self.index.scene_name[self.futures.scene]
        return names

    @property
    def scene_tokens(self) -> NDArray[np.character]:
        """[S] token of each sample's scene."""
        tokens: NDArray[np.character] = self.index.scene_token[self.futures.scene]
        return tokens

    @property
    def scenes(self) -> tuple[KnownScene, ...]:
        """The samples' scenes, as they can be met again."""
        return know_scenes(self.index, np.unique(self.futures.scene).tolist())

    @property
    def logs(self) -> NDArray[np.character] | None:
        """[S] log of each sample's scene; None if no log of the data set holds several scenes."""
        if len(np.unique(self.index.scene_log)) == len(self.index.scene_log):
            return None
        logs: NDArray[np.character] = self.index.scene_log[self.futures.scene]
        return logs


def load_split(
    data: DataConfig,
    split: str,
    templates: TemplateSet,
    need_files: bool = True,
    with_points: bool = False,
) -> LabelledSplit:
    """Mine and label the keyframes of a split.

    Args:
        data: Which data set.
        split: Which scenes.
        templates: To label with; futures have their horizon and step.
        need_files: Look at calibrations, and whether the files of images or sweeps are there.
        with_points: A camera planner needs the keyframes' sweeps, too.

    Raises:
        DataError: If the split is unknown or empty, samples cannot be used and are not to be left
            out, or no sample has a whole future.
    """
    index = load_index(data.root, data.version, data.cameras)
    rows = rows_of_split(index, data.root, data.version, split)
    needs = Needs.of_planner(data.lidar_scans, with_points) if need_files else None
    return label_rows(index, rows, data, templates, needs, f"of split '{split}' ")


def label_rows(
    index: SampleIndex,
    rows: NDArray[np.int64],
    data: DataConfig,
    templates: TemplateSet,
    needs: Needs | None,
    whose: str = "",
) -> LabelledSplit:
    """Mine and label samples.

    Args:
        index: Of the data set.
        rows: Its samples, in the order of `rows_of_split`.
        data: Where it is, and whether bad samples are left out.
        templates: To label with.
        needs: Which sensors they need; none if not given.
        whose: Words for the samples.

    Raises:
        DataError: As `load_split`.
    """
    in_scenes = usable_scenes(index, rows, data.skip_bad)
    horizon_s, dt_s = templates.horizon_s, templates.dt_s
    futures = mine_futures(index, in_scenes.rows, "keyframes", horizon_s=horizon_s, dt_s=dt_s)
    if not len(futures.sample):
        raise DataError(
            f"No sample {whose}in {Path(data.root) / data.version} has a whole future, of "
            f"{horizon_s:g} s."
        )
    left_out = in_scenes.left_out
    if needs is not None:
        usable = usable_rows(index, Path(data.root), futures.sample, data.skip_bad, needs)
        futures = futures.select(np.isin(futures.sample, usable.rows))
        left_out += usable.left_out
        if needs.images:
            check_padding(index, data, futures.sample)
    return LabelledSplit(index, futures, templates.nearest(futures.xy_m), left_out)


class PlanningDataset(Dataset[PlanBatch]):
    """Items are asked for as (position, draw), see `CameraDataset`."""

    def __init__(
        self, split: LabelledSplit, data: DataConfig, seed: int, with_points: bool = False
    ) -> None:
        self.split = split
        rows = split.futures.sample
        self.sensors: CameraDataset | LidarDataset = (
            LidarDataset(split.index, rows, data)
            if data.lidar_scans
            else CameraDataset(split.index, rows, data, seed, with_points)
        )

    def __len__(self) -> int:
        return len(self.split.labels)

    def __getitem__(self, item: tuple[int, int]) -> PlanBatch:
        """One sample, without batch dimension."""
        position = item[0]
        return PlanBatch(
            self.sensors[item],
            torch.from_numpy(self.split.futures.xy_m[position]).float(),
            torch.tensor(self.split.labels[position]),
        )


class StepSampler(Sampler[tuple[int, int]]):
    """An endless shuffled stream of samples, cut into rounds of a fixed number of steps.

    The stream passes over all samples in a new order each time. What step s of the run reads
    follows from the seed and s alone: a resumed run, and any number of processes that share the
    global batch, read the same as an undisturbed one.

    Args:
        num_samples: Samples to draw from.
        steps: Steps of a round; one iteration reads them.
        global_batch: Samples a step, over all processes.
        seed: Of the order.
        rank: Which process this is.
        world_size: Number of processes.
        steps_done: Tells at which step of the run an iteration begins. (Lightning's number of the
            epoch does not: it is one too many after a run is resumed.)
    """

    def __init__(
        self,
        num_samples: int,
        steps: int,
        global_batch: int,
        seed: int,
        rank: int = 0,
        world_size: int = 1,
        steps_done: Callable[[], int] = lambda: 0,
    ) -> None:
        self.num_samples = num_samples
        self.steps = steps
        self.global_batch = global_batch
        self.seed = seed
        self.rank = rank
        self.world_size = world_size
        self.steps_done = steps_done

    def __len__(self) -> int:
        return self.steps * self.global_batch // self.world_size

    def __iter__(self) -> Iterator[tuple[int, int]]:
        first = self.steps_done() * self.global_batch
        order, order_of = np.zeros(0, dtype=np.int64), -1
        for draw in range(
            first + self.rank, first + self.steps * self.global_batch, self.world_size
        ):
            passes, place = divmod(draw, self.num_samples)
            if passes != order_of:
                rng = np.random.default_rng((self.seed, passes))
                order, order_of = rng.permutation(self.num_samples), passes
            yield int(order[place]), draw


class ShareSampler(Sampler[tuple[int, int]]):
    """Every `world_size`-th of the positions, in order, none twice: shares may differ by one."""

    def __init__(self, positions: NDArray[np.int64], rank: int = 0, world_size: int = 1) -> None:
        self.positions = positions[rank::world_size]

    def __len__(self) -> int:
        return len(self.positions)

    def __iter__(self) -> Iterator[tuple[int, int]]:
        return ((int(position), -1) for position in self.positions)


def check_shares(batch_size: int, num_processes: int) -> None:
    """Check that all processes get equally many samples of a batch.

    Raises:
        DataError: If not.
    """
    if batch_size % num_processes:
        raise DataError(
            f"A batch of {batch_size} cannot be shared by {num_processes} processes; choose "
            "--optim.batch-size as a multiple of them."
        )


class PlanningData(pl.LightningDataModule):
    """Loaders of a training run.

    Raises:
        DataError: If the data is not as it should be, or training and validation share a scene or
            a drive.

    Attributes:
        scenes: Those trained and validated on, and those the templates were fitted on.
    """

    def __init__(self, config: TrainConfig, templates: TemplateSet) -> None:
        super().__init__()
        self.config = config
        # Only training looks at the lidar to learn depths.
        self._with_points = config.optim.depth_weight > 0.0
        self.train_split = load_split(
            config.data, config.train_split, templates, with_points=self._with_points
        )
        if not config.data.lidar_scans:
            train = self.train_split
            check_padding(train.index, config.data, train.futures.sample, training=True)
        self.val_split = load_split(config.data, config.val_split, templates)
        shared = set(self.train_split.scene_names) & set(self.val_split.scene_names)
        if shared:
            raise DataError(
                f"Splits '{config.train_split}' and '{config.val_split}' share {len(shared)} "
                f"scenes ('{min(shared)}' is one); a result on them would be worth nothing."
            )
        trained, validated = self.train_split.scenes, self.val_split.scenes
        check_apart(validated, trained, config.val_split, config.train_split)
        if not config.allow_seen_scenes:
            check_unseen(validated, templates.scenes, FITTED_ON)
        # Of older templates only the tokens are known.
        by_token = {scene.token: scene for scene in (*trained, *validated)}
        fitted = tuple(by_token.get(scene.token, scene) for scene in templates.scenes)
        self.scenes = RunScenes(trained, validated, fitted)

    @property
    def left_out(self) -> dict[str, tuple[LeftOut, ...]]:
        """What cannot be used, by split."""
        return {
            self.config.train_split: self.train_split.left_out,
            self.config.val_split: self.val_split.left_out,
        }

    def train_dataloader(self) -> DataLoader[PlanBatch]:
        """Batches of one round of `val_every` steps."""
        config = self.config
        rank, world = self._share()
        check_shares(config.optim.batch_size, world)
        sampler = StepSampler(
            len(self.train_split.labels),
            config.val_every,
            config.optim.batch_size,
            config.seed,
            rank,
            world,
            lambda: self.trainer.global_step if self.trainer else 0,
        )
        return self._loader(self.train_split, sampler, config.optim.batch_size // world)

    def val_dataloader(self) -> DataLoader[PlanBatch]:
        """The validation samples, or `val_samples` of them evenly spread."""
        config = self.config
        num = len(self.val_split.labels)
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
        self, batch: PlanBatch, device: torch.device, dataloader_idx: int
    ) -> PlanBatch:
        """The batch on the device; pages that are locked are copied while the host goes on."""
        return batch.to(device, non_blocking=True)

    def _share(self) -> tuple[int, int]:
        return (self.trainer.global_rank, self.trainer.world_size) if self.trainer else (0, 1)

    def _loader(
        self, split: LabelledSplit, sampler: Sampler[tuple[int, int]], batch_size: int
    ) -> DataLoader[PlanBatch]:
        workers = self.config.num_workers
        with_points = split is self.train_split and self._with_points
        return DataLoader(
            PlanningDataset(split, self.config.data, self.config.seed, with_points),
            batch_size=batch_size,
            sampler=sampler,
            num_workers=workers,
            collate_fn=collate_plans,
            pin_memory=choose_device(self.config.accelerator).type == "cuda",
            persistent_workers=workers > 0,
        )
