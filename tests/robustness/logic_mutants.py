"""Random changes of what is computed, in a copy: a test must fail. logic_mutants.py [COUNT] [SEED] (`make mutants`).

The sites are all places in shapes, fitting, motion, heart, imaging and files where one of these changes is possible:

- plus and minus, times and divided by exchanged; a power made a product; a sign left out
- a comparison turned round; with a whole number its border moved by one
- `and` and `or` exchanged, `not` left out
- a number in an expression: a whole one and 0.0 plus 1, another times 1.1
- a statement without a value left out: a call, `x += ...`
- the first two arguments of a call exchanged, where both are names and their order matters

Left out are checks of what is given (`if` with nothing but `raise`; functions named check, and calls of them), messages
(what stands in `raise` and in texts), types, and what only tunes how well or how fast: the constants at the head of a
module and numbers below 1e-6, which keep divisions from zero; and the -1 of `reshape`, in whose place NumPy takes any
negative number. Sites are drawn with a seed, each file at most twice.

Prints one line for each with the test that failed first, or why no test can notice it; exits with 1 where more than two
survive, or one without an explanation.
"""

import ast
import copy
import hashlib
import re
import signal
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from pathlib import Path

from mutants import ROOT, copied, tested

PACKAGES = ("shapes", "fitting", "motion", "heart", "imaging", "files")
CALLED = ast.Constant | ast.Call
SYMMETRIC = ("min", "max", "minimum", "maximum", "array_equal", "_dot")
CHECK = re.compile(r"(?:[\w.]*\.)?_?(?:check|refuse|must)")
FAILED = re.compile(r"^(?:FAILED|ERROR) tests/(.+?)(?: - .*)?$", re.MULTILINE)
"""The test of a line of pytest's summary; its name may have spaces."""
OF_FILE = MOST = 2
"""Sites of one file, and survivors."""
TINY = 1e-6
LIMIT = 400
"""Seconds of the processor for a run of tests, however busy it is; a change after which they do not end is noticed."""
WIDER = {
    "shapes": ["fitting", "properties"],
    "fitting": ["properties", "robustness/test_bad_inputs.py"],
    "motion": ["heart", "cli/test_track.py"],
    "heart": ["cli/test_measure.py", "report"],
    "imaging": ["cli"],
    "files": ["robustness/test_mesh_dialects.py", "robustness/test_table_dialects.py", "cli", "cohort"],
}
SWAPPED = {ast.Add: ast.Sub, ast.Sub: ast.Add, ast.Mult: ast.Div, ast.Div: ast.Mult, ast.Pow: ast.Mult}
TURNED = {ast.Lt: ast.GtE, ast.LtE: ast.Gt, ast.Gt: ast.LtE, ast.GtE: ast.Lt, ast.Eq: ast.NotEq, ast.NotEq: ast.Eq}
BORDER = {ast.Lt: ast.LtE, ast.LtE: ast.Lt, ast.Gt: ast.GtE, ast.GtE: ast.Gt}
TURNED |= {ast.Is: ast.IsNot, ast.IsNot: ast.Is, ast.In: ast.NotIn, ast.NotIn: ast.In}
KNOWN: dict[str, str] = {
    "shapes/mesh_points.py: _unit_corners: `2` -> `3`": (
        "another unit of length, in which nothing but the cells of the curve that orders triangles is measured"
    ),
    "imaging/object_choice.py: choose_object: `0.5` -> `0.55`": "an image of zeros is empty above any threshold",
    "shapes/comparison.py: _sampled: `0.5` -> `0.55`": "other samples of the same steps of the area, as even as those",
    "files/stl.py: _merged: `1` -> `2`": "rolled by two corners of three, the same edges start at their other ends",
    "shapes/ridges.py: _octants: `own[index] * mirror` -> `own[index] / mirror`": "both are 1 or -1",
    "shapes/ridges.py: _hole: `0.0` -> `1.0`": "asked of kinds with a hole alone",
    "shapes/ridges.py: _octants: `0.0` -> `1.0`": "asked of kinds with a hole alone",
    "shapes/ridges.py: _parts: `0.0` -> `1.0`": "stands where nothing is scanned, and is not read there",
    "shapes/closest.py: _extreme: `1` -> `2`": "one more place in an array, which nothing reads",
    "shapes/voxels.py: voxel_spacing: `3` -> `4`": "the last row of an affine map has zeros in these columns",
    "shapes/fold_bound.py: possible_folds: "
    "`box.jacobian_determinant(points) <= 0` -> `box.jacobian_determinant(points) < 0`": (
        "no determinant is zero to the last bit"
    ),
    "fitting/superquadric/initial.py: sides: `points - centre` -> `points + centre`": (
        "heights are compared with quantiles of themselves, which move with them"
    ),
    "fitting/superquadric/initial.py: bound_of_axes: `values ** 2` -> `values * 2`": (
        "these are only asked whether they are equal"
    ),
    "fitting/superquadric/initial.py: principal_axes: `1.0` -> `1.1`": "the same factor on all points changes no axis",
    "fitting/refinement/starts.py: nested: `scale < 1` -> `scale <= 1`": "a copy of the same size is the same surface",
    "fitting/refinement/left_out.py: _patch_of: `points - points.mean(axis=0)` -> `points + points.mean(axis=0)`": (
        "the order decides between points that are equally far only, and any order serves"
    ),
}
"""From a change, as it is printed, to why no test can notice it; it counts as survived, and no test is run."""


