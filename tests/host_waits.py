"""Finds what would make the host wait for a GPU, on machines without one."""

from collections.abc import Callable
from typing import Any

import torch
from torch import Tensor
from torch.utils._python_dispatch import TorchDispatchMode

from lss_core.batch import Batch
from lss_core.config import DepthBins, ModelConfig
from lss_core.grid import BevGrid

aten = torch.ops.aten

# A planner that waits nowhere unless it is written so.
CONFIG = ModelConfig(
    backbone="plain-8-16-16",
    pretrained="none",
    context_channels=8,
    neck_channels=8,
    stem_channels=8,
    decoder_channels=8,
    depth=DepthBins(2.0, 6.0, 1.0),
    grid=BevGrid(-8.0, 8.0, -8.0, 8.0, 1.0),
)

# Results, or sizes of results, that the host must read.
_READS = {
    aten._local_scalar_dense.default,
    aten._linalg_check_errors.default,
    aten.nonzero.default,
    aten.bincount.default,
    aten.masked_select.default,
    aten._unique2.default,
    aten.repeat_interleave.Tensor,
}


class NoHostWaits(TorchDispatchMode):
    """Refuses what on a GPU would be a blocking copy, to either side.

    On the CPU it sees numbers that become tensors and results that are read; on the device `meta`,
    which holds no values, it sees tensors of other devices, too.
    """

    def __torch_dispatch__(
        self, func: Any, types: Any, args: Any = (), kwargs: dict[str, Any] | None = None
    ) -> Any:
        if func in _READS:
            raise AssertionError(f"{func} makes the host wait.")
        if func is aten.lift_fresh.default and args[0].dim() > 0:
            raise AssertionError("Numbers are copied to the device.")
        if func is aten.index.Tensor and any(
            i is not None and i.dtype == torch.bool for i in args[1]
        ):
            raise AssertionError("Indexing by a mask makes the host wait.")
        result = func(*args, **(kwargs or {}))
        if func is aten._to_copy.default and result.device != args[0].device:
            raise AssertionError(f"A tensor is moved from {args[0].device} to {result.device}.")
        _refuse_mixed_devices(func, args)
        return result


class NoMixedDevices(TorchDispatchMode):
    """Refuses functions of tensors of several devices, as a GPU does; one number may be anywhere.

    Some functions let the device `meta` pass.
    """

    def __torch_dispatch__(
        self, func: Any, types: Any, args: Any = (), kwargs: dict[str, Any] | None = None
    ) -> Any:
        _refuse_mixed_devices(func, args)
        return func(*args, **(kwargs or {}))


def _refuse_mixed_devices(func: Any, args: Any) -> None:
    devices = {t.device for t in args if isinstance(t, Tensor) and t.dim() > 0}
    if len(devices) > 1:
        raise AssertionError(f"{func} takes tensors of {devices}.")


def assert_no_host_wait(function: Callable[[], Any]) -> None:
    """Fail if a function has the host wait, forward or in backward passes that it calls itself."""
    with NoHostWaits():
        function()


def some_batch(num_samples: int = 2) -> Batch:
    intrinsics = torch.tensor([[40.0, 0.0, 31.5], [0.0, 40.0, 15.5], [0.0, 0.0, 1.0]])
    ahead = torch.tensor([[0.0, 0, 1, 0], [-1, 0, 0, 0], [0, -1, 0, 1.5], [0, 0, 0, 1]])
    random = torch.Generator().manual_seed(0)
    return Batch(
        images=torch.randint(
            0, 256, (num_samples, 2, 3, 32, 64), dtype=torch.uint8, generator=random
        ),
        pixel_from_camera=intrinsics.repeat(num_samples, 2, 1, 1),
        ego_from_camera=ahead.repeat(num_samples, 2, 1, 1),
        camera_mask=torch.ones(num_samples, 2, dtype=torch.bool),
        sample_idx=torch.arange(num_samples),
        points=torch.zeros(0, 5),
        point_counts=torch.zeros(num_samples, dtype=torch.long),
    )
