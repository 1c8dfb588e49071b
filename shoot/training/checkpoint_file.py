"""Files of weights: written whole or not at all, read without running what they hold."""

import io
import zipfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import safetensors
import safetensors.torch
import torch
from lightning_fabric.plugins import TorchCheckpointIO
from lightning_fabric.utilities.types import _PATH
from torch import Tensor

from lss_core.errors import DataError
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


def read_checkpoint(path: Path) -> dict[str, Any]:
    """A checkpoint of a training run.

    Raises:
        DataError: If there is none, it is damaged, packed, or holds other things than weights and
            plain values.
    """
    if not path.is_file():
        raise DataError(f"There is no checkpoint '{path}'; has the run come to a validation yet?")
    try:
        # torch stores as it is; what unpacks to more than its file can fill the memory.
        with zipfile.ZipFile(path) as archive:
            if any(entry.compress_type != zipfile.ZIP_STORED for entry in archive.infolist()):
                raise ValueError("packed")
        loaded = torch.load(path, map_location="cpu", weights_only=True)
        if not isinstance(loaded, dict):
            raise TypeError("other things than weights")
        return {**loaded, "state_dict": _tensors(loaded)}
    except Exception as error:
        # torch's own words tell how to trust the file all the same.
        raise DataError(
            f"'{path}' is damaged or holds other things than weights ({type(error).__name__}); "
            "train again, or restore it."
        ) from error


def write_weights(path: Path, state_dict: dict[str, Tensor], marks: Mapping[str, str]) -> None:
    """Write weights alone, as safetensors, with the marks of what they belong to."""
    tensors = {name: tensor.detach().cpu().contiguous() for name, tensor in state_dict.items()}
    with write_atomically(path) as stream:
        stream.write(safetensors.torch.save(tensors, dict(marks)))


def read_weights(path: Path) -> dict[str, Any]:
    """What `write_weights` wrote, with the keys of a checkpoint.

    Raises:
        DataError: If the file is no such one.
    """
    try:
        with safetensors.safe_open(path, framework="pt") as stored:
            tensors = {name: stored.get_tensor(name) for name in stored.keys()}  # noqa: SIM118
            return {**(stored.metadata() or {}), "state_dict": tensors}
    except (OSError, ValueError, safetensors.SafetensorError) as error:
        raise DataError(
            f"'{path}' holds no weights ({error}); train again, or restore it."
        ) from error


def _tensors(loaded: dict[str, Any]) -> dict[str, Tensor]:
    tensors = loaded["state_dict"]
    if not all(isinstance(tensor, Tensor) for tensor in dict(tensors).values()):
        raise TypeError("other things than tensors")
    return dict(tensors)
