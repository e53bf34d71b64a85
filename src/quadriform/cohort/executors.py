"""The engines: processes of this machine, dask.distributed, or whatever executor the caller has."""

import logging
import multiprocessing
import os
import signal
import threading
import time
from collections.abc import Iterator
from concurrent.futures import BrokenExecutor, Executor, ProcessPoolExecutor
from contextlib import contextmanager
from typing import Any

from quadriform.cohort.scheduling import WorkerPool
from quadriform.errors import InputError

AHEAD = 3
"""Units on the way for each worker: one at work, and the next ones at hand."""
LOCAL = "127.0.0.1:0"
"""Where a cluster of our own shows its status: any free port, and to this machine alone."""
BUSY = {
    "distributed.nanny.pre-spawn-environ.MALLOC_TRIM_THRESHOLD_": 1 << 30,
    "distributed.nanny.pre-spawn-environ.MALLOC_MMAP_THRESHOLD_": 1 << 30,
    "distributed.worker.profile.enabled": False,
}
"""Workers for fits: they keep freed memory, for the next fit needs as much (by dask's own settings they give every
array back at once, which takes its time), and nobody looks at them a hundred times a second."""
GLANCE = 10.0
"""Seconds after which the number of a cluster's workers is asked for again."""


def cores() -> int:
    """The cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


class _GivenExecutor:
    """An executor of the caller's."""

    def __init__(self, executor: Executor, workers: int) -> None:
        self.executor, self.workers = executor, workers

    def max_pending(self) -> int:
        return AHEAD * self.workers

    def restart(self) -> None:
        raise BrokenExecutor("the executor broke, and there is no other; resume the run")


class _ProcessPool:
    """Processes of this machine, begun anew when one of them dies."""

    def __init__(self, workers: int) -> None:
        self.workers = workers
        self.executor: Executor = self._begun()

    def _begun(self) -> Executor:
        fresh = multiprocessing.get_context("spawn")  # a fork would copy the threads' locks as they are
        return ProcessPoolExecutor(self.workers, mp_context=fresh, initializer=_in_a_worker)

    def max_pending(self) -> int:
        return AHEAD * self.workers

    def restart(self) -> None:
        self.executor.shutdown(wait=True, cancel_futures=True)
        self.executor = self._begun()


class _DaskCluster:
    """Workers of dask.distributed; their number may change. A unit whose worker died is resubmitted by dask."""

    def __init__(self, client: Any) -> None:
        self.client = client
        self.executor: Executor = client.get_executor(pure=False)
        self._workers, self._asked = 1, -GLANCE

    def max_pending(self) -> int:
        if time.monotonic() - self._asked > GLANCE:
            self._workers, self._asked = max(1, sum(self.client.nthreads().values())), time.monotonic()
        return AHEAD * self._workers

    def restart(self) -> None:
        raise BrokenExecutor("the cluster is gone; resume the run with another")


def _in_a_worker() -> None:
    """One thread a worker; an interrupt is for the driver; and no worker outlives it."""
    os.environ["OMP_NUM_THREADS"] = "1"
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    parent = multiprocessing.parent_process()
    if parent is not None:
        threading.Thread(target=_die_with, args=(parent,), daemon=True).start()


def _die_with(parent: Any) -> None:
    parent.join()
    os._exit(1)


@contextmanager
def from_executor(executor: Executor, workers: int) -> Iterator[WorkerPool]:
    """Any executor with so many workers; it stays open."""
    yield _GivenExecutor(executor, workers)


@contextmanager
def processes(workers: int) -> Iterator[WorkerPool]:
    """So many processes of this machine."""
    engine = _ProcessPool(workers)
    try:
        yield engine
    finally:
        engine.executor.shutdown(wait=True, cancel_futures=True)


@contextmanager
def cluster(address: str | None, workers: int) -> Iterator[WorkerPool]:
    """A cluster of dask.distributed: the one at an address, or a local one of so many workers.

    Raises:
        InputError: nobody answers at the address.
    """
    import dask
    from distributed import Client, LocalCluster

    if address is None:
        local = {"n_workers": workers, "threads_per_worker": 1, "dashboard_address": LOCAL}
        with (
            dask.config.set(BUSY),
            LocalCluster(**local, silence_logs=logging.ERROR) as begun,
            Client(begun) as client,
        ):
            yield _DaskCluster(client)
        return
    try:
        client = Client(address, timeout=30)
    except (OSError, TimeoutError, ValueError) as error:
        raise InputError(
            f"option --scheduler={address!r}: no scheduler of dask.distributed answers: {error}"
        ) from error
    with client:
        yield _DaskCluster(client)