@dataclass(frozen=True)
class Change:
    """The number of a site in the walk over its file, and which of its changes."""

    file: str
    at: int
    which: int


def walk(node: ast.AST, above: tuple[ast.AST, ...] = ()) -> Iterator[tuple[ast.AST, tuple[ast.AST, ...]]]:
    """Every node that may be changed, and those below it, with those above it."""
    yield node, above
    for child in ast.iter_child_nodes(node):
        if not is_left_out(node, child):
            yield from walk(child, (*above, node))


def is_left_out(outer: ast.AST, inner: ast.AST) -> bool:
    """Whether a part of a node belongs to checks, messages, types or the constants of a module."""
    if isinstance(outer, ast.Raise | ast.JoinedStr | ast.AnnAssign | ast.arguments | ast.ExceptHandler):
        return True
    if isinstance(inner, ast.Expr) and isinstance(inner.value, ast.Call) and CHECK.match(ast.unparse(inner.value.func)):
        return True
    if isinstance(inner, ast.If) and all(isinstance(each, ast.Raise) for each in inner.body) and not inner.orelse:
        return True
    if isinstance(inner, ast.FunctionDef) and CHECK.match(inner.name):
        return True
    if isinstance(outer, ast.Call) and getattr(outer.func, "attr", "") == "reshape" and isinstance(inner, ast.UnaryOp):
        return True
    if isinstance(outer, ast.FunctionDef):
        return inner in outer.decorator_list or inner is outer.returns
    return isinstance(outer, ast.Module | ast.ClassDef) and not isinstance(inner, ast.FunctionDef | ast.ClassDef)


def variants(node: ast.AST) -> list[ast.AST | None]:
    """What a node may be changed to; None is a statement left out."""
    if not isinstance(node, ast.BinOp | ast.AugAssign | ast.Expr | ast.Compare | ast.BoolOp | ast.UnaryOp | CALLED):
        return []
    made = copy.copy(node)  # its parts are those of the node, which nothing below changes
    if isinstance(made, ast.BinOp) and type(made.op) in SWAPPED and not is_text(made):
        made.op = SWAPPED[type(made.op)]()
        return [made]
    if isinstance(made, ast.AugAssign) or (isinstance(made, ast.Expr) and isinstance(made.value, ast.Call)):
        return [None]
    if isinstance(made, ast.Compare) and len(made.ops) == 1:
        return compared(made)
    if isinstance(made, ast.BoolOp):
        made.op = ast.Or() if isinstance(made.op, ast.And) else ast.And()
        return [made]
    if isinstance(made, ast.UnaryOp) and isinstance(made.op, ast.USub | ast.Not):
        return [made.operand]
    if isinstance(made, ast.Constant) and isinstance(made.value, int | float) and not isinstance(made.value, bool):
        if 0 < abs(made.value) < TINY:
            return []
        return [ast.Constant(made.value + 1 if made.value == 0 or isinstance(made.value, int) else made.value * 1.1)]
    if isinstance(made, ast.Call) and len(made.args) >= 2 and named_apart(made.args[:2]) and not is_symmetric(made):
        made.args = [made.args[1], made.args[0], *made.args[2:]]
        return [made]
    return []


def is_symmetric(call: ast.Call) -> bool:
    """Whether the order of arguments does not matter."""
    return getattr(call.func, "attr", getattr(call.func, "id", "")) in SYMMETRIC


def named_apart(nodes: list[ast.expr]) -> bool:
    """Whether two arguments are names, and not the same."""
    names = [node.id for node in nodes if isinstance(node, ast.Name)]
    return len(set(names)) == len(nodes)


def compared(node: ast.Compare) -> list[ast.AST | None]:
    """The comparison turned round, and with a whole number its border moved."""
    kind = type(node.ops[0])
    found: list[ast.AST | None] = []
    whole = any(
        isinstance(side, ast.Constant) and isinstance(side.value, int) for side in (node.left, *node.comparators)
    )
    for table in (TURNED, BORDER if whole else {}):
        if kind in table:
            made = copy.copy(node)
            made.ops = [table[kind]()]
            found.append(made)
    return found


def is_text(node: ast.BinOp) -> bool:
    return any(
        isinstance(side, ast.JoinedStr) or isinstance(getattr(side, "value", None), str)
        for side in (node.left, node.right)
    )


def changes(file: Path) -> list[Change]:
    """All changes of a file."""
    name = file.relative_to(ROOT / "src" / "quadriform").as_posix()
    return [Change(name, at, which) for at, (node, _) in enumerate(sites(name)) for which in range(len(variants(node)))]


@cache
def sites(name: str) -> list[tuple[ast.AST, tuple[ast.AST, ...]]]:
    """The walk over a file as it is, by its name in the package; nothing may be changed in it."""
    return list(walk(ast.parse((ROOT / "src" / "quadriform" / name).read_text(encoding="utf-8"))))


