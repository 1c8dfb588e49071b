"""A function of tensors on a GPU as CUDA graphs: the host starts all its work by one call."""

import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass

import torch
from torch import Tensor

# Calls before recording: the first ones compile, choose algorithms and set libraries up.
_WARM_UP = 3


class CannotRecordError(RuntimeError):
    """A function runs, but its work on the GPU cannot be recorded."""


class CudaGraphs:
    """A function recorded at the first call with tensors of new shapes, and replayed from then on.

    Many small kernels take a GPU less time than the host takes to start them one by one. A
    recording reads its arguments from buffers of its own, which each call fills.

    Args:
        function: Of tensors on one GPU, with sizes that follow from theirs alone. It must not have
            the host wait. What else it reads, such as weights, must stay where it is.
    """

    def __init__(self, function: Callable[..., Tensor]) -> None:
        self._function = function
        self._recordings: dict[tuple[tuple[torch.Size, torch.dtype], ...], _Recording] = {}

    @torch.no_grad()
    def __call__(self, *arguments: Tensor) -> Tensor:
        """What the function gives, in memory of the caller's own; no gradients.

        Raises:
            CannotRecordError: At the first call with these shapes.
        """
        kind = tuple((argument.shape, argument.dtype) for argument in arguments)
        with torch.cuda.device(arguments[0].device):
            if kind not in self._recordings:
                self._recordings[kind] = _record(self._function, arguments)
            recording = self._recordings[kind]
            for buffer, argument in zip(recording.arguments, arguments, strict=True):
                buffer.copy_(argument)
            recording.graph.replay()
            return recording.result.clone()


@dataclass(frozen=True)
class _Recording:
    graph: torch.cuda.CUDAGraph
    arguments: tuple[Tensor, ...]
    result: Tensor


def _record(function: Callable[..., Tensor], arguments: tuple[Tensor, ...]) -> _Recording:
    """Warm up beside the current stream, as libraries want it, then record."""
    buffers = tuple(argument.clone() for argument in arguments)
    current = torch.cuda.current_stream()
    beside = torch.cuda.Stream()  # type: ignore[no-untyped-call]
    graph = torch.cuda.CUDAGraph()
    chose_before = torch.backends.cudnn.benchmark
    torch.backends.cudnn.benchmark = True  # shapes do not change: try which algorithms are fastest
    try:
        beside.wait_stream(current)
        with torch.cuda.stream(beside):
            for _ in range(_WARM_UP):
                function(*buffers)
        try:
            # A recording that breaks off leaves traces, so look first.
            with torch.cuda.stream(beside), _waiting_refused():
                function(*buffers)
            current.wait_stream(beside)
            # Other threads, such as those that load data, may go on using the GPU.
            with torch.cuda.graph(graph, capture_error_mode="thread_local"):
                result = function(*buffers)
        except RuntimeError as error:
            torch.cuda.set_stream(current)
            raise CannotRecordError(str(error)) from error
    finally:
        torch.backends.cudnn.benchmark = chose_before
    return _Recording(graph, buffers, result)


@contextmanager
def _waiting_refused() -> Iterator[None]:
    """A RuntimeError where the host would wait for the GPU."""
    before = torch.cuda.get_sync_debug_mode()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # that the mode is new and may miss something
        torch.cuda.set_sync_debug_mode("error")
    try:
        yield
    finally:
        torch.cuda.set_sync_debug_mode(before)
