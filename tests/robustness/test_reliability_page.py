"""The page of promises: every row and property once, each held by tests that exist."""

import ast
import re
import runpy
import sys
from functools import cache
from pathlib import Path

import pytest
from fitter_checks import DRESSES

sys.path.insert(0, str(Path(__file__).parent))

from mutants import MUTANTS

TESTS = Path(__file__).resolve().parents[1]
PAGE = (TESTS.parent / "docs" / "reliability.md").read_text(encoding="utf-8")
WANTED = [str(n) for n in range(1, 81)] + [f"M{n}" for n in range(1, 28)]
ROWS = dict(re.findall(r"^\| (M?\d+) \| (.*) \|$", PAGE, re.MULTILINE))
HELD = {row: re.findall(r"`([\w/]+\.py)::([\w:]+)`", cells.split(" | ")[-1]) for row, cells in ROWS.items()}


def section(title):
    return PAGE.split(f"\n## {title}\n")[1].split("\n## ")[0] if f"\n## {title}\n" in PAGE else ""


def argued_away():
    return re.findall(r"^- \*\*Row (\d+),", section("What we do otherwise"), re.MULTILINE)


@cache
def names_in(path):
    """Tests of a file, those of classes with the name of the class before."""
    found = set()
    for node in ast.parse(path.read_text(encoding="utf-8")).body:
        if isinstance(node, ast.ClassDef):
            found |= {f"{node.name}::{inner.name}" for inner in node.body if isinstance(inner, ast.FunctionDef)}
        elif isinstance(node, ast.FunctionDef):
            found.add(node.name)
    return found


def test_every_row_and_property_stands_once():
    assert sorted(re.findall(r"^\| (M?\d+) \|", PAGE, re.MULTILINE)) == sorted(WANTED)


@pytest.mark.parametrize("row", WANTED)
def test_a_row_names_tests_that_exist(row):
    assert HELD[row]
    for path, name in HELD[row]:
        assert name.split("::")[-1].startswith("test_")
        assert name in names_in(TESTS / path), f"{path}::{name}"


def test_every_test_that_the_page_names_exists():
    for path, name in re.findall(r"`([\w/]+\.py)::([\w:]*test_\w+)`", PAGE):
        assert name in names_in(TESTS / path), f"{path}::{name}"


def test_few_rows_are_argued_away_each_with_its_reason():
    assert 0 < len(argued_away()) <= 5
    assert set(argued_away()) <= set(WANTED)
    assert all(HELD[row] for row in argued_away())


def test_ids_of_bad_inputs_are_rows():
    """Those of the tables, and those that parametrised tests give."""
    names = runpy.run_path(str(Path(__file__).with_name("test_bad_inputs.py")))
    ids = [*names["REFUSED"], *names["WARNED"], *DRESSES]
    for function in names.values():
        for mark in (mark for mark in getattr(function, "pytestmark", ()) if mark.name == "parametrize"):
            names_rows = mark.args[0][:1] == ("row",)
            ids += [values[0] for values in mark.args[1]] if names_rows else []
            ids += mark.kwargs.get("ids", []) if isinstance(mark.kwargs.get("ids"), list) else []
    assert len(ids) > 50
    assert [each for each in ids if each.split()[0] not in WANTED] == []


def test_the_page_has_the_table_of_every_guard():
    """As `make mutants` printed it."""
    rows = re.findall(r"^\| ([^|]+) \| `([\w/.]+)` \| (?:`([\w/.]+)::([\w:]+)`) \|$", section("Guards taken out"), re.M)
    assert [row[:2] for row in rows] == [(mutant.guard, mutant.file) for mutant in MUTANTS]
    for _, _, path, name in rows:
        assert name in names_in(TESTS / path), name


def test_every_guard_stands_once_in_its_file():
    for mutant in MUTANTS:
        text = (TESTS.parent / "src" / "quadriform" / mutant.file).read_text(encoding="utf-8")
        assert text.count(mutant.old) == 1, mutant.guard


def test_functions_with_lines_that_no_test_runs_exist():
    found = re.findall(r"^- `([\w/]+\.py)::([\w.]+)`", section("Lines that no test runs"), re.MULTILINE)
    assert len(found) > 20
    for file, name in found:
        text = (TESTS.parent / "src" / "quadriform" / file).read_text(encoding="utf-8")
        assert f"def {name.split('.')[-1]}(" in text, name
