"""Lightning's checkpoints, written whole or not at all."""

import io
from typing import Any

import torch
from lightning_fabric.plugins import TorchCheckpointIO
from lightning_fabric.utilities.types import _PATH

from lss_core.files import write_atomically


class WholeCheckpoints(TorchCheckpointIO):
    """Written beside the old one, which it replaces when it is on disk.

    Lightning writes in the system's folder for temporary files and moves: onto another disk that is
    a copy, which a kill or a full disk can cut short.
    """

    def save_checkpoint(
        self, checkpoint: dict[str, Any], path: _PATH, storage_options: Any | None = None
    ) -> None:
        """Write it.

        Raises:
            OSError: If it cannot be written; an older one of the name is as it was.
        """
        whole = io.BytesIO()
        torch.save(checkpoint, whole)
        with write_atomically(str(path)) as stream:
            stream.write(whole.getbuffer())
