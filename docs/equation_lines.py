"""Where the equations of the paper are in the source: file and line of each marker comment such as `# P5`.

python docs/equation_lines.py prints them; the site's page of equations has them in its table.
"""

import ast
import io
import re
import tokenize
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
SOURCE = ROOT / "src"
LABEL = re.compile(r"\bP\d+\b|\bsection [\dA][.\d]*\d|\bsection \d\b")
MARKER = re.compile(rf"#\s*(?:{LABEL.pattern})")
ROW = re.compile(r"^\| (P\d+|section [\d.A]+) \|.*?`(quadriform[\w.]*:[\w.]+)`", re.MULTILINE)


def functions(tree: ast.Module) -> Iterator[tuple[str, ast.FunctionDef]]:
    """Qualified name and node of each function and method; what is nested in a function belongs to it."""
    for node in tree.body:
        if isinstance(node, ast.FunctionDef):
            yield node.name, node
        elif isinstance(node, ast.ClassDef):
            yield from (
                (f"{node.name}.{method.name}", method) for method in node.body if isinstance(method, ast.FunctionDef)
            )


def markers(path: Path) -> Iterator[tuple[str, str, int]]:
    """(label, function, line) of each marker comment of a source file."""
    text = path.read_text(encoding="utf-8")
    if not MARKER.search(text):  # most files have none, and to read all as Python takes a second
        return
    spans = [(node.lineno, node.end_lineno or node.lineno, name) for name, node in functions(ast.parse(text))]
    for token in tokenize.generate_tokens(io.StringIO(text).readline):
        if token.type == tokenize.COMMENT and MARKER.match(token.string):
            line = token.start[0]
            holders = [name for first, last, name in spans if first <= line <= last]
            if not holders:
                raise ValueError(f"{path}:{line}: a marker outside any function")
            yield from ((label, holders[0], line) for label in LABEL.findall(token.string))


def lines() -> dict[tuple[str, str], str]:
    """(label, module:function) of all markers of the source, and where each is: "file:line" of its first."""
    found: dict[tuple[str, str], str] = {}
    for path in sorted(SOURCE.rglob("*.py")):
        module = ".".join(path.relative_to(SOURCE).with_suffix("").parts)
        for label, name, line in markers(path):
            found.setdefault((label, f"{module}:{name}"), f"{path.relative_to(ROOT).as_posix()}:{line}")
    return found


def with_lines(page: str) -> str:
    """The text of a page with the file and line beside each function of its table."""
    where = lines()
    return ROW.sub(lambda row: f"{row[0]} ({where[row[1], row[2]]})", page)


if __name__ == "__main__":
    for (equation, function), line in lines().items():
        print(equation, function, line)
