"""What all commands share: parse, run, and say in one sentence what the user can mend."""

import contextlib
import errno
import io
import logging
import os
import signal
import sys
import warnings
from collections.abc import Callable
from typing import NoReturn, TypeVar

import torch
import torch.distributed as dist
import tyro
from rich.logging import RichHandler

from lss_core.bounds import SettingError
from lss_core.errors import DataError
from shoot.jobs.lost_processes import lost_process

Config = TypeVar("Config")

# What may be asked of any command that reads data.
_SHORT = {"--skip-bad": "--data.skip-bad"}
_MAKE_ROOM = "make room there, then call the command again"
_REMEDIES = {
    errno.ENOSPC: _MAKE_ROOM,
    errno.EDQUOT: _MAKE_ROOM,
    errno.EFBIG: "raise the limit for the size of files (ulimit -f), then call the command again",
    errno.EROFS: "name a place that can be written, or have this one mounted for writing",
    errno.EEXIST: "it is no folder; name another place",  # only ever met in making folders
    errno.EACCES: "change its permissions, or name another place",
}


def run(
    config_type: type[Config] | Callable[..., Config],
    function: Callable[[Config], object],
    description: str,
) -> None:
    """Parse the command line into `config_type` and call `function` with it.

    A `DataError` becomes one sentence on standard error and exit status 2; so does a file that
    cannot be written, a helper process that was killed, and a wrong flag. Ctrl-C ends with status
    130, SIGTERM with 143.
    """
    logging.basicConfig(
        level=logging.INFO, format="%(message)s", handlers=[RichHandler(show_path=False)]
    )
    # Paths and texts of data may hold what an output cannot show.
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")
    # What Lightning says of itself and of its own code is not for users of these commands.
    logging.getLogger("pytorch_lightning").setLevel(logging.WARNING)
    warnings.filterwarnings("ignore", module=r"pytorch_lightning\.")
    # DDP on the weights of 1x1 convolutions, whose two memory formats are one and the same.
    warnings.filterwarnings("ignore", message="Grad strides do not match bucket view strides")
    # So that what is half done is cleared away, as on Ctrl-C.
    before = signal.signal(signal.SIGTERM, lambda number, _: sys.exit(128 + number))
    try:
        function(_parse(config_type, description))
    except DataError as error:
        _end(error.sentence)
    except OSError as error:
        remedy = _REMEDIES.get(error.errno or 0)
        if error.filename is None and remedy is None:
            raise
        where = "Standard output or a file" if error.filename is None else f"'{error.filename}'"
        _end(f"{where}: {error.strerror}{f'; {remedy}' if remedy else ''}.")
    except (RuntimeError, MemoryError) as error:
        sentence = _out_of_memory(error) or lost_process(error)
        if sentence is None:
            raise
        _end(sentence)
    except KeyboardInterrupt:
        print("Interrupted.", file=sys.stderr)
        sys.exit(130)
    finally:
        signal.signal(signal.SIGTERM, before)


def _parse(config_type: type[Config] | Callable[..., Config], description: str) -> Config:
    """The settings that the command line names; ends if it cannot be read, or they cannot be."""
    args = [_SHORT.get(argument, argument) for argument in sys.argv[1:]]
    try:
        # In silence: of a setting that is refused the sentence is enough.
        with contextlib.redirect_stderr(io.StringIO()):
            return tyro.cli(config_type, args=args, description=description)
    except SettingError as error:  # older tyros let it pass
        _end(f"{error}")
    except SystemExit as ended:
        if not ended.code:  # as after --help
            raise
        cause: BaseException | None = ended
        while cause is not None:
            if isinstance(cause, SettingError):
                _end(f"{cause}")
            cause = cause.__context__
    return tyro.cli(config_type, args=args, description=description)


def _out_of_memory(error: RuntimeError | MemoryError) -> str | None:
    """What to do if that is what it is: of a CPU's memory PyTorch says so in a RuntimeError."""
    is_it = isinstance(error, MemoryError | torch.OutOfMemoryError)
    if not is_it and "DefaultCPUAllocator" not in str(error):
        return None
    return "The memory is too small for this; choose a smaller batch, image, grid or network."


def _end(sentence: str) -> NoReturn:
    """Say it, unless this is one of several processes that all have come to the same end."""
    if dist.is_initialized() or os.environ.get("RANK", "0") == "0":
        print(f"error: {' '.join(sentence.split())}", file=sys.stderr, flush=True)
    sys.exit(2)
