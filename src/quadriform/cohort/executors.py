"""Pools of workers: processes of this machine, dask.distributed, or an executor of the caller."""

import logging
import multiprocessing
import os
import signal
import threading
import time
from collections.abc import Iterator
from concurrent.futures import Executor, ProcessPoolExecutor
from contextlib import contextmanager
from typing import Any

from quadriform.cohort.scheduling import WorkerPool
from quadriform.errors import InputError

LOCAL = "127.0.0.1:0"
"""Address of the status page of a local cluster: any free port, for this machine only."""
DASK_SETTINGS = {
    "distributed.nanny.pre-spawn-environ.MALLOC_TRIM_THRESHOLD_": 1 << 30,
    "distributed.nanny.pre-spawn-environ.MALLOC_MMAP_THRESHOLD_": 1 << 30,
    "distributed.worker.profile.enabled": False,
}
"""Workers keep freed memory, because the next fit uses as much (by default dask returns every array at once, which is
slow), and are not sampled by a profiler."""
REFRESH = 10.0
"""Seconds after which the number of workers of a cluster is requested again."""


class _Processes(ProcessPoolExecutor):
    """Processes of this machine, all started before the first task.

    By default `submit` starts one when none is idle. The thread that watches the processes does not know this one yet:
    if it dies, its task never completes; if another one dies, Python 3.11 neither ends the new one nor stops
    waiting for it (python/cpython#109810).
    """

    def __init__(self, workers: int) -> None:
        spawn = multiprocessing.get_context("spawn")  # a fork would copy locks that threads have taken
        super().__init__(workers, mp_context=spawn, initializer=_initialise_worker)
        self._safe_to_dynamically_spawn_children = False

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """Wait for the processes; kill them where the thread that ends them never started, or failed.

        It may fail where a task is submitted just when the pool breaks.
        """
        if self._broken or self._executor_manager_thread is None:
            for process in list((self._processes or {}).values()):
                process.kill()
        super().shutdown(wait, cancel_futures=cancel_futures)


class _ProcessPool(WorkerPool):
    """Processes of this machine, replaced when one of them dies."""

    def __init__(self, workers: int) -> None:
        super().__init__(_Processes(workers), workers)

    def restart(self) -> None:
        """End the processes that are left and start as many anew."""
        self.executor.shutdown(wait=True, cancel_futures=True)
        self.executor = _Processes(self.workers)


class _DaskCluster(WorkerPool):
    """Workers of dask.distributed; their number may change. A task whose worker died is resubmitted by dask."""

    gone = "the cluster is gone; resume the run with another"

    def __init__(self, client: Any) -> None:
        super().__init__(client.get_executor(pure=False), 1)
        self.client, self._requested = client, -REFRESH

    def max_pending(self) -> int:
        """How many tasks may wait at once, by the workers that the cluster has now."""
        if time.monotonic() - self._requested > REFRESH:
            self.workers, self._requested = max(1, sum(self.client.nthreads().values())), time.monotonic()
        return super().max_pending()


def _initialise_worker() -> None:
    """One thread a worker; interrupts are handled by the parent; the worker ends with its parent."""
    os.environ["OMP_NUM_THREADS"] = "1"
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    parent = multiprocessing.parent_process()
    if parent is not None:
        threading.Thread(target=_end_with, args=(parent,), daemon=True).start()


def _end_with(parent: Any) -> None:
    parent.join()
    os._exit(1)


@contextmanager
def from_executor(executor: Executor, workers: int) -> Iterator[WorkerPool]:
    """Return a pool over any executor with this number of workers; it is not shut down."""
    yield WorkerPool(executor, workers)


@contextmanager
def processes(workers: int) -> Iterator[WorkerPool]:
    """Return a pool of processes of this machine."""
    pool = _ProcessPool(workers)
    try:
        yield pool
    finally:
        pool.executor.shutdown(wait=True, cancel_futures=True)


@contextmanager
def cluster(address: str | None, workers: int) -> Iterator[WorkerPool]:
    """Return a cluster of dask.distributed: the one at an address, or a local one of this number of workers.

    Raises:
        InputError: there is no scheduler at the address.
    """
    import dask
    from distributed import Client, LocalCluster

    if address is None:
        local = {"n_workers": workers, "threads_per_worker": 1, "dashboard_address": LOCAL}
        with (
            dask.config.set(DASK_SETTINGS),
            LocalCluster(**local, silence_logs=logging.ERROR) as started,
            Client(started) as client,
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
