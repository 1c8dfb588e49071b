"""A run folder: config, versions and checkpoints of one training run, and what its task adds."""

import json
import platform
import subprocess
from dataclasses import dataclass, replace
from importlib.metadata import version
from pathlib import Path
from typing import Any

from pytorch_lightning.utilities import rank_zero_only

from lss_core.errors import DataError
from lss_core.files import clear_leftovers, write_atomically
from shoot.training.checkpoint_file import CHECKPOINTS, WEIGHTS_FILE, read_run_weights
from shoot.training.config import CONFIG_FILE, ConfigT, RunConfig
from shoot.training.task import Task

LAST, BEST = "last.ckpt", "best.ckpt"
_LIBRARIES = ("torch", "pytorch-lightning", "timm", "numpy", "nuscenes-devkit", "shoot-planner")


@dataclass(frozen=True)
class RunFolder:
    """Where things of a run are.

    Attributes:
        folder: The run folder.
    """

    folder: Path

    @property
    def config_file(self) -> Path:
        """What the run was told."""
        return self.folder / CONFIG_FILE

    @property
    def checkpoints(self) -> Path:
        """Folder of `last.ckpt` and `best.ckpt`."""
        return self.folder / CHECKPOINTS

    @property
    def weights_file(self) -> Path:
        """The weights of the finished run, without what only training needs."""
        return self.folder / WEIGHTS_FILE

    @property
    def metrics_file(self) -> Path:
        """What was logged while training."""
        return self.folder / "metrics.csv"

    @property
    def events(self) -> Path:
        """Folder of the same for TensorBoard."""
        return self.folder / "tensorboard"

    @property
    def scenes_file(self) -> Path:
        """Which scenes it has seen."""
        return self.folder / "scenes.json"

    @property
    def time_file(self) -> Path:
        """How long the finished run has trained."""
        return self.folder / "training_time.json"

    def begin(self, config: RunConfig, task: Task[Any, Any]) -> Path | None:
        """Write what the run is; returns the checkpoint to resume from, if any.

        Raises:
            DataError: If the folder holds a run already and `resume` is off, or on and the run was
                told something else.
            OSError: If it cannot be written.
        """
        last = self.checkpoints / LAST
        if self.config_file.exists():
            if not config.resume and last.exists():
                raise DataError(
                    f"'{self.folder}' holds a run already; go on with --resume or choose another "
                    "--out."
                )
            if self.weights_file.exists() and not last.exists():
                raise DataError(
                    f"'{self.folder}' holds the weights of a finished run, but no checkpoint to go "
                    "on from; choose another --out."
                )
            if config.resume:
                self._check_same(config)
                task.check_folder(self.folder)
        self._write(config, task)
        return last if config.resume and last.exists() else None

    @rank_zero_only
    def _write(self, config: RunConfig, task: Task[Any, Any]) -> None:
        self.checkpoints.mkdir(parents=True, exist_ok=True)
        # Also those of files that may not be written again, as best.ckpt.
        clear_leftovers(self.folder)
        task.save(self.folder)
        root = str(Path(config.data.root).absolute())
        replace(config, data=replace(config.data, root=root)).save(self.config_file)
        with write_atomically(self.folder / "environment.json") as stream:
            stream.write(json.dumps(_environment(), indent=2).encode())

    def read_config(self, config_type: type[ConfigT]) -> ConfigT:
        """What the run was told; a relative data root, as of a run given to others, is its own.

        Raises:
            DataError: If this is no run folder.
        """
        config = config_type.load(self.config_file)
        root = str(self.folder / config.data.root)
        return replace(config, data=replace(config.data, root=root))

    def weights(self, which: str) -> dict[str, Any]:
        """Weights under `state_dict` and what they belong to, see `read_run_weights`.

        Args:
            which: `last` or `best`.

        Raises:
            DataError: If there are none, or they are damaged.
        """
        return read_run_weights(self.folder, which)

    def _check_same(self, config: RunConfig) -> None:
        before = self.read_config(type(config)).what_is_computed()
        now = config.what_is_computed()
        if before != now:
            differ = [n for n in vars(now) if getattr(now, n) != getattr(before, n)]
            raise DataError(
                f"'{self.folder}' was begun with other settings of {', '.join(differ)}; resume it "
                f"with those in {self.config_file.name}."
            )


def _environment() -> dict[str, Any]:
    return {
        "git": _git_commit(),
        "python": platform.python_version(),
        "machine": platform.platform(),
        "libraries": {name: version(name) for name in _LIBRARIES},
    }


def _git_commit() -> str | None:
    """Of the source tree; None where there is no git or no repository."""
    try:
        commit = subprocess.run(
            ["git", "rev-parse", "HEAD"],
            cwd=Path(__file__).parent,
            capture_output=True,
            text=True,
            check=False,
        )
    except OSError:
        return None
    return commit.stdout.strip() or None
