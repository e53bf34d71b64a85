"""Tasks over any executor: a bounded number submitted at a time, and none lost when a worker dies."""

from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, Executor, Future, wait
from itertools import islice
from typing import TypeVar

T = TypeVar("T")
R = TypeVar("R")


PENDING = 3
"""Tasks submitted for each worker: one at work, and the next ones."""


class WorkerPool:
    """An executor and its capacity.

    Attributes:
        executor: to which tasks are submitted.
        workers: of it.
    """

    gone = "the executor is broken and cannot be replaced; resume the run"

    def __init__(self, executor: Executor, workers: int) -> None:
        """Take an executor of the caller, with this number of workers."""
        self.executor, self.workers = executor, workers

    def max_pending(self) -> int:
        """Return the number of tasks to have submitted: enough that no worker waits, few enough for memory."""
        return PENDING * self.workers

    def restart(self) -> None:
        """Replace a broken executor.

        Raises:
            BrokenExecutor: it cannot be replaced.
        """
        raise BrokenExecutor(self.gone)


def completed(tasks: Iterable[T], work: Callable[[T], R], engine: WorkerPool) -> Iterator[tuple[T, R | BaseException]]:
    """Return each task with its result, or with the error of the executor, in the order of completion.

    Args:
        tasks: read one by one when there is capacity.
        work: a function of a module, which workers import by its name.
        engine: the pool of workers.
    """
    source = iter(tasks)
    waiting: dict[Future[R], T] = {}
    while True:
        suspects = _fill(waiting, source, work, engine)
        if not waiting and not suspects:
            return
        done = wait(waiting, return_when=FIRST_COMPLETED).done if waiting else set()
        for future in done:
            task = waiting.pop(future)
            error = BrokenExecutor("cancelled") if future.cancelled() else future.exception()
            if isinstance(error, BrokenExecutor):
                suspects.append(task)
            else:
                yield task, future.result() if error is None else error
        if suspects:
            suspects += waiting.values()
            waiting.clear()
            engine.restart()
            yield from _one_by_one(suspects, work, engine)


def _fill(waiting: dict[Future[R], T], source: Iterator[T], work: Callable[[T], R], engine: WorkerPool) -> list[T]:
    """Submit tasks up to the capacity; returns those that a broken executor refuses."""
    for task in islice(source, max(0, engine.max_pending() - len(waiting))):
        try:
            waiting[_submitted(task, work, engine)] = task
        except BrokenExecutor:
            return [task]
    return []


def _submitted(task: T, work: Callable[[T], R], engine: WorkerPool) -> Future[R]:
    """Return the result to come.

    Raises:
        BrokenExecutor: the executor is broken, or breaks just now.
    """
    try:
        return engine.executor.submit(work, task)
    except OSError as error:  # a pool of processes that breaks closes the pipes of a worker that it starts
        raise BrokenExecutor("the executor broke while a task was submitted") from error


def _one_by_one(suspects: list[T], work: Callable[[T], R], engine: WorkerPool) -> Iterator[tuple[T, R | BaseException]]:
    """Tasks that were submitted when a worker died, each alone: one that ends its worker again is the cause."""
    for task in suspects:
        try:
            yield task, _submitted(task, work, engine).result()
        except BrokenExecutor as error:
            engine.restart()
            yield task, error
        except Exception as error:
            yield task, error
