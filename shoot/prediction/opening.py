"""What opening and reading a run folder is for all tasks."""

from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Any, TypeVar

import numpy as np
import torch
from numpy.typing import NDArray
from torch.utils.data import DataLoader

from shoot.jobs.lost_processes import quiet_loader
from shoot.prediction.disturbance import UNDISTURBED, Disturbance
from shoot.prediction.plain import with_weights
from shoot.training.config import ConfigT, RunConfig
from shoot.training.device import choose_device
from shoot.training.module import TaskModule
from shoot.training.run_folder import RunFolder
from shoot.training.task import BatchT, SplitT, Task

ModuleT = TypeVar("ModuleT", bound=TaskModule)


def to_read_now(
    config: ConfigT,
    root: str | None,
    version: str | None,
    skip_bad: bool,
    cameras: tuple[str, ...] | None,
) -> ConfigT:
    """A run's config with the data it is to read now; its weights come from the run.

    Args:
        config: What it was told.
        root: Data root, if not the one it was trained on.
        version: Version, if not the one it was trained on.
        skip_bad: Leave out samples that cannot be used, also if the run did not.
        cameras: Channels, if not those it was trained on.
    """
    data = replace(
        config.data,
        root=root or config.data.root,
        version=version or config.data.version,
        skip_bad=skip_bad or config.data.skip_bad,
        cameras=cameras or config.data.cameras,
        drop_cameras=0,  # what training hides, of how many there were then
    )
    return replace(config, data=data, model=replace(config.model, pretrained="none"))


def load_module(run: RunFolder, checkpoint: str, make: Callable[[], ModuleT]) -> ModuleT:
    """A run's module with its weights, in evaluation mode, where this machine is fastest.

    Args:
        run: Whose.
        checkpoint: `last` or `best`.
        make: The module without them.

    Raises:
        DataError: If there are no weights, or they do not fit.
    """
    state = run.weights(checkpoint)

    def make_checked() -> ModuleT:
        module = make()
        module.task.check_weights(state, f"'{run.folder}'")
        return module

    return with_weights(make_checked, state["state_dict"], run.folder).eval().to(choose_device())


def read_batches(
    task: Task[SplitT, BatchT],
    config: RunConfig,
    split: SplitT,
    positions: NDArray[np.int64],
    device: torch.device,
    disturbance: Disturbance = UNDISTURBED,
) -> Iterator[BatchT]:
    """Batches of the samples at the given positions, in order, without augmentation."""
    is_random = disturbance.is_random
    if is_random:
        config = replace(config, data=disturbance.of_data(config.data))
    loader: DataLoader[Any] = DataLoader(
        task.dataset(split, config, with_points=False),
        batch_size=max(8, config.optim.batch_size),
        sampler=[(int(position), int(position) if is_random else -1) for position in positions],
        num_workers=config.num_workers,
        collate_fn=task.collate,
        worker_init_fn=quiet_loader,
    )
    for batch in loader:
        if disturbance.missing:
            sensors = disturbance.hide(batch.sensors, config.data.cameras)
            batch = replace(batch, sensors=sensors)
        yield batch.to(device)
