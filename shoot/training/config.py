"""What any run can be told, whatever its task, as frozen dataclasses."""

from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal, TypeVar

import yaml
from pydantic import ConfigDict, TypeAdapter, ValidationError

from lss_core.bounds import MAX_COUNT, Bounds, Count, Seed, SettingError, check_settings
from lss_core.config import DataConfig, ModelConfig
from lss_core.errors import DataError
from lss_core.files import write_atomically
from lss_core.legible import legible
from shoot.training.device import Accelerator

Precision = Literal["32-true", "bf16-mixed", "16-mixed"]
PLANNING = "planning"
CONFIG_FILE = "config.yaml"
_TASK = "task"
_Several = Annotated[int, Bounds(0, MAX_COUNT)]
_Processes = Annotated[int, Bounds(1, 65_536)]
ConfigT = TypeVar("ConfigT", bound="RunConfig")


@dataclass(frozen=True)
class OptimConfig:
    """Optimisation; defaults are the paper's (section 5) where it speaks.

    Attributes:
        steps: Optimiser steps of the whole run.
        batch_size: Samples a step, over all processes together.
        learning_rate: Of Adam; the peak where a schedule is used.
        weight_decay: Of Adam.
        clip_norm: Gradients are scaled down to this norm (released code: 5.0).
        warmup_steps: Steps over which the rate rises linearly.
        schedule: `constant`, or `cosine` down to zero at the last step.
        depth_weight: Weight of a further loss of camera planners, the cross-entropy of depths that
            the keyframe's lidar sweep sees; 0: none, as in the paper.
        max_bad_steps: As many steps in a row without a finite gradient, which are left out, end the
            run.
    """

    steps: Count = 300_000
    batch_size: Annotated[int, Bounds(1, 65_536)] = 4
    learning_rate: Annotated[float, Bounds(0.0, 10.0, low_is_in=False)] = 1e-3
    weight_decay: Annotated[float, Bounds(0.0, 10.0)] = 1e-7
    clip_norm: Annotated[float, Bounds(0.0, 1e9, low_is_in=False)] = 5.0
    warmup_steps: _Several = 0
    schedule: Literal["constant", "cosine"] = "constant"
    depth_weight: Annotated[float, Bounds(0.0, 1_000.0)] = 0.0
    max_bad_steps: Count = 20

    def __post_init__(self) -> None:
        check_settings(self)


