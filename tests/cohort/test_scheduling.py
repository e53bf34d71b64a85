"""Units of work over an executor: how many are on the way, and what becomes of them when workers die."""

from concurrent.futures import BrokenExecutor, Executor, Future, ThreadPoolExecutor

import pytest
from cohort_made import doubled

from quadriform.cohort.executors import PENDING, from_executor, processes
from quadriform.cohort.scheduling import completed


def test_every_task_comes_back_once_with_its_result_or_error():
    tasks = [task for task in range(40) if task not in (4, 9)]
    with ThreadPoolExecutor(3) as pool, from_executor(pool, 3) as engine:
        found = list(completed(tasks, doubled, engine))
    assert sorted(task for task, _ in found) == tasks
    assert isinstance(dict(found)[7], ValueError)
    assert all(result == 2 * task for task, result in found if task != 7)


def test_tasks_are_taken_only_as_there_is_room():
    taken = []

    def source():
        for task in range(10, 60):
            taken.append(task)
            yield task

    with ThreadPoolExecutor(1) as pool, from_executor(pool, 1) as engine:
        for done, _ in enumerate(completed(source(), doubled, engine), 1):
            assert len(taken) <= done + PENDING
    assert len(taken) == 50


def test_a_unit_that_kills_its_worker_is_found_and_no_other_is_lost():
    with processes(2) as engine:
        found = dict(completed(range(12), doubled, engine))
    assert {task for task, result in found.items() if isinstance(result, BrokenExecutor)} == {4, 9}
    assert all(found[task] == 2 * task for task in range(12) if task not in (4, 7, 9))


class Broken(Executor):
    """Takes a unit, and is broken."""

    def submit(self, fn, /, *args, **kwargs):
        future = Future()
        future.set_exception(BrokenExecutor())
        return future


def test_an_engine_without_another_executor_says_so():
    with from_executor(Broken(), 1) as engine, pytest.raises(BrokenExecutor, match="resume"):
        list(completed(range(3), doubled, engine))


class Silent(Executor):
    """Breaks with the third unit, and never says what became of the others."""

    def __init__(self):
        self.given = []

    def submit(self, fn, /, *args, **kwargs):
        self.given.append(Future())
        if len(self.given) == 3:
            self.given[-1].set_exception(BrokenExecutor())
        return self.given[-1]


def test_units_that_a_broken_executor_is_silent_about_are_done_again():
    class WorkerPool:
        def __init__(self):
            self.executor = Silent()

        def max_pending(self):
            return 3

        def restart(self):
            self.executor = ThreadPoolExecutor(1)

    engine = WorkerPool()
    found = list(completed(range(10, 20), doubled, engine))
    engine.executor.shutdown()
    assert sorted(found) == [(task, 2 * task) for task in range(10, 20)]
