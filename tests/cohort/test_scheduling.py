"""Tasks over an executor: how many are submitted, and their results when workers die."""

from concurrent.futures import BrokenExecutor, Executor, Future, ThreadPoolExecutor

import pytest
from cohort_tasks import doubled

from quadriform.cohort.executors import from_executor, processes
from quadriform.cohort.scheduling import PENDING, completed


def test_every_task_returns_once_with_its_result_or_error():
    tasks = [task for task in range(40) if task not in (4, 9)]
    with ThreadPoolExecutor(3) as pool, from_executor(pool, 3) as workers:
        found = list(completed(tasks, doubled, workers))
    assert sorted(task for task, _ in found) == tasks
    assert isinstance(dict(found)[7], ValueError)
    assert all(result == 2 * task for task, result in found if task != 7)


def test_tasks_are_read_only_up_to_the_capacity():
    taken = []

    def source():
        for task in range(10, 60):
            taken.append(task)
            yield task

    with ThreadPoolExecutor(1) as pool, from_executor(pool, 1) as workers:
        for done, _ in enumerate(completed(source(), doubled, workers), 1):
            assert len(taken) <= done + PENDING
    assert len(taken) == 50


def test_a_task_that_kills_its_worker_is_found_and_no_other_is_lost():
    with processes(2) as workers:
        found = dict(completed(range(12), doubled, workers))
    assert {task for task, result in found.items() if isinstance(result, BrokenExecutor)} == {4, 9}
    assert all(found[task] == 2 * task for task in range(12) if task not in (4, 7, 9))


class Broken(Executor):
    """Accepts a task, and is broken."""

    def submit(self, fn, /, *args, **kwargs):
        future = Future()
        future.set_exception(BrokenExecutor())
        return future


def test_a_workersthat_cannot_restart_raises():
    with from_executor(Broken(), 1) as workers, pytest.raises(BrokenExecutor, match="resume"):
        list(completed(range(3), doubled, workers))


class Closing(Executor):
    """Breaks while a task is submitted, as a pool of processes does whose pipes are closed already."""

    def submit(self, fn, /, *args, **kwargs):
        raise OSError("handle is closed")


class Restarted:
    """A pool of workers that works once it was restarted."""

    def __init__(self):
        self.executor = Closing()

    def max_pending(self):
        return 2

    def restart(self):
        self.executor = ThreadPoolExecutor(1)


def test_a_pool_that_breaks_while_a_task_is_submitted_loses_none():
    """Old bug: OSError instead of BrokenExecutor ended the whole run, now and then."""
    assert dict(completed(range(5), str, Restarted())) == {task: str(task) for task in range(5)}


class Silent(Executor):
    """Breaks with the third task, and never completes the others."""

    def __init__(self):
        self.given = []

    def submit(self, fn, /, *args, **kwargs):
        self.given.append(Future())
        if len(self.given) == 3:
            self.given[-1].set_exception(BrokenExecutor())
        return self.given[-1]


def test_tasks_without_an_answer_of_a_broken_executor_are_repeated():
    class WorkerPool:
        def __init__(self):
            self.executor = Silent()

        def max_pending(self):
            return 3

        def restart(self):
            self.executor = ThreadPoolExecutor(1)

    workers = WorkerPool()
    found = list(completed(range(10, 20), doubled, workers))
    workers.executor.shutdown()
    assert sorted(found) == [(task, 2 * task) for task in range(10, 20)]
