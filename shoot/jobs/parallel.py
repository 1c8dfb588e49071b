"""Runs a function over jobs: in this process, in several, or on the machines of a dask cluster."""

import asyncio
import logging
import os
import socket
import tempfile
import threading
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future, ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from multiprocessing import get_context, parent_process
from multiprocessing.connection import wait
from pathlib import Path
from typing import Any, TypeVar

from lss_core.errors import DataError

Job = TypeVar("Job")
Result = TypeVar("Result")

_PATIENCE_S = 5.0


def run_jobs(
    function: Callable[[Job], Result],
    jobs: Sequence[Job],
    workers: int = 1,
    dask: str | None = None,
    shared: Path | None = None,
) -> Iterator[Result]:
    """Results as jobs finish, in any order.

    Args:
        function: At the top level of a module (or a `partial` of such a one), so that other
            processes find it.
        jobs: Its arguments.
        workers: Processes here; with one, jobs run in this process and in order.
        dask: Address of a dask scheduler, whose workers then do the jobs instead.
        shared: Folder that the jobs read or write; all workers of a cluster must see it.

    Raises:
        DataError: If the cluster cannot be used, or a process here was ended from outside. What a
            job raises is raised here.
    """
    if dask is not None:
        yield from _run_on_cluster(function, jobs, dask, shared)
    elif workers == 1 or len(jobs) <= 1:
        yield from map(function, jobs)
    else:
        yield from _run_here(function, jobs, workers)


def _run_here(
    function: Callable[[Job], Result], jobs: Sequence[Job], workers: int
) -> Iterator[Result]:
    # Not joblib's loky: its workers finish their job when the run is killed, beside the next run.
    # Spawned, not forked: a forked child inherits locks of threads that do not exist in it.
    with ProcessPoolExecutor(workers, get_context("spawn"), _end_with_parent) as pool:
        submitted = [pool.submit(function, job) for job in jobs]
        try:
            for done in as_completed(submitted):
                yield done.result()
        except BrokenProcessPool as error:
            raise DataError(
                "A worker process was ended from outside, as Linux does where memory runs out; "
                "call the command again, with fewer workers."
            ) from error
        finally:
            pool.shutdown(wait=True, cancel_futures=True)


def _end_with_parent() -> None:
    """Let a worker end when its run is killed: it would wait for ever or write into the next."""
    parent = parent_process()
    if parent is None:
        return
    sentinel = parent.sentinel

    def watch() -> None:
        wait([sentinel])
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()


def _run_on_cluster(
    function: Callable[[Job], Result], jobs: Sequence[Job], address: str, shared: Path | None
) -> Iterator[Result]:
    try:
        from distributed import CancelledError, Client, KilledWorker
        from distributed.comm import get_address_host_port
        from joblib import Parallel, delayed
        from joblib._dask import DaskDistributedBackend
    except ImportError as error:
        raise DataError(
            "--dask needs dask and distributed, which are not installed; install shoot with its "
            "extra 'cluster' (pip install 'shoot-planner[cluster]')."
        ) from error

    class Cluster(DaskDistributedBackend):  # type: ignore[misc]
        """joblib's, which waits for ever for a job that has failed outside of its function."""

        def submit(self, func: Any, callback: Any = None) -> Any:
            future = super().submit(func, callback)
            future.add_done_callback(lambda done: done.exception() and callback(done))
            return future

        def retrieve_result_callback(self, out: Any) -> Any:
            failed = isinstance(out, Future)
            return out.result() if failed else super().retrieve_result_callback(out)

    for name in ("distributed", "distributed.client"):  # what matters is said in one sentence
        logging.getLogger(name).setLevel(logging.CRITICAL)
    try:
        # A client that has never been connected takes long to give up, and complains when it ends.
        socket.create_connection(get_address_host_port(address), _PATIENCE_S).close()
        client = Client(address, timeout=_PATIENCE_S, set_as_default=False)
    except Exception as error:  # something else may listen there, and answer anything
        raise DataError(
            f"No dask scheduler answers at '{address}'; start one with 'dask scheduler', and give "
            "the address it prints (--dask)."
        ) from error
    with client:
        _check_workers(client, address, shared)
        # One job at a time: they take seconds or minutes, and each is progress to be shown.
        parallel = Parallel(
            backend=Cluster(client=client), batch_size=1, return_as="generator_unordered"
        )
        try:
            yield from parallel(delayed(function)(job) for job in jobs)
        except (KilledWorker, CancelledError) as error:
            raise DataError(
                f"The cluster at '{address}' has lost its scheduler, or several workers that tried "
                f"the same job ({error}); see their logs, and call the command again."
            ) from error


def _check_workers(client: Any, address: str, shared: Path | None) -> None:
    """Check that there are workers, that they have this package, and that they see a folder."""
    try:
        client.wait_for_workers(1, timeout=_PATIENCE_S)
    except (TimeoutError, asyncio.TimeoutError) as error:  # one and the same from Python 3.11 on
        raise DataError(
            f"The dask scheduler at '{address}' has no workers; start some with "
            f"'dask worker {address} --nthreads 1'."
        ) from error
    with tempfile.NamedTemporaryFile(prefix=".cluster-", dir=shared) as probe:
        try:
            sees = client.run(_sees, probe.name, on_error="return")
        except Exception as error:
            sees = {address: error}
    for worker, answer in sees.items():
        if isinstance(answer, Exception):
            raise DataError(
                f"The dask worker {worker} cannot run this version of shoot ({answer}); install "
                "the same one on all machines."
            ) from answer
        if shared is not None and not answer:
            raise DataError(
                f"The dask worker {worker} does not see '{shared}'; all machines must have this "
                "folder under this name, as on a shared disk."
            )


def _sees(path: str) -> bool:
    return Path(path).exists()
