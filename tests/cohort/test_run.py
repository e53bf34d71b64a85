"""Whole runs: the same bytes by any pool of workers, after a failure of a worker, and in any number of parts."""

import contextlib
import json
import os
import signal
import subprocess
import sys
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from cohort_made import TINY, differences, listed, needs
from remembered import remember

from quadriform.cohort import executors, subject
from quadriform.cohort.run import Choices, run
from quadriform.cohort.stores import models
from quadriform.errors import InputError, OptionError, OutputError
from quadriform.files import load

pytestmark = needs("zarr", "pyarrow")
SUBJECTS, BROKEN = 6, (3, 4)
CHOICES = Choices(options=TINY)
WORDS = ("--set", "box=2,2,2", "--set", "robust=no", "--set", "strength=1e-4")


def one_thread():
    return executors.from_executor(ThreadPoolExecutor(1), 1)


@pytest.fixture(scope="module", autouse=True)
def remembered_subjects():
    """Here no subject is tracked twice; worker processes know nothing of it."""
    with pytest.MonkeyPatch.context() as patch:
        remember(patch, subject, "fit", "track")
        yield


@pytest.fixture(scope="module")
def cohort(tmp_path_factory):
    return listed(tmp_path_factory.mktemp("cohort"), SUBJECTS, broken=BROKEN)


@pytest.fixture(scope="module")
def serial(cohort, tmp_path_factory):
    """Results of one worker, and the arguments of the callback."""
    out = tmp_path_factory.mktemp("serial") / "out"
    calls = []
    summary = run(cohort, out, one_thread, CHOICES, lambda *arguments: calls.append(arguments))
    return out, summary, calls


def test_a_run_returns_a_summary_and_reports_each_outcome(serial):
    _, summary, calls = serial
    assert summary.counts == {"fitted": SUBJECTS - len(BROKEN), "failed": len(BROKEN)}
    assert summary.complete and summary.failed == len(BROKEN)
    assert [(done, total) for _, done, total in calls] == [(k + 1, SUBJECTS) for k in range(SUBJECTS)]
    assert {outcome.number for outcome, _, _ in calls if outcome.failure} == set(BROKEN)
    assert "person" not in repr(calls)


def test_each_failure_is_a_row_and_leaves_no_model(serial):
    out = serial[0]
    rows = (out / "failures.csv").read_text(encoding="utf-8").splitlines()
    assert rows[0] == "id,error,kind" and len(rows) == 1 + len(BROKEN)
    assert all("person" in row and "not finite" in row and row.endswith("PointsError") for row in rows[1:])
    assert str(out.parent) not in rows[1]  # paths as in the list
    assert len(list((out / "subjects").glob("*/model.json"))) == SUBJECTS - len(BROKEN)


def test_the_store_opens_with_xarray_and_holds_the_models_to_the_last_bit(serial):
    xarray = pytest.importorskip("xarray")
    out = serial[0]
    store = xarray.open_zarr(out / "parameters.zarr")
    assert store.control_points.dims == ("subject", "frame", "i", "j", "k", "axis")
    assert store.control_points.attrs == {"units": "unknown", "frame": "unknown"}
    assert store.control_points.shape == (SUBJECTS, 2, 2, 2, 2, 3)
    assert list(store.subject.values) == [f"person{number:02d}" for number in range(SUBJECTS)]
    missing = np.isnan(store.control_points.values).all(axis=(1, 2, 3, 4, 5))
    assert set(np.flatnonzero(missing)) == set(BROKEN)
    moving = load(out / "subjects" / "person05" / "model.json")
    for frame, at in enumerate(moving.frame_times):
        here = store.sel(subject="person05").isel(frame=frame)
        model = moving.at(at)
        assert np.array_equal(here.control_points, model.box.control_points) and float(here.time) == at
        assert np.array_equal(here.superquadrics.sel(surface="surface"), model.superquadric().parameters)
        assert np.array_equal(here.origin, model.box.origin) and np.array_equal(here.edges, model.box.edges)


def test_models_come_back_from_the_store(serial):
    out, summary, _ = serial
    found = dict(models(out, summary.layout, range(SUBJECTS), frame=1))
    assert len(found) == SUBJECTS - len(BROKEN)
    moving = load(out / "subjects" / "person05" / "model.json")
    there = moving.at(moving.frame_times[1]).mesh(resolution=4).vertices
    assert np.abs(found["person05"].mesh(resolution=4).vertices - there).max() < 1e-9