def place(change: Change) -> str:
    """The file and the function of a change."""
    _, above = sites(change.file)[change.at]
    inside = next((each.name for each in reversed(above) if isinstance(each, ast.FunctionDef)), "")
    return f"{change.file}: {inside}"


def described(change: Change) -> str:
    """A change in words: file, function, and what becomes of what."""
    node, _ = sites(change.file)[change.at]
    made = variants(node)[change.which]
    after = "left out" if made is None else ast.unparse(made)
    return f"{place(change)}: `{' '.join(ast.unparse(node).split())}` -> `{' '.join(after.split())}`"


@cache
def every_change() -> tuple[Change, ...]:
    """All changes of all packages."""
    files = sorted(file for package in PACKAGES for file in (ROOT / "src" / "quadriform" / package).rglob("*.py"))
    return tuple(change for file in files for change in changes(file))


def drawn(count: int, seed: int) -> list[Change]:
    """A sample of changes, the same for one seed, and little else where some of the code changes."""
    shuffled = sorted(every_change(), key=lambda change: hashlib.sha256(f"{seed} {change}".encode()).digest())
    taken: list[Change] = []
    of_file: Counter[str] = Counter()
    for change in shuffled:
        if of_file[change.file] < OF_FILE and len(taken) < count:
            taken.append(change)
            of_file[change.file] += 1
    return taken


def changed(text: str, change: Change) -> str:
    """The text of a file after a change."""
    tree = ast.parse(text)
    node, above = list(walk(tree))[change.at]
    made = variants(node)[change.which]
    new = ast.Pass() if made is None else made
    for _, value in ast.iter_fields(above[-1]):
        if isinstance(value, list) and any(each is node for each in value):
            value[[each is node for each in value].index(True)] = new
    for name, value in ast.iter_fields(above[-1]):
        if value is node:
            setattr(above[-1], name, new)
    return ast.unparse(ast.fix_missing_locations(tree))


def stages(file: str) -> Iterator[list[str]]:
    """Tests of a file: that of its name, those that import it, those of its folder, and wider ones."""
    package, module = file.split("/")[0], Path(file).stem
    own = sorted(
        path.relative_to(ROOT / "tests").as_posix() for path in (ROOT / "tests" / package).glob(f"test_{module}*.py")
    )
    dotted = f"quadriform.{file[:-3].replace('/', '.')}"
    word = re.compile(rf"{re.escape(dotted)}\b|from {re.escape(dotted.rpartition('.')[0])} import [^\n]*\b{module}\b")
    users = [
        path.relative_to(ROOT / "tests").as_posix()
        for path in sorted((ROOT / "tests").rglob("test_*.py"))
        if word.search(path.read_text(encoding="utf-8")) and "fuzz" not in path.name
    ]
    seen: set[str] = set()
    for names in (own, users, [package], WIDER[package]):
        fresh = [name for name in names if name not in seen]
        seen.update(fresh)
        if fresh:
            yield fresh


def noticed(change: Change, folder: Path, environment: dict[str, str], broken: set[str]) -> str:
    """The first test that fails after a change and not before it; empty where none does."""
    path = folder / "src" / "quadriform" / change.file
    text = path.read_text(encoding="utf-8")
    try:
        path.write_text(changed(text, change), encoding="utf-8")
        for names in stages(change.file):
            while True:
                options = [f"--deselect=tests/{name}" for name in sorted(broken)]
                try:
                    done = tested(names, folder, environment, options, LIMIT)
                except subprocess.TimeoutExpired:
                    return "tests that do not end"
                if done.returncode == -signal.SIGXCPU:
                    return "tests that do not end"
                failed = FAILED.search(done.stdout)
                if not failed:
                    if done.returncode not in (0, 5):  # 5: no tests
                        return "tests that cannot be begun"
                    break
                path.write_text(text, encoding="utf-8")
                if tested([failed[1]], folder, environment, (), LIMIT).returncode == 0:
                    return failed[1]
                broken.add(failed[1])
                path.write_text(changed(text, change), encoding="utf-8")
    finally:
        path.write_text(text, encoding="utf-8")
    return ""


def main() -> int:
    count, seed = (int(word) for word in (*sys.argv[1:], *("40", "21")[len(sys.argv) - 1 :]))
    survived, broken = [], set[str]()
    with copied() as (folder, environment):
        for number, change in enumerate(drawn(count, seed), 1):
            began, text = time.monotonic(), described(change)
            by = "" if text in KNOWN else noticed(change, folder, environment, broken)
            said = by or KNOWN.get(text, "SURVIVED")
            print(f"{number}. {text}: {said} ({time.monotonic() - began:.0f} s)", flush=True)
            survived += [] if by else [text]
    unknown = [each for each in survived if each not in KNOWN]
    print(f"{len(survived)} of {count} survived, {len(survived) - len(unknown)} of them explained; seed {seed}")
    if broken:
        print(f"fail by themselves: {', '.join(sorted(broken))}")
    return int(len(survived) > MOST or bool(unknown))


if __name__ == "__main__":
    sys.exit(main())
