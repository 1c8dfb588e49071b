"""Files of weights: written whole or not at all, read without running what they hold."""

import zipfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import safetensors
import safetensors.torch
import torch
from torch import Tensor

from lss_core.errors import DataError
from lss_core.files import write_atomically

CHECKPOINTS = "checkpoints"
WEIGHTS_FILE = "weights.safetensors"


def read_run_weights(folder: Path, which: str) -> dict[str, Any]:
    """Weights of a run under `state_dict` and what they belong to.

    Where there are no checkpoints, the `last` ones are those of `weights.safetensors`: config, what
    the task adds and this file are all that a run needs to be given to others.

    Args:
        folder: The run folder.
        which: `last` or `best`.

    Raises:
        DataError: If there are none, or they are damaged.
    """
    checkpoint, alone = folder / CHECKPOINTS / f"{which}.ckpt", folder / WEIGHTS_FILE
    if which == "last" and not checkpoint.exists() and alone.exists():
        return read_weights(alone)
    return read_checkpoint(checkpoint)


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