@dataclass(frozen=True, kw_only=True)
class RunConfig:
    """One training run; what only some tasks know, theirs add.

    Attributes:
        task: Which task's it is; a config file that names none is of planning.
        out: Run folder.
        data: Which data.
        model: Network from images or lidar points to the map.
        optim: Optimisation.
        train_split: Scenes trained on.
        val_split: Scenes validated on; it shares none with `train_split`.
        val_every: Steps between validations; a checkpoint is written at each.
        val_samples: Validate on this many samples, evenly spread; all of them if 0.
        num_workers: Processes that load images.
        accelerator: `cpu`, `gpu` or `cuda`, or what is there (`auto`).
        devices: Processes on this machine (under torchrun, its own count wins).
        num_nodes: Machines.
        sync_batchnorm: Batch statistics over all processes, so that any number of them trains as
            one would; without, each normalises by its own share of the batch, which is faster.
        precision: Of the convolutions; geometry, splat and scores stay float32. `auto`: bfloat16
            where this machine is clearly faster in it, tried at the start; the run keeps it.
        deterministic: On a GPU, too, the same command trains the same bits, slower; on CPUs it
            does anyway.
        seed: Of everything random.
        resume: Go on from the run's last checkpoint.
        allow_seen_scenes: Validate also on scenes that something of the run, as its templates, was
            fitted on.
    """

    # A misspelt key in a config file must not pass for the default; nested classes inherit this.
    __pydantic_config__ = ConfigDict(extra="forbid")

    task: ClassVar[str] = PLANNING

    out: str
    data: DataConfig = field(default_factory=DataConfig)
    model: ModelConfig = field(default_factory=ModelConfig)
    optim: OptimConfig = field(default_factory=OptimConfig)
    train_split: str = "train"
    val_split: str = "val"
    val_every: Count = 1000
    val_samples: _Several = 0
    num_workers: Annotated[int, Bounds(0, 1024)] = 4
    accelerator: Accelerator = "auto"
    devices: _Processes = 1
    num_nodes: _Processes = 1
    sync_batchnorm: bool = True
    precision: Precision | Literal["auto"] = "32-true"
    deterministic: bool = False
    seed: Seed = 0
    resume: bool = False
    allow_seen_scenes: bool = False

    def __post_init__(self) -> None:
        check_settings(self)
        if self.train_split == self.val_split:
            raise SettingError(
                f"train_split and val_split are both '{self.train_split}', but must share no scene."
            )
        if not self.data.lidar_scans:
            self._check_cameras()

    def _check_cameras(self) -> None:
        for name in ("height_px", "width_px"):
            side = getattr(self.data.image, name)
            if side % self.model.image_stride:
                raise SettingError(
                    f"{name} is {side}, but must be a multiple of image_stride, "
                    f"{self.model.image_stride}."
                )
        if self.optim.depth_weight > 0.0 and self.model.lift != "depth":
            raise SettingError(
                f"depth_weight is {self.optim.depth_weight:g}, but must be 0 with lift "
                f"'{self.model.lift}', which learns no depth."
            )
        if self.optim.depth_weight > 0.0 and len(self.model.depth.depths_m) < 2:
            raise SettingError(
                "There is one depth, but depth_weight needs two or more to tell apart; choose a "
                "smaller step_m."
            )

    def what_is_computed(self: ConfigT) -> ConfigT:
        """The same wherever things are and however they run; a run that goes on must share it."""
        return replace(
            self,
            out="-",
            data=replace(self.data, root="-"),
            resume=False,
            num_workers=0,
            accelerator="auto",
            devices=1,
            num_nodes=1,
            allow_seen_scenes=False,
        )

    def save(self, path: Path) -> None:
        """Write it as YAML."""
        task = {} if self.task == PLANNING else {_TASK: self.task}
        with write_atomically(path) as stream:
            stream.write(yaml.safe_dump(task | _plain(asdict(self)), sort_keys=False).encode())

    @classmethod
    def load(cls: type[ConfigT], path: Path) -> ConfigT:
        """Read it from YAML.

        Raises:
            DataError: If the file is missing, of another task or does not fit.
        """
        loaded = _read(path)
        task = loaded.pop(_TASK, PLANNING) if isinstance(loaded, dict) else cls.task
        if task != cls.task:
            raise DataError(
                f"'{path.parent}' is a run of the task {legible(str(task))[:40]}, where one of "
                f"{cls.task} is wanted."
            )
        try:
            return TypeAdapter(cls).validate_python(_in_todays_words(loaded))
        except ValidationError as error:
            wrong = "; ".join(
                f"{'.'.join(str(part) for part in detail['loc'])}: {detail['msg']}"
                for detail in error.errors()
            )
            raise DataError(f"'{path}' is no training config ({wrong}).") from error


def task_of(folder: Path) -> str:
    """Name of the task that a run was trained for.

    Raises:
        DataError: If the folder is no run folder.
    """
    loaded = _read(folder / CONFIG_FILE)
    return str(loaded.get(_TASK, PLANNING)) if isinstance(loaded, dict) else PLANNING


def _read(path: Path) -> Any:
    """What a config file holds.

    Raises:
        DataError: If it is missing, or no YAML.
    """
    if not path.is_file():
        raise DataError(f"'{path.parent}' is no run folder: it has no {path.name}.")
    try:
        return yaml.safe_load(path.read_text(encoding="utf-8"))
    except (yaml.YAMLError, UnicodeDecodeError) as error:
        raise DataError(f"'{path}' is no training config: {error}") from error


def _in_todays_words(loaded: Any) -> Any:
    """A config as loaded, with settings by the names they have now."""
    data = loaded.get("data") if isinstance(loaded, dict) else None
    if not isinstance(data, dict) or "skip_missing" not in data:
        return loaded
    renamed = {"skip_bad": data["skip_missing"]} | data
    del renamed["skip_missing"]
    return loaded | {"data": renamed}


def _plain(value: Any) -> Any:
    """Lists for tuples: YAML has no others."""
    if isinstance(value, dict):
        return {key: _plain(item) for key, item in value.items()}
    return [_plain(item) for item in value] if isinstance(value, list | tuple) else value
