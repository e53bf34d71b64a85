"""A part of `make fuzz`, and that it would find what it looks for."""

import sys
from concurrent.futures import Future
from concurrent.futures.process import BrokenProcessPool
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("SimpleITK", reason="the readers of the extra `images` are fuzzed too")
sys.path.insert(0, str(Path(__file__).parent))  # its processes are started afresh and find it there

import fuzzed_kinds
import fuzzing

from quadriform.errors import FileFormatError


def test_mutated_files_end_as_promised():
    each = 45
    tally, faults = fuzzing.run(each * len(fuzzed_kinds.KINDS), seed=0, processes=1)
    assert faults == []
    for kind in fuzzed_kinds.KINDS:
        assert tally[kind.name, fuzzing.TYPED] > 10
        found = sum(tally[kind.name, how] for how in (fuzzing.TYPED, fuzzing.SAME, fuzzing.INDEPENDENT))
        assert found == each


def test_formats_with_checksums_never_give_anything_else():
    for kind in fuzzed_kinds.KINDS:
        if kind.suffix in (".npz", ".nii.gz"):
            assert kind.independent is None


def refuse(path):
    raise FileFormatError(f"{path}: not one of ours")


def stumble(path):
    return {}[path]


@pytest.mark.parametrize(
    ("read", "other", "verdict"),
    [
        (refuse, None, "typed error"),
        (stumble, None, "KeyError"),
        (lambda path: np.zeros(3), None, "identical"),
        (lambda path: np.ones(3), None, "another result"),
        (lambda path: np.ones(3), lambda path: np.ones(3), "as an independent reader"),
        (lambda path: np.ones(3), lambda path: np.zeros(3), "another result"),
        (lambda path: np.ones(3), stumble, "an independent reader refuses"),
    ],
)
def test_a_broken_promise_is_seen(tmp_path, read, other, verdict):
    kind = fuzzed_kinds.Kind("made", ".bin", refuse, read, other)
    assert verdict in fuzzing.judged(kind, tmp_path / "made.bin", fuzzed_kinds.plain(np.zeros(3)))


def test_every_kind_of_change_is_made():
    data = b"1 2 3\n4 5 6\n7 8 9\n" * 40
    made = [fuzzing.mutated(data, np.random.default_rng(seed)) for seed in range(200)]
    words = {how.split()[0] for _, how in made}
    assert words == {"cut", "bit", "line", "lines", "insert", "delete", "digit", "several"}
    assert all(isinstance(changed, bytes) for changed, _ in made)
    lengths = {len(changed) - len(data) for changed, how in made if how.startswith("line ")}
    assert lengths == {6, -6}


class Dead:
    """Processes that are gone before they answer."""

    def __init__(self, *words):
        pass

    def __enter__(self):
        return self

    def __exit__(self, *words):
        pass

    def submit(self, *words):
        gone = Future()
        gone.set_exception(BrokenProcessPool())
        return gone


def test_a_reader_that_takes_its_process_down_is_a_fault(monkeypatch):
    monkeypatch.setattr(fuzzing, "ProcessPoolExecutor", Dead)
    _, (fault,) = fuzzing.run(20, seed=7, processes=1)
    assert fault.seed == 7 and "took the whole process down" in fault.what
