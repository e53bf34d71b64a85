"""docs/equations.md is true in both directions: markers in the source against rows of the table."""

import ast
import io
import re
import tokenize
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
MARKER = re.compile(r"#\s*P\d+\b")
SECTIONS = {"2.2", "2.4", "3.2.2", "3.3", "3.4.2"}


def rows():
    """(paper, module:function, test) of each row."""
    lines = (ROOT / "docs" / "equations.md").read_text(encoding="utf-8").splitlines()
    cells = [[cell.strip(" `") for cell in line.strip("| ").split(" | ")] for line in lines if line.startswith("|")]
    return [(paper, where, test) for paper, _, where, test in cells[2:]]


def functions(tree):
    """Qualified name and node of each function and method; what is nested in a function belongs to it."""
    for node in tree.body:
        if isinstance(node, ast.FunctionDef):
            yield node.name, node
        elif isinstance(node, ast.ClassDef):
            yield from (
                (f"{node.name}.{method.name}", method) for method in node.body if isinstance(method, ast.FunctionDef)
            )


def markers_of(path):
    """(equation, function) of each marker comment of a source file."""
    text = path.read_text(encoding="utf-8")
    spans = [(node.lineno, node.end_lineno, name) for name, node in functions(ast.parse(text))]
    for token in tokenize.generate_tokens(io.StringIO(text).readline):
        if token.type == tokenize.COMMENT and MARKER.match(token.string):
            holders = [name for first, last, name in spans if first <= token.start[0] <= last]
            assert holders, f"{path}:{token.start[0]}: a marker outside any function"
            yield from ((equation, holders[0]) for equation in re.findall(r"\bP\d+\b", token.string))


@cache
def all_markers():
    """Every (equation, module:function) that the source claims."""
    found = set()
    for path in sorted((ROOT / "src").rglob("*.py")):
        module = ".".join(path.relative_to(ROOT / "src").with_suffix("").parts)
        found |= {(equation, f"{module}:{name}") for equation, name in markers_of(path)}
    return found


def test_every_marker_has_its_row():
    assert all_markers() - {(paper, where) for paper, where, _ in rows()} == set()


@pytest.mark.parametrize(("paper", "where", "test"), rows(), ids=[f"{r[0]}-{r[1].split(':')[1]}" for r in rows()])
def test_every_row_is_true(paper, where, test):
    module, name = where.split(":")
    path = ROOT / "src" / (module.replace(".", "/") + ".py")
    assert name in dict(functions(ast.parse(path.read_text(encoding="utf-8"))))
    if paper.startswith("P"):
        assert (paper, where) in all_markers()
    else:
        assert re.search(rf"(?<![\d.]){re.escape(paper)}(?![\d.]*\d)", path.read_text(encoding="utf-8")), (
            f"{module} names no section {paper}"
        )
    test_file, test_name = test.split("::")
    assert test_name.startswith("test_")
    assert test_name in dict(functions(ast.parse((ROOT / test_file).read_text(encoding="utf-8"))))


NAMED = sorted(
    set(re.findall(r"`quadriform\.([a-z_.]+):([\w.]+)`", (ROOT / "docs" / "equations.md").read_text(encoding="utf-8")))
)


@pytest.mark.parametrize(("module", "name"), NAMED)
def test_every_named_function_is_there(module, name):
    """Also those of the default method, which no equation of the paper stands for."""
    path = ROOT / "src" / "quadriform" / (module.replace(".", "/") + ".py")
    assert name in dict(functions(ast.parse(path.read_text(encoding="utf-8"))))


def test_every_equation_of_the_paper_has_a_row():
    assert {paper for paper, _, _ in rows()} == {f"P{n}" for n in range(1, 20)} | SECTIONS
