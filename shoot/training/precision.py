"""Which arithmetic this machine trains fastest in: found by trying, as names of CPUs mislead."""

import time
from typing import Literal

import torch
from torch.distributed.rendezvous import rendezvous

# Below this bfloat16 would cost digits and buy next to no time.
WORTH_IT = 1.3
_REPEATS = 3


def fastest_precision(device: torch.device) -> Literal["32-true", "bf16-mixed"]:
    """`bf16-mixed` where convolutions run clearly faster in bfloat16 than in float32.

    CPUs with matrix units are several times faster in it, others several times slower. Takes part
    of a second.

    Args:
        device: Where training will run.
    """
    if device.type == "cuda":
        return (
            "bf16-mixed" if torch.cuda.is_bf16_supported(including_emulation=False) else "32-true"
        )
    if device.type != "cpu":
        return "32-true"
    gain = _convolution_s(torch.float32) / _convolution_s(torch.bfloat16)
    return "bf16-mixed" if gain > WORTH_IT else "32-true"


def agreed_precision(device: torch.device) -> Literal["32-true", "bf16-mixed"]:
    """`fastest_precision` of the first process that torchrun has started, in each of them.

    They ask each other before Lightning connects them, which must be told the precision first.
    """
    store, rank, _ = next(rendezvous("env://"))
    if rank == 0:
        store.set("shoot/precision", fastest_precision(device))
    agreed = store.get("shoot/precision")  # waits for it
    return "bf16-mixed" if agreed == b"bf16-mixed" else "32-true"


@torch.enable_grad()  # prediction asks, too, and has it off
def _convolution_s(dtype: torch.dtype) -> float:
    """Seconds for a convolution forward and backward, the best of some."""
    layer = torch.nn.Conv2d(64, 64, 3, padding=1, dtype=dtype)
    images = torch.ones(8, 64, 40, 40, dtype=dtype).contiguous(memory_format=torch.channels_last)
    images.requires_grad_()
    best_s = float("inf")
    for _ in range(1 + _REPEATS):  # the first one also sets things up
        started = time.perf_counter()
        layer(images).sum().backward()
        best_s = min(best_s, time.perf_counter() - started)
    return best_s
