"""Where commands compute: a CUDA GPU if there is one, else the CPU."""

from typing import Literal

import torch

from lss_core.errors import DataError

Accelerator = Literal["auto", "cpu", "gpu", "cuda"]


def choose_device(accelerator: Accelerator = "auto") -> torch.device:
    """The device to compute on.

    Apple's GPUs are never chosen, as libraries would: they have no float64, in which geometry is
    computed.

    Args:
        accelerator: `gpu` and `cuda` are the same; `auto` is it where there is one.

    Raises:
        DataError: If a GPU is asked for, and there is none.
    """
    has_gpu = torch.cuda.is_available()
    if accelerator in ("gpu", "cuda") and not has_gpu:
        raise DataError(
            "PyTorch finds no CUDA GPU here; use --accelerator cpu, or a PyTorch made for the GPU."
        )
    return torch.device("cuda" if has_gpu and accelerator != "cpu" else "cpu")
