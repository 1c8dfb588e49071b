"""How far long work is: a bar on a terminal, a line now and then where output goes to a file."""

import logging
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from rich import get_console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

logger = logging.getLogger(__name__)

SAY_EVERY_S = 60.0


def on_terminal() -> bool:
    """Whether somebody looks on, so that a bar can be redrawn."""
    return get_console().is_terminal


@contextmanager
def progress(
    what: str, total: int, done: int = 0, is_passing: bool = False
) -> Iterator[Callable[[int], None]]:
    """Yields a function that is told how many more of `total` pieces are done.

    Args:
        what: The pieces, as "Scenes".
        total: How many there are.
        done: How many were done before.
        is_passing: Take the bar away at the end.
    """
    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TimeRemainingColumn(),
    )
    with Progress(*columns, transient=is_passing, disable=not on_terminal()) as bar:
        task = bar.add_task(what, total=total, completed=done)
        said_s = time.monotonic()

        def advance(count: int) -> None:
            nonlocal done, said_s
            done += count
            bar.advance(task, count)
            if not on_terminal() and time.monotonic() - said_s >= SAY_EVERY_S:
                logger.info("%s: %d of %d", what, done, total)
                said_s = time.monotonic()

        yield advance
