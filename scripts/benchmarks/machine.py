"""What this machine can do at best: the floor under every time."""

import os
import platform
import time
from dataclasses import dataclass
from pathlib import Path

import torch


@dataclass(frozen=True)
class Machine:
    """Name and measured limits of this machine.

    Attributes:
        name: Of its processor.
        cores: Cores this process may use.
        float32_flops: Operations per second of a large float32 matrix product.
        bfloat16_flops: The same in bfloat16.
        copied_bytes_s: Bytes read and written per second by copying a large tensor.
        versions: Python and torch.
    """

    name: str
    cores: int
    float32_flops: float
    bfloat16_flops: float
    copied_bytes_s: float
    versions: str

    @property
    def best_flops(self) -> float:
        """Operations per second in whichever precision is faster here."""
        return max(self.float32_flops, self.bfloat16_flops)


def measure() -> Machine:
    """Try it; takes some seconds."""
    source, target = torch.ones(2**26), torch.zeros(2**26)
    return Machine(
        name=processor_name(),
        cores=len(os.sched_getaffinity(0)),
        float32_flops=_product_flops(torch.float32),
        bfloat16_flops=_product_flops(torch.bfloat16),
        copied_bytes_s=2 * source.nbytes / _best_s(lambda: target.copy_(source)),
        versions=f"Python {platform.python_version()}, torch {torch.__version__}",
    )


def _product_flops(dtype: torch.dtype, size: int = 4096) -> float:
    left, right = torch.ones(size, size, dtype=dtype), torch.ones(size, size, dtype=dtype)
    return 2 * size**3 / _best_s(lambda: left @ right)


def _best_s(function: object, repeats: int = 4) -> float:
    best_s = float("inf")
    for _ in range(repeats):
        started = time.perf_counter()
        function()  # type: ignore[operator]
        best_s = min(best_s, time.perf_counter() - started)
    return best_s


def processor_name() -> str:
    """Name of the processor, and whether it has matrix units."""
    cpuinfo = Path("/proc/cpuinfo")
    lines = cpuinfo.read_text().splitlines() if cpuinfo.exists() else []
    names = [line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")]
    matrix_units = any("amx_bf16" in line for line in lines if line.startswith("flags"))
    name = names[0] if names else platform.processor()
    return name + (" with bfloat16 matrix units" if matrix_units else "")
