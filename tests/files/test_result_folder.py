"""A folder of results is the old one or the new one: whatever fails, wherever it is stopped."""

import json
import os

import pytest

from quadriform.errors import OutputError
from quadriform.files import result_folder
from quadriform.files.atomic import write_bytes
from quadriform.files.result_folder import check_results, replaced_together, restore

OLD = {"model.json": b"old", "surface-a.ply": b"old", "report.html": b"old"}
NEW = {"model.json": b"new", "surface.ply": b"new", "report.html": b"new"}


def contents(folder):
    """From the names of all files, hidden ones included, to what is in them."""
    return {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def written(folder, files=NEW, force=True):
    with replaced_together(folder, "model.json", force, list(OLD)) as staging:
        for name, data in files.items():
            write_bytes(staging / name, data)


@pytest.fixture
def out(tmp_path):
    """A folder with old results and a note of somebody."""
    (tmp_path / "out").mkdir()
    for name, data in OLD.items():
        (tmp_path / "out" / name).write_bytes(data)
    (tmp_path / "out" / "notes.txt").write_bytes(b"mine")
    return tmp_path / "out"


def failing(monkeypatch, function, at, error=None):
    """The call number `at` of a function of the system fails; those after it work. The list of calls."""
    calls, real = [], getattr(os, function)

    def call(*arguments, **options):
        calls.append(arguments)
        if len(calls) == at:
            raise error or OSError(28, "No space left on device")
        return real(*arguments, **options)

    monkeypatch.setattr(result_folder.os, function, call)
    return calls


def test_new_results_take_the_place_of_old_ones_and_nothing_else_changes(out):
    (out / "model.json").chmod(0o640)
    written(out)
    assert contents(out) == NEW | {"notes.txt": b"mine"}
    assert (out / "model.json").stat().st_mode & 0o777 == 0o640


def test_a_folder_that_is_not_there_is_made(tmp_path):
    written(tmp_path / "a/b/out", force=False)
    assert contents(tmp_path) == {f"a/b/out/{name}": data for name, data in NEW.items()}
    (tmp_path / "plain").mkdir()
    assert (tmp_path / "a/b/out").stat().st_mode == (tmp_path / "plain").stat().st_mode


def test_without_force_nothing_is_replaced(out):
    with pytest.raises(OutputError, match="exists already"):
        written(out, force=False)
    assert contents(out) == OLD | {"notes.txt": b"mine"}


@pytest.mark.parametrize("function", ["fsync", "replace", "chmod", "open", "mkdir"])
@pytest.mark.parametrize("at", [1, 2, 3, 4, 5, 6, 7])
def test_a_disk_that_is_full_at_any_step_leaves_the_old_results(out, monkeypatch, function, at):
    with monkeypatch.context() as patch:
        calls = failing(patch, function, at)
        try:
            written(out)
            failed = False
        except OutputError as error:
            failed = True
            assert "No space left on device" in str(error) and ".quadriform" not in str(error)
    flushing = function == "open" or (function == "fsync" and at > 1)  # a folder that cannot be flushed is no failure
    assert failed == (len(calls) >= at) or flushing
    assert contents(out) == (OLD if failed else NEW) | {"notes.txt": b"mine"}


@pytest.mark.parametrize("function", ["fsync", "rename", "mkdir"])
def test_a_disk_that_is_full_leaves_no_new_folder(tmp_path, monkeypatch, function):
    failing(monkeypatch, function, 1)
    with pytest.raises(OutputError, match="No space left on device"):
        written(tmp_path / "a/b/out")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("at", range(1, 7))
def test_an_interrupt_at_any_move_leaves_the_old_results(out, monkeypatch, at):
    with monkeypatch.context() as patch:
        failing(patch, "replace", at + 4, KeyboardInterrupt())  # the files themselves are moved into place before
        with pytest.raises(KeyboardInterrupt):
            written(out)
    assert contents(out) == OLD | {"notes.txt": b"mine"}


@pytest.mark.parametrize("at", range(1, 7))
def test_a_process_killed_at_any_move_leaves_the_old_results_to_be_put_back(out, monkeypatch, at):
    """No model lies beside a file of another: it is the first to go and the last to come."""
    with monkeypatch.context() as patch:
        failing(patch, "replace", at + 4, SystemExit())
        patch.setattr(result_folder, "_undo", lambda _moves: None)  # as killed: nothing more is done
        patch.setattr(result_folder.shutil, "rmtree", lambda *_args, **_options: None)
        with pytest.raises(SystemExit):
            written(out)
    assert at == 1 or not (out / "model.json").exists()
    check_results(out, list(NEW), force=True)
    assert contents(out) == OLD | {"notes.txt": b"mine"}
    written(out)
    assert contents(out) == NEW | {"notes.txt": b"mine"}


def test_a_process_killed_after_the_moves_has_done_its_work(out, monkeypatch):
    with monkeypatch.context() as patch:
        patch.setattr(result_folder.shutil, "rmtree", lambda *_args, **_options: None)
        written(out)
    restore(out)
    assert contents(out) == NEW | {"notes.txt": b"mine"}


def test_files_of_a_writer_at_work_are_left_alone(out):
    """A temporary file, a folder into which somebody writes, and one whose list is not whole."""
    (out / ".quadriform-1.tmp").write_bytes(b"at work")
    for name in ("2", "3"):
        (out / f".quadriform-{name}.tmp").mkdir()
    (out / ".quadriform-3.tmp" / "names").write_bytes(json.dumps(7).encode())
    before = contents(out)
    restore(out)
    assert contents(out) == before and (out / ".quadriform-2.tmp").is_dir()


def test_what_cannot_be_put_back_is_reported(out, monkeypatch):
    staging = out / ".quadriform-1.tmp"
    (staging / "old").mkdir(parents=True)
    (out / "model.json").rename(staging / "old" / "model.json")
    (staging / "names").write_text(json.dumps(["model.json", ["model.json"], ["model.json"]]))
    failing(monkeypatch, "replace", 1)
    with pytest.raises(OutputError, match="earlier results cannot be put back: No space left"):
        restore(out)
    restore(out)
    assert contents(out) == OLD | {"notes.txt": b"mine"}


def test_two_runs_that_make_one_folder(tmp_path):
    """The second finds the folder of the first when it is done, and leaves it."""
    with (
        pytest.raises(OutputError, match="nothing was changed"),
        replaced_together(tmp_path / "out", "a", False) as one,
    ):
        write_bytes(one / "a", b"second")
        written(tmp_path / "out")
    assert contents(tmp_path) == {f"out/{name}": data for name, data in NEW.items()}


def test_names_that_the_disk_cannot_have_are_refused_before(tmp_path):
    with pytest.raises(OutputError, match="too long"):
        check_results(tmp_path / "out", ["x" * 300], force=False)
    with pytest.raises(OutputError, match="too long"):
        check_results(tmp_path / ("x" * 300), ["a"], force=False)
    assert list(tmp_path.iterdir()) == []
