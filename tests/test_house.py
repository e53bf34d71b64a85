"""The house: small files and functions, docstrings, nothing that runs code from data, imports downwards and light."""

import ast
import importlib.util
import re
import subprocess
import sys
from functools import cache
from pathlib import Path

import numpy as np
import pytest

ROOT = Path(__file__).resolve().parents[1]
SOURCES = sorted((ROOT / "src").rglob("*.py"))
DEFINITIONS = (ast.FunctionDef, ast.AsyncFunctionDef, ast.ClassDef)
MOST_LINES = 30
FORBIDDEN = ("pickle", "eval(", "exec(", "yaml.load", "np.linalg.inv(", "np.random.seed", "shell=True", "os.system")


@cache
def parsed():
    """Path relative to the repository and syntax tree of every source file."""
    return [(str(path.relative_to(ROOT)), ast.parse(path.read_text(encoding="utf-8"))) for path in SOURCES]


def public_without_docstring(body, prefix=""):
    """Names of public functions and classes, and of public methods, without a docstring."""
    found = []
    for node in body:
        if isinstance(node, DEFINITIONS) and not node.name.startswith("_"):
            if not ast.get_docstring(node):
                found.append(prefix + node.name)
            if isinstance(node, ast.ClassDef):
                found += public_without_docstring(node.body, f"{node.name}.")
    return found


def lines_of_code(function, source):
    """Lines of a function's body with code on them: no blank lines, comments, docstrings or signature."""
    body = function.body[1:] if ast.get_docstring(function) else function.body
    lines = source[body[0].lineno - 1 : function.end_lineno] if body else []
    return sum(bool(line.strip()) and not line.strip().startswith("#") for line in lines)


def test_there_are_sources():
    assert len(SOURCES) > 25


def test_files_stay_under_400_lines():
    long = [path for path in SOURCES if len(path.read_text(encoding="utf-8").splitlines()) > 400]
    assert long == []


def test_functions_stay_under_the_limit_of_lines():
    long = []
    for name, tree in parsed():
        source = (ROOT / name).read_text(encoding="utf-8").splitlines()
        functions = [node for node in ast.walk(tree) if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef)]
        long += [(name, each.name) for each in functions if lines_of_code(each, source) > MOST_LINES]
    assert long == []


def test_lines_of_code_are_counted():
    text = 'def f(\n    a,\n):\n    """Docstring."""\n    # comment\n    b = a\n\n    return b\n'
    assert lines_of_code(ast.parse(text).body[0], text.splitlines()) == 2


def test_everything_public_has_a_docstring():
    undocumented = [(name, each) for name, tree in parsed() for each in public_without_docstring(tree.body)]
    assert undocumented == []
    assert [name for name, tree in parsed() if tree.body and not ast.get_docstring(tree)] == []


def test_nothing_runs_code_from_data_or_inverts_matrices():
    found = []
    for name, _ in parsed():
        code = ast.unparse(without_docstrings(ast.parse((ROOT / name).read_text(encoding="utf-8"))))
        found += [(name, word) for word in FORBIDDEN if word in code.replace("allow_pickle=False", "")]
    assert found == []


def without_docstrings(tree):
    """The tree with every string that stands alone taken out: prose may name what code may not do."""
    for node in ast.walk(tree):
        if isinstance(getattr(node, "body", None), list):
            alone = [e for e in node.body if isinstance(e, ast.Expr) and isinstance(e.value, ast.Constant)]
            node.body = [e for e in node.body if e not in alone] or [ast.Pass()]
    return tree


def test_no_validation_by_assert():
    """`python -O` takes asserts out."""
    assert [name for name, tree in parsed() if any(isinstance(node, ast.Assert) for node in ast.walk(tree))] == []


def test_slow_tests_are_listed_in_one_place():
    """Each line of tests/slow.txt, which `make slow` writes, names a test; none is marked beside it."""
    listed = (ROOT / "tests" / "slow.txt").read_text(encoding="utf-8").splitlines()
    assert listed == sorted(set(listed))
    texts = {path: path.read_text(encoding="utf-8") for path in sorted((ROOT / "tests").rglob("test_*.py"))}
    for line in listed:
        path, *names = line.split("::")
        text = texts.get(ROOT / path, "")
        assert all(re.search(rf"^ *(def|class) {name}\b", text, re.MULTILINE) for name in names) and names, line
    assert [str(path) for path, text in texts.items() if re.search(r"mark\.slow", text)] == []


def test_no_machine_paths_in_the_project():
    for path in [*SOURCES, *ROOT.glob("*.md"), *ROOT.glob("docs/**/*.md"), ROOT / "pyproject.toml", ROOT / "Makefile"]:
        text = path.read_text(encoding="utf-8")
        assert "/home/" not in text and "/tmp/" not in text, path


def test_importing_is_light():
    script = (
        "import sys, quadriform, quadriform.cli.main\n"
        "heavy = {'matplotlib', 'skimage', 'nibabel', 'trimesh', 'scipy.ndimage', 'scipy.stats', 'http.client'}\n"
        "print(sorted(heavy & set(sys.modules)))\n"
        "import quadriform; quadriform.fit\n"
        "print(sorted(heavy & set(sys.modules) - {'scipy.ndimage'}))"
    )
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, encoding="utf-8", check=True)
    assert done.stdout.splitlines() == ["[]", "[]"], done.stdout


@pytest.mark.parametrize("method", ["tangent", "paper"])
def test_points_pass_through_few_modules(method):
    """The path of the data through a fit can be followed from one module to the next."""
    import quadriform

    spec = importlib.util.spec_from_file_location("path", ROOT / "benchmarks" / "path.py")
    path = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(path)
    points = quadriform.Superquadric("ellipsoid", (30, 20, 15), (0.8, 1.2)).grid(20)[0]
    points = points + np.random.default_rng(0).normal(0, 0.3, points.shape)
    assert len(path.modules(points, method)) <= 15


def test_every_public_name_is_there():
    import quadriform

    for name in quadriform.__all__:
        assert getattr(quadriform, name).__doc__
    assert set(dir(quadriform)) == set(quadriform.__all__)
    with pytest.raises(AttributeError, match="no_such_name"):
        quadriform.no_such_name  # noqa: B018


def test_imports_point_downwards():
    """The contract in the project file; skipped aloud where the checker is not installed."""
    checker = Path(sys.executable).with_name("lint-imports")
    if not checker.exists():
        pytest.skip("import-linter is not installed beside this Python")
    done = subprocess.run([checker, "--no-cache"], cwd=ROOT, capture_output=True, encoding="utf-8", errors="replace")
    assert done.returncode == 0, done.stdout


def test_the_table_where_is_names_what_there_is():
    """Of each row at most two files, and in each the function, class or constant that is named."""
    table = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8").partition("## Where is")[2].partition("\n## ")[0]
    rows = [line.split("|")[1:3] for line in table.splitlines() if "`src/" in line]
    assert len(rows) >= 13
    for what, where in rows:
        places = re.findall(r"`(src/[\w/.]+)(?::([\w.]+))?`", where)
        assert 1 <= len({path for path, _ in places}) <= 2, what
        for path, name in places:
            text = (ROOT / path).read_text(encoding="utf-8")
            for part in filter(None, name.split(".")):
                named = rf"^ *(?:def|class) {part}\b|^{part}\b.* = "  # a constant too
                assert re.search(named, text, re.MULTILINE), (path, part)
        equation = re.match(r" (P\d+),", what)
        marked = "".join((ROOT / path).read_text(encoding="utf-8") for path, _ in places)
        assert equation is None or re.search(rf"\b{equation[1]}\b", marked), what