def test_measures_are_one_number_a_row(serial):
    from pyarrow import parquet

    table = parquet.read_table(serial[0] / "metrics").to_pylist()
    assert set(table[0]) == {"subject", "frame", "quantity", "value", "unit", "text"}
    mine = [row for row in table if row["subject"] == "person05"]
    moving = load(serial[0] / "subjects" / "person05" / "model.json")
    volumes = [row["value"] for row in mine if row["quantity"] == "volume surface"]
    assert volumes == [moving.at(at).volume() for at in moving.frame_times]
    assert {row["quantity"] for row in mine if row["frame"] is None} >= {"rms", "noise", "points", "min det J"}


def test_processes_give_the_same_bytes(cohort, serial, tmp_path):
    run(cohort, tmp_path / "out", partial(executors.processes, 2), CHOICES)
    assert differences(serial[0], tmp_path / "out") == []


def test_dask_gives_the_same_bytes_although_a_worker_is_killed(cohort, serial, tmp_path):
    """As many workers as requested, whatever the number of cores: once the number was taken for the cluster's name."""
    pytest.importorskip("distributed", reason="the extra 'cluster' is not installed")
    done = threading.Event()
    killed = []

    def report(_outcome, count, _total):
        if count == 2:
            done.set()

    def killing(client):
        done.wait(120)
        pids = list(client.run(os.getpid).values())
        os.kill(pids[0], signal.SIGKILL)
        killed.append(pids[0])

    @contextlib.contextmanager
    def with_an_accident():
        with executors.cluster(None, 3) as started:
            assert len(started.client.nthreads()) == 3
            thresholds = started.client.run(os.environ.get, "MALLOC_TRIM_THRESHOLD_")
            assert all(int(least) > 1e8 for least in thresholds.values())
            thread = threading.Thread(target=killing, args=(started.client,))
            thread.start()
            yield started
            thread.join()

    summary = run(cohort, tmp_path / "out", with_an_accident, CHOICES, report)
    assert len(killed) == 1
    assert summary.counts == {"fitted": SUBJECTS - len(BROKEN), "failed": len(BROKEN)}
    assert differences(serial[0], tmp_path / "out") == []


def test_an_existing_cluster_is_found_by_its_address(tmp_path):
    distributed = pytest.importorskip("distributed", reason="the extra 'cluster' is not installed")
    cohort = listed(tmp_path, 2)
    with distributed.LocalCluster(
        n_workers=1, threads_per_worker=1, processes=False, protocol="tcp://", dashboard_address=executors.LOCAL
    ) as cluster:
        summary = run(cohort, tmp_path / "out", partial(executors.cluster, cluster.scheduler_address, 0), CHOICES)
    assert summary.counts == {"fitted": 2}


def test_a_killed_run_resumes_without_repeating_finished_subjects(cohort, serial, tmp_path):
    out = tmp_path / "out"
    command = [sys.executable, "-m", "quadriform.cli.main", "cohort", cohort, "-o", out, "--processes", "1", *WORDS]
    process = subprocess.Popen(command, start_new_session=True, stderr=subprocess.DEVNULL, stdout=subprocess.DEVNULL)
    while len(list((out / "subjects").glob("*/model.json"))) < 1 and process.poll() is None:
        time.sleep(0.05)
    os.killpg(process.pid, signal.SIGKILL)
    process.wait()
    time.sleep(0.5)
    before = {path: path.stat().st_mtime_ns for path in (out / "subjects").glob("*/model.json")}
    assert 1 <= len(before) < SUBJECTS - len(BROKEN)
    summary = run(cohort, out, one_thread, replace(CHOICES, resume=True))
    assert summary.counts == {
        "kept": len(before),
        "fitted": SUBJECTS - len(BROKEN) - len(before),
        "failed": len(BROKEN),
    }
    assert {path: path.stat().st_mtime_ns for path in before} == before
    assert differences(serial[0], out) == []


