"""A fit keeps BLAS to one thread, and gives the threads back."""

import numpy as np
import pytest
from threadpoolctl import ThreadpoolController, threadpool_limits

import quadriform as qf
from quadriform.errors import DegenerateError
from quadriform.fitting.threads import one_blas_thread


def blas_threads():
    return {library["num_threads"] for library in ThreadpoolController().info() if library["user_api"] == "blas"}


def test_one_thread_within_and_all_of_them_after():
    with threadpool_limits(2, user_api="blas"):
        before = blas_threads()
        if before == {1}:
            pytest.skip("this BLAS has one thread only")
        assert one_blas_thread(blas_threads)() == {1}
        assert blas_threads() == before


def test_a_fit_runs_on_one_thread_also_when_it_fails():
    seen = []
    points = np.random.default_rng(0).normal(size=(60, 3))
    with threadpool_limits(2, user_api="blas"):
        before = blas_threads()
        qf.fit(points, box=(3, 3, 3), progress=lambda done, total: seen.append(blas_threads()))
        with pytest.raises(DegenerateError):
            qf.fit(points[:2])
        assert blas_threads() == before
    assert seen and all(threads == {1} for threads in seen)


def test_a_cycle_runs_on_one_thread():
    """Old bug: on two threads the same cycle took many times as long."""
    seen, points = [], np.random.default_rng(0).normal(size=(60, 3))
    with threadpool_limits(2, user_api="blas"):
        qf.track([points, points], box=(3, 3, 3), progress=lambda done, total: seen.append(blas_threads()))
    assert seen and all(threads == {1} for threads in seen)
