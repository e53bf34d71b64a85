"""Units of work over any executor: a bounded number on the way, and none lost when a worker dies."""

from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, Executor, Future, wait
from itertools import islice
from typing import Protocol, TypeVar

T = TypeVar("T")
R = TypeVar("R")


class WorkerPool(Protocol):
    """Who does the work.

    Attributes:
        executor: to which units are given.
    """

    executor: Executor

    def max_pending(self) -> int:
        """How many units to have on the way: enough that no worker waits, few enough for memory."""

    def restart(self) -> None:
        """A fresh executor in place of one that broke.

        Raises:
            BrokenExecutor: there is none to be had.
        """


def completed(tasks: Iterable[T], work: Callable[[T], R], engine: WorkerPool) -> Iterator[tuple[T, R | BaseException]]:
    """Each task with its result, or with the error of the engine, as they are ready.

    Args:
        tasks: taken one by one, as there is room.
        work: a function of a module, that workers can find by its name.
        engine: who does it.
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
    """Give out tasks while there is room; those that a broken executor refuses come back."""
    for task in islice(source, max(0, engine.max_pending() - len(waiting))):
        try:
            waiting[engine.executor.submit(work, task)] = task
        except BrokenExecutor:
            return [task]
    return []


def _one_by_one(suspects: list[T], work: Callable[[T], R], engine: WorkerPool) -> Iterator[tuple[T, R | BaseException]]:
    """Units that were on the way when a worker died, each alone: the one that kills its worker again is the culprit."""
    for task in suspects:
        try:
            yield task, engine.executor.submit(work, task).result()
        except BrokenExecutor as error:
            engine.restart()
            yield task, error
        except Exception as error:
            yield task, error
