"""The random changes of `make mutants`: each site gives other code that can be compiled, and no check is touched."""

import ast
import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parent))

import logic_mutants as mutants


def made(code):
    """All changes of a piece of code, as (before, after)."""
    nodes = [node for node, _ in mutants.walk(ast.parse(code))]
    return [(ast.unparse(node), each and ast.unparse(each)) for node in nodes for each in mutants.variants(node)]


@pytest.mark.parametrize(
    ("line", "changes"),
    [
        ("x = a + b", [("a + b", "a - b")]),
        ("x = a / b ** c", [("a / b ** c", "a * b ** c"), ("b ** c", "b * c")]),
        ("x = a < b", [("a < b", "a >= b")]),
        ("x = a < 2", [("a < 2", "a >= 2"), ("a < 2", "a <= 2"), ("2", "3")]),
        ("x = not a and -b", [("not a and -b", "not a or -b"), ("not a", "a"), ("-b", "b")]),
        ("x = a[1:] * 0.5", [("a[1:] * 0.5", "a[1:] / 0.5"), ("1", "2"), ("0.5", "0.55")]),
        ("x += f(a, b)", [("x += f(a, b)", None), ("f(a, b)", "f(b, a)")]),
        ("f(a)", [("f(a)", None)]),
        ("x = max(a, 1e-300)", []),
        ("x = 'a' + f'{b + 1}'", []),
    ],
)
def test_what_becomes_of_a_line(line, changes):
    assert made(f"def f(a, b):\n    {line}") == [(before, after) for before, after in changes]


@pytest.mark.parametrize(
    "code",
    [
        "LIMIT = 3 + 4",
        "def check_size(a):\n    x = a + 1",
        "def f(a: int = 3) -> int:\n    _check_size(a, b)",
        "def f(a):\n    if a < 1:\n        raise E(a + 1)",
        "@dec(1 + 2)\ndef f(a):\n    x: int = 3",
        "class A:\n    size = 3 + 4",
    ],
)
def test_checks_messages_and_constants_are_left_alone(code):
    assert made(code) == []


def test_a_sample_is_the_same_for_a_seed_and_changes_the_code():
    sample = mutants.drawn(15, 3)
    assert sample == mutants.drawn(15, 3) and sample != mutants.drawn(15, 4)
    assert len(set(sample)) == len(sample) == 15
    for change in sample:
        text = (mutants.ROOT / "src" / "quadriform" / change.file).read_text(encoding="utf-8")
        new = mutants.changed(text, change)
        compile(new, change.file, "exec")
        assert new != ast.unparse(ast.parse(text)), change


def test_tests_of_a_file_begin_with_those_of_its_name():
    assert next(iter(mutants.stages("files/atomic.py"))) == ["files/test_atomic.py"]
    assert "fitting" in [name for names in mutants.stages("fitting/refinement/surface_data.py") for name in names]


def test_what_is_explained_is_there():
    """An explanation goes with its change."""
    for text in mutants.KNOWN:
        file = mutants.ROOT / "src" / "quadriform" / text.split(": ")[0]
        there = [change for change in mutants.changes(file) if text.startswith(f"{mutants.place(change)}: ")]
        assert text in map(mutants.described, there)


def test_the_name_of_a_failed_test_may_have_spaces():
    """Old bug: cut at its first space, it failed without a change too, for there is no such test."""
    lines = "FAILED tests/files/test_a.py::test_b[once-a b] - ValueError: c - d\nERROR tests/c.py\n"
    assert mutants.FAILED.findall(lines) == ["files/test_a.py::test_b[once-a b]", "c.py"]
