"""A run folder: config, templates, versions and checkpoints of one training run."""

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
from shoot.templates import TemplateSet
from shoot.training.checkpoint_file import read_checkpoint, read_weights
from shoot.training.config import TrainConfig

LAST, BEST = "last.ckpt", "best.ckpt"
_LIBRARIES = ("torch", "pytorch-lightning", "timm", "numpy", "nuscenes-devkit", "shoot")


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
        return self.folder / "config.yaml"

    @property
    def templates_file(self) -> Path:
        """The run's own copy of its templates."""
        return self.folder / "templates.npz"

    @property
    def checkpoints(self) -> Path:
        """Folder of `last.ckpt` and `best.ckpt`."""
        return self.folder / "checkpoints"

    @property
    def weights_file(self) -> Path:
        """The weights of the finished run, without what only training needs."""
        return self.folder / "weights.safetensors"

    @property
    def metrics_file(self) -> Path:
        """What was logged while training."""
        return self.folder / "metrics.csv"

    @property
    def events(self) -> Path:
        """Folder of the same for TensorBoard."""
        return self.folder / "tensorboard"

    @property
    def motion_file(self) -> Path:
        """What its baselines are fitted to."""
        return self.folder / "training_motion.npz"

    @property
    def scenes_file(self) -> Path:
        """Which scenes it has seen."""
        return self.folder / "scenes.json"

    @property
    def past_motion_file(self) -> Path:
        """Networks of the baseline past motion, kept by the first evaluation."""
        return self.folder / "past_motion.safetensors"

    @property
    def time_file(self) -> Path:
        """How long the finished run has trained."""
        return self.folder / "training_time.json"

    def begin(self, config: TrainConfig, templates: TemplateSet) -> Path | None:
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
                if self.templates_file.exists():
                    own = TemplateSet.load(self.templates_file)
                    if own.sha256 != templates.sha256:
                        raise DataError(
                            f"'{self.folder}' was trained with other templates than "
                            f"'{config.templates}'; give it its own ones."
                        )
        self._write(config, templates)
        return last if config.resume and last.exists() else None

    @rank_zero_only
    def _write(self, config: TrainConfig, templates: TemplateSet) -> None:
        self.checkpoints.mkdir(parents=True, exist_ok=True)
        # Also those of files that may not be written again, as best.ckpt.
        clear_leftovers(self.folder)
        templates.save(self.templates_file)
        root = str(Path(config.data.root).absolute())
        replace(config, data=replace(config.data, root=root)).save(self.config_file)
        with write_atomically(self.folder / "environment.json") as stream:
            stream.write(json.dumps(_environment(), indent=2).encode())

    def config(self) -> TrainConfig:
        """What the run was told; a relative data root, as of a run given to others, is its own.

        Raises:
            DataError: If this is no run folder.
        """
        config = TrainConfig.load(self.config_file)
        root = str(self.folder / config.data.root)
        return replace(config, data=replace(config.data, root=root))

    def templates(self) -> TemplateSet:
        """The templates it was trained with.

        Raises:
            DataError: If they are missing.
        """
        return TemplateSet.load(self.templates_file)

    def weights(self, which: str) -> dict[str, Any]:
        """Weights under `state_dict` and what they belong to, read without running code from them.

        Where there are no checkpoints, the `last` ones are those of `weights.safetensors`: config,
        templates and this file are all that a run needs to be given to others.

        Args:
            which: `last` or `best`.

        Raises:
            DataError: If there are none, or they are damaged.
        """
        path = self.checkpoints / f"{which}.ckpt"
        if which == "last" and not path.exists() and self.weights_file.exists():
            return read_weights(self.weights_file)
        return read_checkpoint(path)

    def _check_same(self, config: TrainConfig) -> None:
        """What may differ on resuming: where things are and how they run, not what is computed."""
        free = {
            "templates": "-",
            "out": "-",
            "resume": False,
            "num_workers": 0,
            "accelerator": "auto",
            "devices": 1,
            "num_nodes": 1,
            "allow_seen_scenes": False,
        }
        before = replace(self.config(), **free)  # type: ignore[arg-type]
        now = replace(config, **free)  # type: ignore[arg-type]
        before = replace(before, data=replace(before.data, root="-"))
        now = replace(now, data=replace(now.data, root="-"))
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
