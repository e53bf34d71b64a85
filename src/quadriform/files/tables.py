"""Points from text: one row a line, separators found from the first row, anything doubtful refused."""

import math
import re

import numpy as np

from quadriform.errors import FileFormatError
from quadriform.files.reading import signature
from quadriform.points import Array

COUNT = re.compile(r"#\s*points:\s*(\d+)\s*")
WITH_COUNT = ["x", "y", "z", "rows"]
QUOTED = re.compile(r'^"([^"]*)"$')
DECIMAL_COMMA = re.compile(r"[+-]?\d+,\d+([eE][+-]?\d+)?")


def parse_table(data: bytes, where: str) -> Array:
    """Return the points (n, 3) of a text table.

    Accepted: UTF-8 with or without BOM, any line end, comments after `#`, blank lines, one header row, and comma,
    semicolon, tab or spaces between the fields. Three columns are x, y, z; with more, a header must name x, y and z.
    A first line `# points: 40` must be the number of rows, and so must each value of a fourth column `rows`; the last
    line must then end: only so is a file that was cut no shorter one.

    Args:
        data: the bytes of the file.
        where: how error messages name the file.

    Raises:
        FileFormatError: not text, decimal commas, ragged rows or words among the numbers, with the line number; other
            rows than the first line promises.
    """
    lines = _lines(data, where)
    rows = _rows(lines, where)
    separator = _separator(rows[0][1])
    header = _split(rows[0][1], separator, where, rows[0][0])
    has_names = not any(_is_number(field) for field in header)
    columns = _columns(header if has_names else [], len(header), f"{where}, line {rows[0][0]}")
    if promised := COUNT.fullmatch(lines[0]):
        _check_count(int(promised[1]), len(rows) - has_names, data, where)
    with_count = [field.lower() for field in header] == WITH_COUNT
    chosen = [*columns, WITH_COUNT.index("rows")] if with_count else columns
    numbers = [_numbers(row, separator, len(header), chosen, where) for row in rows[has_names:]]
    table = np.array(numbers).reshape(-1, len(chosen))
    for promise in np.unique(table[:, 3:]):
        _check_count(promise, len(table), data, where)
    return np.ascontiguousarray(table[:, :3])


def written_table(points: Array, suffix: str) -> str:
    """The text of points (n, 3): .csv with commas and a column `rows`, else blanks and the count as a comment."""
    if suffix != ".csv":
        return f"# points: {len(points)}\n" + "".join(" ".join(map(repr, row)) + "\n" for row in points.tolist())
    lines = (",".join(map(repr, row)) + f",{len(points)}\n" for row in points.tolist())
    return ",".join(WITH_COUNT) + "\n" + "".join(lines)


def _check_count(promised: float, found: int, data: bytes, where: str) -> None:
    if promised != found:
        raise FileFormatError(f"{where}: the table says that it has {promised:.15g} points, found {found}")
    if not data.endswith((b"\n", b"\r")):
        raise FileFormatError(
            f"{where}: the last line has no end: its last number may be cut; add a line end if it is not"
        )


def _lines(data: bytes, where: str) -> list[str]:
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise FileFormatError(
            f"{where}: expected a text table in UTF-8, found {signature(data)} (byte {error.start})"
        ) from error
    if "\0" in text:
        raise FileFormatError(f"{where}: expected a text table, found {signature(data)}")
    return text.splitlines() or [""]


def _rows(lines: list[str], where: str) -> list[tuple[int, str]]:
    """Line numbers and contents of the lines that hold something."""
    bare = ((number, line.split("#", 1)[0].strip()) for number, line in enumerate(lines, 1))
    rows = [(number, line) for number, line in bare if line]
    if not rows:
        raise FileFormatError(f"{where}: the table has no rows; expected x y z on each line")
    return rows


def _separator(line: str) -> str | None:
    for separator in ";\t,":
        if separator in line:
            return separator
    return None  # any run of blanks


def _split(line: str, separator: str | None, where: str, number: int) -> list[str]:
    fields = [QUOTED.sub(r"\1", field.strip()) for field in line.split(separator)]
    if "," in line:
        # Between "1, 2, 3" and "1,5 2,5 3,5" the blanks decide: in the second they stand inside the fields.
        blanks_inside = any(len(field.split()) > 1 for field in fields)
        suspects = fields if separator != "," else line.split() if blanks_inside else []
        if any(DECIMAL_COMMA.fullmatch(suspect) for suspect in suspects):
            raise FileFormatError(f"{where}, line {number}: decimal commas are not read; write numbers with a point")
    return fields


def _columns(names: list[str], width: int, where: str) -> list[int]:
    lower = [name.lower() for name in names]
    if all(axis in lower for axis in "xyz"):
        return [lower.index(axis) for axis in "xyz"]
    if width != 3:
        raise FileFormatError(
            f"{where}: expected 3 columns, or a header row that names x, y and z; found {width} columns "
            "(decimal commas are not read)"
        )
    return [0, 1, 2]


def _numbers(row: tuple[int, str], separator: str | None, width: int, columns: list[int], where: str) -> list[float]:
    number, line = row
    fields = _split(line, separator, where, number)
    if len(fields) != width:
        raise FileFormatError(
            f"{where}, line {number}: expected {width} columns as in the first row, found {len(fields)}"
        )
    chosen = [fields[column] for column in columns]
    values = [_to_number(field) for field in chosen]
    if None in values:
        raise FileFormatError(f"{where}, line {number}: expected numbers, found {chosen[values.index(None)]!r}")
    return [math.nan if value is None else value for value in values]


def _to_number(field: str) -> float | None:
    try:
        return None if "_" in field else float(field)  # Python reads 1_000 as a number; a table must not
    except ValueError:
        return None


def _is_number(field: str) -> bool:
    return _to_number(field) is not None
