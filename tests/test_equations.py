"""docs/equations.md is true in both directions: markers in the source against rows of the table."""

import ast
import importlib.util
import re
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from quadriform.fitting import mixture, noise
from quadriform.fitting.least_squares.regularisers import regulariser_matrix
from quadriform.fitting.refinement import left_out, point_to_plane, stage, surface_data

ROOT = Path(__file__).resolve().parents[1]
PAGE = (ROOT / "docs" / "equations.md").read_text(encoding="utf-8")
BENDING = regulariser_matrix("bending", (4, 4, 4))
SECTIONS = {"2", "2.2", "2.4", "3.2.1", "3.2.2", "3.2.3", "3.3", "3.4.2", "5", "A.1", "A.3"}

spec = importlib.util.spec_from_file_location("equation_lines", ROOT / "docs" / "equation_lines.py")
lines = importlib.util.module_from_spec(spec)
spec.loader.exec_module(lines)
places = cache(lines.lines)


def rows():
    """(paper, module:function, test) of each row."""
    table = [line for line in PAGE.partition("## The default method")[0].splitlines() if line.startswith("|")]
    cells = [[cell.strip(" `") for cell in line.strip("| ").split(" | ")] for line in table]
    return [(paper, where, test) for paper, _, where, test in cells[2:]]


@cache
def names(path):
    """The functions and methods of a file."""
    return dict(lines.functions(ast.parse(path.read_text(encoding="utf-8"))))


def test_every_marker_has_its_row():
    assert set(places()) - {(paper, where) for paper, where, _ in rows()} == set()


@pytest.mark.parametrize(("paper", "where", "test"), rows(), ids=[f"{r[0]}-{r[1].split(':')[1]}" for r in rows()])
def test_every_row_is_true(paper, where, test):
    """The marker is in the function, at the file and line that the site shows, and the test is there."""
    file, _, line = places()[paper, where].rpartition(":")
    module, name = where.split(":")
    assert file == f"src/{module.replace('.', '/')}.py"
    function = names(ROOT / file)[name]
    assert function.lineno < int(line) <= function.end_lineno
    shown = (ROOT / file).read_text(encoding="utf-8").splitlines()[int(line) - 1]
    assert re.search(rf"#.*\b{re.escape(paper)}(?![\d.]*\d)", shown)
    test_file, test_name = test.split("::")
    assert test_name.startswith("test_")
    assert test_name in names(ROOT / test_file)


def test_the_site_shows_file_and_line_in_every_row():
    shown = [line for line in lines.with_lines(PAGE).splitlines() if line.startswith(("| P", "| section"))]
    assert len(shown) == len(rows()) > 40
    for line, (paper, where, _) in zip(shown, rows()):
        assert f"`{where}` ({places()[paper, where]})" in line


NAMED = sorted(set(re.findall(r"`quadriform\.([a-z_.]+):([\w.]+)`", PAGE)))


@pytest.mark.parametrize(("module", "name"), NAMED)
def test_every_named_function_is_there(module, name):
    """Also those of the default method, which no equation of the paper stands for."""
    assert name in names(ROOT / "src" / "quadriform" / (module.replace(".", "/") + ".py"))


def test_every_equation_of_the_paper_has_a_row():
    assert {paper for paper, _, _ in rows()} == {f"P{n}" for n in range(1, 20)} | {f"section {n}" for n in SECTIONS}


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("epsilon = {:g}", point_to_plane.TANGENTIAL_WEIGHT),
        ("+ {:g} tr C_i", noise.LEAST_VARIANCE),
        ("s is {:g} times the median", stage.MAD_TO_SIGMA),
        ("or {:g} if that is more", surface_data.MISFIT),
        ("density of an outlier is 1/{:g}", mixture.DEPTH),
        ("level {:g}", left_out.LEFT_OUT.significant),
        ("null space: {:g} for bending", 3 * np.count_nonzero(np.linalg.eigvalsh(BENDING) < 1e-9)),
    ],
)
def test_constants_of_the_default_method_are_those_of_the_code(text, value):
    assert text.format(value) in " ".join(PAGE.split())
