"""Two ways to the same result, each in a process of its own, timed in turn; and their memory."""

import ctypes
import gc
import multiprocessing
import statistics
import time
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

Prepare = Callable[[], Callable[[], Any]]
"""Sets everything up and returns what is measured. At the top level of a module (or a partial of
such a function): another process calls it."""


@dataclass(frozen=True)
class Spread:
    """Median, least and greatest of the repeats."""

    median: float
    low: float
    high: float

    @staticmethod
    def of(values: Sequence[float]) -> "Spread":
        """The spread of some values."""
        return Spread(statistics.median(values), min(values), max(values))


@dataclass(frozen=True)
class Pair:
    """What came out of timing a plain and a fast side in turn.

    Attributes:
        plain_s: Seconds a call.
        fast_s: Seconds a call.
        ratio: Plain over fast, of calls that followed each other.
        plain_mb: Most memory a call takes beyond what stood before it, in 10^6 bytes.
        fast_mb: The same of the fast side.
    """

    plain_s: Spread
    fast_s: Spread
    ratio: Spread
    plain_mb: float
    fast_mb: float


class Side:
    """One way to a result, in a process of its own that stays until `close`."""

    def __init__(self, prepare: Prepare) -> None:
        self._pool = ProcessPoolExecutor(1, multiprocessing.get_context("spawn"))
        self._pool.submit(_prepare, prepare).result()

    def seconds(self, calls: int = 1) -> float:
        """Mean time of some calls."""
        return self._pool.submit(_seconds, calls).result()

    def peak_mb(self) -> float:
        """Most memory (resident, 10^6 bytes) one call takes beyond what stood before it."""
        return self._pool.submit(_peak_mb).result()

    def result(self) -> Any:
        """What a call returns."""
        return self._pool.submit(_result).result()

    def close(self) -> None:
        """End the process."""
        self._pool.shutdown()


def compare(
    plain: Prepare, fast: Prepare, repeats: int = 7, plain_calls: int = 1, fast_calls: int = 1
) -> Pair:
    """Time two sides in turn, then measure the memory of each.

    Args:
        plain: Our straightforward code.
        fast: What users get.
        repeats: How often both are timed; one more call of each warms up.
        plain_calls: Calls of the plain side per repeat, of which the mean counts: for short ones.
        fast_calls: The same of the fast side.
    """
    sides = Side(plain), Side(fast)
    try:
        for side in sides:
            side.seconds()
        plain_s, fast_s = [], []
        for _ in range(repeats):
            plain_s.append(sides[0].seconds(plain_calls))
            fast_s.append(sides[1].seconds(fast_calls))
        peaks_mb = [side.peak_mb() for side in sides]
    finally:
        for side in sides:
            side.close()
    return Pair(
        Spread.of(plain_s),
        Spread.of(fast_s),
        Spread.of([p / f for p, f in zip(plain_s, fast_s, strict=True)]),
        *peaks_mb,
    )


def seconds(function: Callable[[], Any], calls: int = 1) -> float:
    """Mean time of some calls."""
    started = time.perf_counter()
    for _ in range(calls):
        function()
    return (time.perf_counter() - started) / calls


def measured(once: Callable[[], Any]) -> tuple[float, float]:
    """Seconds that one call takes in a new process, and the most memory of it (10^6 bytes).

    For what is done once in a process's life; imports count for memory, not for time.
    """
    with ProcessPoolExecutor(1, multiprocessing.get_context("spawn")) as pool:
        return pool.submit(_measured, once).result()


def _measured(once: Callable[[], Any]) -> tuple[float, float]:
    started = time.perf_counter()
    once()
    return time.perf_counter() - started, _status_mb("VmHWM")


_run: Callable[[], Any] = lambda: None  # noqa: E731  (the one this process was prepared for)


def _prepare(prepare: Prepare) -> None:
    global _run
    _run = prepare()


def _seconds(calls: int) -> float:
    return seconds(_run, calls)


def _result() -> Any:
    return _run()


def _peak_mb() -> float:
    gc.collect()
    ctypes.CDLL(None).malloc_trim(0)
    Path("/proc/self/clear_refs").write_text("5")  # forget the peak so far
    before = _status_mb("VmRSS")
    _run()
    return _status_mb("VmHWM") - before


def _status_mb(field: str) -> float:
    """A memory field of this process; Linux gives it in units of 1024 bytes."""
    for line in Path("/proc/self/status").read_text().splitlines():
        if line.startswith(field + ":"):
            return int(line.split()[1]) * 1024 / 1e6
    raise RuntimeError(f"/proc/self/status has no {field}")
