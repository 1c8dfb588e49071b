"""What torch's compiler keeps on disk, kept apart for each kind of processor."""

import hashlib
import os
import platform
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import torch._inductor.config
import torch.compiler.config

# What forbids PyTorch, or the library of its convolutions, to use a processor's units.
_LIMITS = ("ONEDNN_MAX_CPU_ISA", "DNNL_MAX_CPU_ISA", "ATEN_CPU_CAPABILITY")


@contextmanager
def frozen_weights() -> Iterator[None]:
    """What is compiled within takes weights as constants.

    They are packed as the processor's units want them, and kept so: on disk, where torch finds them
    again without asking what they were packed for. A home that several machines share, or a limit
    set in the environment, would then give numbers that mean nothing.
    """
    config = torch.compiler.config
    with torch._inductor.config.patch(freezing=True):
        if hasattr(config, "cache_key_tag"):
            tag = f"{config.cache_key_tag} {processor_tag()}"
            with config.patch(cache_key_tag=tag):  # type: ignore[attr-defined]
                yield
        else:  # before torch 2.7
            with torch._inductor.config.patch(fx_graph_cache=False):
                yield


def processor_tag() -> str:
    """A name for the units of this processor that PyTorch may use."""
    cpuinfo = Path("/proc/cpuinfo")
    lines = cpuinfo.read_text().splitlines() if cpuinfo.exists() else []
    units = next((line for line in lines if line.startswith(("flags", "Features"))), "")
    limits = [f"{name}={os.environ.get(name, '')}" for name in _LIMITS]
    told = "\n".join([platform.machine(), units, *limits])
    return hashlib.sha256(told.encode()).hexdigest()[:16]
