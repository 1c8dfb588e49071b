"""Finds what would make the host wait for a GPU, on machines without one."""

from collections.abc import Callable
from typing import Any

import torch
from torch import Tensor
from torch.utils._python_dispatch import TorchDispatchMode

aten = torch.ops.aten

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
