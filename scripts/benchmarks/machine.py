"""What this machine can do at best: the floor under every time."""

import os
import platform
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import torch

_MOMENT_S = 0.1


@dataclass(frozen=True)
class Machine:
    """Name and measured limits of this machine.

    Attributes:
        name: Of its processor, with its units.
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


def _product_flops(dtype: torch.dtype) -> float:
    """Of the largest product that takes no longer than a moment: a type without units is slow."""
    size = 512
    while True:
        left, right = torch.ones(size, size, dtype=dtype), torch.ones(size, size, dtype=dtype)
        best_s = _best_s(partial(torch.matmul, left, right))
        if size == 4096 or best_s > _MOMENT_S:
            return 2 * size**3 / best_s
        size *= 2


def _best_s(function: object, repeats: int = 4) -> float:
    best_s = float("inf")
    for _ in range(repeats):
        started = time.perf_counter()
        function()  # type: ignore[operator]
        best_s = min(best_s, time.perf_counter() - started)
    return best_s


def processor_name() -> str:
    """Name of the processor, and the units that torch may use of it."""
    cpuinfo = Path("/proc/cpuinfo")
    lines = cpuinfo.read_text().splitlines() if cpuinfo.exists() else []
    names = [line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")]
    flags = next((line.split() for line in lines if line.startswith("flags")), [])
    return f"{names[0] if names else platform.processor()} ({processor_units(flags, os.environ)})"


def processor_units(flags: Sequence[str], environment: Mapping[str, str]) -> str:
    """The widest vector units, those for bfloat16, and what the environment forbids torch to use.

    Args:
        flags: Of the processor, as Linux calls them.
        environment: Of this process.
    """
    known = {
        "avx2": "AVX2",
        "avx512f": "AVX-512",
        "avx512_bf16": "bfloat16 products",
        "amx_bf16": "bfloat16 matrix units",
    }
    found = [name for flag, name in known.items() if flag in flags]
    wide = found[1:] if "avx512f" in flags else found
    limits = [
        f"{name}={environment[name]}"
        for name in ("ONEDNN_MAX_CPU_ISA", "ATEN_CPU_CAPABILITY")
        if environment.get(name)
    ]
    units = ", ".join(wide) or "units not known"
    return f"{units}, held to {' '.join(limits)}" if limits else units
