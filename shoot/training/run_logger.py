"""What Lightning asks of a logger and a run has no need of."""

from argparse import Namespace
from pathlib import Path
from typing import Any

from pytorch_lightning.loggers.logger import Logger
from pytorch_lightning.utilities import rank_zero_only


class RunLogger(Logger):
    """A logger that writes to one place of a run folder.

    Args:
        path: File or folder that it writes.
    """

    def __init__(self, path: Path) -> None:
        super().__init__()
        self.path = path

    @property
    def name(self) -> str:
        """Of its file or folder; Lightning asks."""
        return self.path.stem

    @property
    def version(self) -> str:
        """A run has one; Lightning asks."""
        return ""

    @rank_zero_only
    def log_hyperparams(self, params: dict[str, Any] | Namespace, *_: Any, **__: Any) -> None:
        """They stand in config.yaml."""
