"""The loop trains whatever a task says: here one that is no planner, and has nothing of one."""

import csv
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from jaxtyping import Float
from numpy.typing import NDArray
from torch import Tensor, nn
from torch.utils.data import Dataset
from torchmetrics import MeanSquaredError, Metric
from world_fixture import TinyRun

from lss_core.batch import Batch, collate
from lss_core.config import DataConfig
from lss_core.data.dataset import CameraDataset
from lss_core.data.drives import KnownScene
from lss_core.data.samples import SampleIndex, load_index, rows_of_split
from lss_core.data.usable import LeftOut
from lss_core.errors import DataError
from shoot.training.config import RunConfig
from shoot.training.loop import fit
from shoot.training.planning.config import TrainConfig
from shoot.training.planning.run_folder import PlanningRun
from shoot.training.split import SampleSplit
from shoot.training.task import Best, Task


@dataclass(frozen=True)
class AllKeyframes(SampleSplit):
    index: SampleIndex
    rows_all: NDArray[np.int64]
    left_out: tuple[LeftOut, ...] = ()

    @property
    def rows(self) -> NDArray[np.int64]:
        return self.rows_all

    @property
    def num_left_out(self) -> int:
        return 0


@dataclass(frozen=True)
class LitBatch:
    sensors: Batch
    brightness: Float[Tensor, "*B"]

    def to(self, device: torch.device | str, non_blocking: bool = False) -> "LitBatch":
        return LitBatch(self.sensors.to(device, non_blocking), self.brightness.to(device))


class LitDataset(Dataset[LitBatch]):
    def __init__(self, split: AllKeyframes, config: RunConfig) -> None:
        self.sensors = CameraDataset(split.index, split.rows, config.data, config.seed)

    def __getitem__(self, item: tuple[int, int]) -> LitBatch:
        sensors = self.sensors[item]
        return LitBatch(sensors, sensors.images.float().mean() / 255.0)


class Error(MeanSquaredError):
    def compute(self) -> dict[str, Tensor]:  # type: ignore[override]
        return {"mse": super().compute()}


class Brightness:
    """How bright the images are, off a map of three channels."""

    name = "lamp"
    out_channels = 3
    best = Best("mse", "min")
    progress = "validation error {val_mse:.4f}"
    fitted_on: tuple[KnownScene, ...] = ()

    def __init__(self, unit: str = "share") -> None:
        self.marks: Mapping[str, str] = {"unit": unit}

    def load_split(self, data: DataConfig, split: str, with_points: bool = False) -> AllKeyframes:
        index = load_index(data.root, data.version, data.cameras)
        return AllKeyframes(index, rows_of_split(index, data.root, data.version, split))

    def dataset(self, split: AllKeyframes, config: RunConfig, with_points: bool) -> LitDataset:
        return LitDataset(split, config)

    def collate(self, samples: Sequence[LitBatch]) -> LitBatch:
        return LitBatch(
            collate([s.sensors for s in samples]), torch.stack([s.brightness for s in samples])
        )

    def new_head(self) -> nn.Linear:
        return nn.Linear(3, 1)

    def outputs(self, head: nn.Module, maps: Float[Tensor, "B C X Y"]) -> Tensor:
        values: Tensor = head(maps.mean(dim=(-2, -1)))[:, 0]
        return values

    def loss(
        self, head: nn.Module, maps: Float[Tensor, "B C X Y"], batch: LitBatch
    ) -> Float[Tensor, ""]:
        return (self.outputs(head, maps) - batch.brightness).square().mean()

    def new_metrics(self) -> Error:
        return Error()

    def measure(self, metrics: Metric, outputs: Tensor, batch: LitBatch) -> None:
        metrics.update(outputs, batch.brightness)

    def save(self, folder: Path) -> None:
        (folder / "lamp.txt").write_text(self.marks["unit"])

    def check_folder(self, folder: Path) -> None:
        if (folder / "lamp.txt").read_text() != self.marks["unit"]:
            raise DataError("The lamp of this run is another one.")

    def check_weights(self, stored: Mapping[str, Any], name: str) -> None:
        if stored.get("unit") != self.marks["unit"]:
            raise DataError(f"{name} is of another lamp.")

    def save_training(self, folder: Path, split: AllKeyframes) -> None:
        (folder / "seen.txt").write_text(str(len(split)))

    def trained_on(self, folder: Path) -> tuple[KnownScene, ...]:
        return ()


def lit_config(tiny_run: TinyRun, out: Path, steps: int) -> RunConfig:
    """The tiny run's, without what only planners know."""
    planning = TrainConfig.load(tiny_run.folder / "config.yaml")
    own = {one.name: getattr(planning, one.name) for one in fields(RunConfig)}
    optim = replace(planning.optim, steps=steps, learning_rate=0.01)
    return RunConfig(**own | {"out": str(out), "optim": optim, "val_every": 4})


def validations(folder: Path) -> list[float]:
    with (folder / "metrics.csv").open() as stream:
        return [float(row["val_mse"]) for row in csv.DictReader(stream) if row["val_mse"]]


@pytest.mark.trains
def test_another_task_trains_and_resumes(tiny_run: TinyRun, tmp_path: Path) -> None:
    assert isinstance(Brightness(), Task)
    config = lit_config(tiny_run, tmp_path / "run", 12)
    folder = fit(config, Brightness())
    found = validations(folder)
    assert len(found) == 3
    assert found[-1] < found[0]
    # All keyframes, those without a future of five seconds too.
    assert int((folder / "seen.txt").read_text()) > 20
    run = PlanningRun(folder)
    assert run.read_config(RunConfig).val_every == 4
    stored = run.weights("last")
    assert stored["unit"] == "share"
    assert stored["state_dict"]["lamp.weight"].shape == (1, 3)
    best = run.weights("best")
    step = 4 * (1 + int(np.argmin(found)))
    assert best["global_step"] == step
    with pytest.raises(DataError, match="lamp of this run is another"):
        fit(replace(config, resume=True), Brightness("lumen"))
    assert fit(replace(config, resume=True), Brightness()) == folder
    assert validations(folder) == found
