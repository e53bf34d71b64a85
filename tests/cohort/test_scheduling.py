"""Tasks over an executor: how many are submitted, and their results when workers die."""

import time
from concurrent.futures import BrokenExecutor, Executor, Future, ThreadPoolExecutor
from multiprocessing.context import SpawnProcess

import pytest
from cohort_tasks import doubled, overlapping

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


def test_workers_that_cannot_restart_raise():
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


class ClosingTwice(Restarted):
    """A pool of workers that also breaks with the first task after a restart."""

    restarts = 0

    def restart(self):
        self.restarts += 1
        self.executor = ThreadPoolExecutor(1) if self.restarts > 1 else Closing()


def test_a_pool_that_breaks_again_with_the_first_task_loses_no_other():
    """Old bug: the OSError of the pool was taken for the error of the task, and the pool was kept for the next one."""
    found = dict(completed(range(5), str, ClosingTwice()))
    assert isinstance(found.pop(0), BrokenExecutor)
    assert found == {task: str(task) for task in range(1, 5)}


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


LONGEST = 60
"""Seconds after which a test fails rather than wait."""


@pytest.fixture
def started(monkeypatch):
    """The processes that were started; killed after the test."""
    found, start = [], SpawnProcess.start

    def recorded(process):
        start(process)
        found.append(process)

    monkeypatch.setattr(SpawnProcess, "start", recorded)
    yield found
    for process in found:
        process.kill()


def test_no_worker_starts_while_the_pool_breaks(monkeypatch, started):
    """Old bug: a worker started while another died was waited for without end; if itself died, nobody noticed."""
    start, terminate = SpawnProcess.start, SpawnProcess.terminate

    def start_late(process):
        start(process)
        if len(started) == 2 and workers.executor._executor_manager_thread is not None:
            _wait_until(lambda: workers.executor._call_queue._closed)  # the first is dead, and the pool is broken

    def terminate_fully(process):  # else the pool may count it as alive, and a request to end is left for the new one
        terminate(process)
        process.join()

    monkeypatch.setattr(SpawnProcess, "start", start_late)
    monkeypatch.setattr(SpawnProcess, "terminate", terminate_fully)
    with processes(2) as workers:
        results = _in_time(lambda: dict(completed([4, 1], doubled, workers)), started)
    assert isinstance(results[4], BrokenExecutor)
    assert results[1] == 2


def test_a_worker_that_dies_while_it_is_started_is_noticed(monkeypatch, started, tmp_path):
    """Old bug: the task of a worker started beside a busy one never completed if it killed this worker."""
    start, begun = SpawnProcess.start, tmp_path / "begun"

    def start_late(process):
        late = len(started) == 1 and workers.executor._executor_manager_thread is not None
        if late:
            _wait_until(begun.exists)
        start(process)
        if late:
            process.join(LONGEST / 3)

    monkeypatch.setattr(SpawnProcess, "start", start_late)
    tasks = [("long", begun), ("fatal", begun)]
    with processes(2) as workers:
        results = _in_time(lambda: dict(completed(tasks, overlapping, workers)), started)
    assert results.pop(("long", begun)) == "long"
    assert isinstance(results.pop(("fatal", begun)), BrokenExecutor)


def _in_time(work, processes):
    """What it returns; the processes are killed if it takes too long, and it ends then."""
    with ThreadPoolExecutor(1) as thread:
        found = thread.submit(work)
        try:
            return found.result(timeout=LONGEST)
        except TimeoutError:
            for process in processes:
                process.kill()
            raise


def _wait_until(reached):
    end = time.monotonic() + LONGEST / 3
    while not reached() and time.monotonic() < end:
        time.sleep(0.01)


@pytest.mark.filterwarnings("ignore::pytest.PytestUnhandledThreadExceptionWarning")
def test_a_broken_pool_leaves_no_process(monkeypatch, started):
    """Also where the thread that ends the processes fails: Python 3.11 does, where tasks are submitted meanwhile."""

    def fail(process):
        raise RuntimeError("dictionary changed size during iteration")

    monkeypatch.setattr(SpawnProcess, "terminate", fail)
    with processes(2) as workers:
        results = dict(completed([4, 1], doubled, workers))
    assert isinstance(results[4], BrokenExecutor)
    assert results[1] == 2
    _wait_until(lambda: not any(process.is_alive() for process in started))
    assert not any(process.is_alive() for process in started)


def test_an_interrupt_while_the_workers_start_leaves_no_process(monkeypatch, started):
    start = SpawnProcess.start

    def interrupted(process):
        if len(started) == 2:
            raise KeyboardInterrupt
        start(process)

    monkeypatch.setattr(SpawnProcess, "start", interrupted)
    with pytest.raises(KeyboardInterrupt), processes(3) as workers:
        queues = workers.executor._call_queue, workers.executor._result_queue  # with these the workers would wait on
        list(completed(range(3), doubled, workers))
    _wait_until(lambda: not any(process.is_alive() for process in started))
    assert queues and not any(process.is_alive() for process in started)
