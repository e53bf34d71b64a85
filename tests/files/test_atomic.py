"""Writes leave the old file or the new one, and refusals come before the work."""

import os
import signal
import subprocess
import sys

import pytest

from quadriform.errors import OutputError
from quadriform.files import atomic
from quadriform.files.atomic import check_folder, check_writable, make_folder, write_bytes


def test_a_new_file_and_a_forced_one(tmp_path):
    path = tmp_path / "a"
    write_bytes(path, b"old")
    with pytest.raises(OutputError, match="exists already"):
        write_bytes(path, b"new")
    assert path.read_bytes() == b"old"
    write_bytes(path, b"new", force=True)
    assert path.read_bytes() == b"new"
    assert os.listdir(tmp_path) == ["a"]


def test_permissions_are_those_of_a_plain_write_or_of_the_old_file(tmp_path):
    (tmp_path / "plain").write_bytes(b"")
    write_bytes(tmp_path / "a", b"")
    assert (tmp_path / "a").stat().st_mode == (tmp_path / "plain").stat().st_mode
    (tmp_path / "a").chmod(0o640)
    write_bytes(tmp_path / "a", b"", force=True)
    assert (tmp_path / "a").stat().st_mode & 0o777 == 0o640


@pytest.mark.parametrize(
    ("name", "message"),
    [("missing/a", "does not exist"), ("file/a", "does not exist"), ("folder", "regular file"), ("file", "exists")],
)
def test_targets_that_cannot_be(tmp_path, name, message):
    (tmp_path / "file").write_bytes(b"")
    (tmp_path / "folder").mkdir()
    with pytest.raises(OutputError, match=message):
        check_writable(tmp_path / name)


def test_devices_and_places_that_take_no_files():
    with pytest.raises(OutputError, match="device"):
        check_writable("/dev/full", force=True)
    with pytest.raises(OutputError, match="cannot be written"):
        check_writable("/proc/a")
    with pytest.raises(OutputError):
        check_writable("nul\0")
    with pytest.raises(OutputError):
        check_writable("x" * 300)


def test_checking_leaves_no_trace(tmp_path):
    check_writable(tmp_path / "a")
    check_folder(tmp_path / "b/c")
    assert not list(tmp_path.iterdir())


def test_the_input_is_known_by_any_name(tmp_path):
    source = tmp_path / "in"
    source.write_bytes(b"")
    os.link(source, tmp_path / "out")
    with pytest.raises(OutputError, match="the input itself"):
        check_writable(tmp_path / "out", inputs=[tmp_path / "other", source])
    check_writable(tmp_path / "out", force=True, inputs=[source])


@pytest.mark.parametrize("step", ["fsync", "replace", "chmod", "open"])
def test_a_disk_that_fails_leaves_the_old_file_alone(tmp_path, monkeypatch, step):
    path = tmp_path / "a"
    path.write_bytes(b"old")

    def fail(*_args, **_options):
        raise OSError(28, "No space left on device")

    with monkeypatch.context() as patch:
        patch.setattr(atomic.os, step, fail)
        with pytest.raises(OutputError, match="No space left on device"):
            write_bytes(path, b"new", force=True)
    assert path.read_bytes() == b"old"
    assert os.listdir(tmp_path) == ["a"]


def test_an_interrupt_leaves_no_temporary_file(tmp_path, monkeypatch):
    def interrupt(_descriptor):
        raise KeyboardInterrupt

    monkeypatch.setattr(atomic.os, "fsync", interrupt)
    with pytest.raises(KeyboardInterrupt):
        write_bytes(tmp_path / "a", b"new")
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("write", [write_bytes, atomic.create_bytes])
def test_an_interrupt_as_the_temporary_file_is_made_leaves_none(tmp_path, monkeypatch, write):
    """The file was there before its name was known: one Ctrl-C in some hundreds left it behind."""
    made = os.open

    def interrupted(path, flags, *mode, **more):
        descriptor = made(path, flags, *mode, **more)
        if ".quadriform-" in str(path):
            os.close(descriptor)
            raise KeyboardInterrupt
        return descriptor

    monkeypatch.setattr(atomic.os, "open", interrupted)
    with pytest.raises(KeyboardInterrupt):
        write(tmp_path / "a", b"new")
    assert not list(tmp_path.iterdir())


def test_the_temporary_file_is_readable_by_its_owner_only(tmp_path, monkeypatch):
    seen, synced = [], os.fsync

    def watched(descriptor):
        status = os.fstat(descriptor)
        seen.append((status.st_mode & 0o777, status.st_size))
        synced(descriptor)

    monkeypatch.setattr(atomic.os, "fsync", watched)
    write_bytes(tmp_path / "a", b"new")
    assert seen[0] == (0o600, 3)  # with all of its bytes, which then are on the disk
    assert len(seen) == 2  # the folder too


def test_what_cannot_be_created_is_refused_and_leaves_nothing(tmp_path, monkeypatch):
    """Unlike one more than there may be: that is left as it is."""
    assert atomic.create_bytes(tmp_path / "a", b"first") and not atomic.create_bytes(tmp_path / "a", b"second")
    assert (tmp_path / "a").read_bytes() == b"first"

    def full(_descriptor):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(atomic.os, "fsync", full)
    with pytest.raises(OutputError, match="nothing was changed: No space left"):
        atomic.create_bytes(tmp_path / "b", b"third")
    assert os.listdir(tmp_path) == ["a"]


def test_a_killed_writer_leaves_one_of_the_two_files(tmp_path):
    path = tmp_path / "a"
    old, new = b"0" * 500_000, b"1" * 700_000
    path.write_bytes(old)
    code = (
        "import sys; from quadriform.files.atomic import write_bytes\n"
        "print('go', flush=True)\n"
        "while True:\n"
        "    for data in (b'1' * 700_000, b'0' * 500_000): write_bytes(sys.argv[1], data, True)\n"
    )
    for turn in range(5):
        with subprocess.Popen([sys.executable, "-c", code, str(path)], stdout=subprocess.PIPE) as child:
            child.stdout.readline()
            for _ in range(20 * turn + 1):
                assert path.read_bytes() in (old, new)
            child.send_signal(signal.SIGKILL)
        assert path.read_bytes() in (old, new)


def test_folders(tmp_path):
    (tmp_path / "file").write_bytes(b"")
    with pytest.raises(OutputError, match="cannot be used as a folder"):
        check_folder(tmp_path / "file/deep/er")
    with pytest.raises(OutputError, match="cannot be made"):
        make_folder(tmp_path / "file/deep/er")
    assert make_folder(tmp_path / "deep/er").is_dir()