def test_shards_at_the_same_time_make_the_same_store(cohort, serial, tmp_path):
    import zarr
    from pyarrow import parquet

    out, summaries = tmp_path / "out", []

    def part(number):
        summaries.append(run(cohort, out, one_thread, replace(CHOICES, shard=(number, 2))))

    threads = [threading.Thread(target=part, args=(number,)) for number in (1, 2)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert sorted(summary.subjects for summary in summaries) == [3, 3]
    assert any(summary.complete for summary in summaries)
    # two blocks, not one: the parts are others, their content is the same
    assert {name.split(os.sep)[0] for name in differences(serial[0], out)} <= {
        "cohort.json",
        "parameters.zarr",
        "metrics",
        "failures",
        "modes",
    }
    assert (out / "failures.csv").read_bytes() == (serial[0] / "failures.csv").read_bytes()
    # rows, not tables: the order of the words of a column that is a dictionary is that of the parts
    one, other = (parquet.read_table(root / "metrics").to_pylist() for root in (serial[0], out))
    assert str(one) == str(other)  # NaN is equal to itself
    for name in ("control_points", "superquadrics", "origin", "edges", "time", "subject"):
        one, other = (zarr.open_array(root / "parameters.zarr" / name, mode="r")[:] for root in (serial[0], out))
        assert np.array_equal(one, other, equal_nan=one.dtype.kind == "f")


def test_a_changed_option_or_file_is_processed_again(tmp_path):
    cohort, out = listed(tmp_path, 2), tmp_path / "out"
    run(cohort, out, one_thread, CHOICES)
    again = replace(CHOICES, resume=True)
    assert run(cohort, out, one_thread, again).counts == {"kept": 2}
    record = out / "subjects" / "person00" / "record.json"
    older = {**json.loads(record.read_text(encoding="utf-8")), "version": subject.VERSION - 1}
    record.write_text(json.dumps(older), encoding="utf-8")
    assert run(cohort, out, one_thread, again).counts == {"kept": 1, "fitted": 1}
    cloud = tmp_path / "clouds" / "person01" / "0.npy"
    np.save(cloud, 1.01 * np.load(cloud))
    assert run(cohort, out, one_thread, again).counts == {"kept": 1, "fitted": 1}
    other = replace(again, options=TINY | {"strength": 1e-3})
    assert run(cohort, out, one_thread, other).counts == {"fitted": 2}
    (out / "subjects" / "person00" / "model.json").write_bytes(b"{")
    assert run(cohort, out, one_thread, other).counts == {"kept": 1, "fitted": 1}
    np.save(cloud, np.full((24, 3), np.nan))
    assert run(cohort, out, one_thread, other).counts == {"kept": 1, "failed": 1}
    assert not (out / "subjects" / "person01" / "model.json").exists()


def test_results_are_not_replaced_without_force(cohort, serial):
    with pytest.raises(OutputError, match="--resume"):
        run(cohort, serial[0], one_thread, CHOICES)


def test_a_folder_contains_one_cohort(serial, tmp_path):
    with pytest.raises(InputError, match="other subjects"):
        run(listed(tmp_path, 2), serial[0], one_thread, replace(CHOICES, resume=True))


def test_a_list_without_a_file_that_can_be_read_is_refused(tmp_path):
    path = tmp_path / "list.csv"
    path.write_text("id,input\na,nothing.ply\n", encoding="utf-8")
    with pytest.raises(InputError, match="no subject has files"):
        run(path, tmp_path / "out", one_thread, Choices())


@pytest.mark.parametrize("shard", [(0, 2), (3, 2)])
def test_shards_are_counted_from_one(shard):
    with pytest.raises(OptionError, match="shard"):
        Choices(shard=shard)


def test_on_a_terminal(tmp_path, capsys, monkeypatch):
    """Exit code 7, the record as data, and no id on the screen unless requested; threads in place of processes."""
    from quadriform.cli.main import main

    cohort = listed(tmp_path, 3, broken=(1,))
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(executors, "processes", lambda count: one_thread())
    words = ["cohort", str(cohort), "-o", "out", "--processes", "1", *WORDS]
    assert main([*words, "--json"]) == 7
    shown = capsys.readouterr()
    record = json.loads(shown.out)
    assert (record["fitted"], record["failed"], record["cohort"]["complete"]) == (2, 1, True)
    assert "person" not in shown.out + shown.err
    assert "failed: subject 2: PointsError" in shown.err
    assert main([*words, "--resume", "--show-ids"]) == 7
    assert "person01" in capsys.readouterr().err
    np.save(tmp_path / "clouds" / "person01" / "1.npy", np.load(tmp_path / "clouds" / "person01" / "0.npy"))
    assert main([*words, "--resume"]) == 0
    assert not list((tmp_path / "out" / "failures").iterdir())
    assert (tmp_path / "out" / "failures.csv").read_text(encoding="utf-8") == "id,error,kind\n"
    assert main([*words, "--workers", "2"]) == 2
    assert "exclude each other" in capsys.readouterr().err
