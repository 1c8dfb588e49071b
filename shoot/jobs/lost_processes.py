"""Helpers that were ended from outside: what torch says of it, in one sentence."""

import sys
from types import TracebackType

import torch.distributed as dist

# How gloo and NCCL begin what they say when the other side is gone.
_OF_CONNECTIONS = (
    "gloo/transport",
    "NCCL",
    "Connection closed by peer",
    "Connection reset by peer",
)


def lost_process(error: RuntimeError | MemoryError) -> str | None:
    """What has been lost, and what to do; None for other errors.

    Such errors may come out of any line: torch raises them where its main process happens to be.
    """
    text = str(error)
    if "DataLoader worker" in text:
        return (
            "A process that loads images or sweeps was ended from outside, as happens when memory "
            "runs out; use fewer (--num-workers). A training goes on from its last checkpoint "
            "with --resume."
        )
    if isinstance(error, dist.DistError) or any(words in text for words in _OF_CONNECTIONS):
        return (
            "Another process of this run has ended or cannot be reached any more; its own output "
            "says why, unless it was killed. --resume goes on from the last checkpoint."
        )
    return None


def quiet_loader(_worker: int) -> None:
    """For `DataLoader(worker_init_fn=)`: a worker whose reader is gone ends without a traceback.

    A worker hands its tensors over in a thread, which tells `sys.excepthook` where the reading
    process ended meanwhile. That process has said in a sentence why it ended.
    """
    usual = sys.excepthook

    def hook(kind: type[BaseException], error: BaseException, trace: TracebackType | None) -> None:
        if not issubclass(kind, ConnectionError | EOFError):
            usual(kind, error, trace)

    sys.excepthook = hook
