"""Points from text: one row a line, separators found from the first row, anything doubtful refused.

Columns are found by their names, in a header row or in a comment before the first row; see `quadriform.columns`.
"""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import permutations

import numpy as np

from quadriform.columns import AXES, Chosen, Columns, chosen_columns, columns_of, names_axes, unit_of
from quadriform.errors import ColumnsError, FileFormatError
from quadriform.files.numbers import check_last_number, to_number
from quadriform.files.reading import signature, utf8_text
from quadriform.point_sets import PointSet, naming_hint, unit_normals
from quadriform.points import Array, check_points

COUNT = re.compile(r"#\s*points:\s*(\d{1,15})\s*")
WITH_COUNT = ["x", "y", "z", "rows"]
QUOTED = re.compile(r'^"([^"]*)"$')
DECIMAL_COMMA = re.compile(r"[+-]?\d+,\d+([eE][+-]?\d+)?")
COMMENTS = ("#", "//", "%")
LINE_ENDS = (b"\n", b"\r")
SEPARATOR = re.compile(r"sep=([;,\t|])")
"""The first line that Excel writes and reads."""
LABEL = re.compile(r"(columns?|fields?|header|format|names?|data)\s*[:=]\s*", re.IGNORECASE)
UNIT_COMMENT = re.compile(r"(?:length\s+)?units?\s*[:=]\s*\"?(\S+?)\"?", re.IGNORECASE)
UNIT_AT_END = re.compile(r"([^\[(]*\S)\s+[\[(]([^\])]*)[\])]")
OTHER_ORDERS = {"".join(order) for letters in (AXES, "ijk") for order in permutations(letters)} - {AXES, "ijk"}
OF_IMAGES = ({"row"}, {"col", "column"}, {"slice", "plane"})
"""Words for the axes of an image, whose order in space a table does not define."""


@dataclass(frozen=True)
class _Text:
    """A table taken apart: the comments before its first row, and number and content of each row."""

    comments: list[str]
    rows: list[tuple[int, str]]
    separator: str | None
    count: int | None
    where: str

    def split(self, row: tuple[int, str]) -> list[str]:
        """The fields of a row."""
        return _split(row[1], self.separator, self.where, row[0])


def parse_table(data: bytes, where: str, columns: Chosen = None) -> PointSet:
    """Return the points of a text table, in the unit of the file, with normals where it has them.

    Accepted: UTF-8 with or without BOM, any line end, comments after `#`, `//` or `%`, blank lines, `sep=;` in the
    first line, one header row, and comma, semicolon, tab or spaces between the fields. The names of the columns, in the
    header row or in a comment before the first row, say which are x, y, z and nx, ny, nz; three columns without names
    are x, y, z. A table may state its number of rows: by a number alone in the first line, or as `write_points` does by
    `# points: 40` or by each value of a fourth column `rows`. Then it must have as many; and a table by `write_points`
    must end with a line end, without which the last number may be cut.

    Args:
        data: the bytes of the file.
        where: how error messages name the file.
        columns: which columns to take, as `chosen_columns` has it.

    Raises:
        ColumnsError: columns that cannot be distinguished.
        OptionError: columns that are not there.
        FileFormatError: not text, decimal commas, ragged rows or words among the numbers, with the line number; other
            rows than the first line declares.
    """
    lines = _lines(data, where)
    text = _parsed_lines(lines, where)
    first = text.split(text.rows[0])
    names, has_header = _names(text, first, columns)
    body = text.rows[has_header:]
    if declared := COUNT.fullmatch(lines[0]):
        _check_count(int(declared[1]), len(body), where)
        _check_end(data, where)
    if text.count is not None:
        _check_count(text.count, len(body), where)
    if has_header and [field.lower() for field in first] == WITH_COUNT:
        for stated in np.unique(_values(text, body, len(first), (3,))):
            _check_count(stated, len(body), where)
            _check_end(data, where)
    if body and body[-1][0] == len(lines) and not data.endswith(LINE_ENDS):
        check_last_number([text.split(row)[-1] for row in body], f"{where}, line {body[-1][0]}")
    return _point_set(text, body, names, len(first), columns)


def written_table(points: Array, suffix: str) -> str:
    """The text of points (n, 3): .csv with commas and a column `rows`, else blanks and the count as a comment."""
    if suffix != ".csv":
        return f"# points: {len(points)}\n" + "".join(" ".join(map(repr, row)) + "\n" for row in points.tolist())
    lines = (",".join(map(repr, row)) + f",{len(points)}\n" for row in points.tolist())
    return ",".join(WITH_COUNT) + "\n" + "".join(lines)


def _point_set(
    text: _Text, body: list[tuple[int, str]], names: list[str] | None, width: int, columns: Chosen
) -> PointSet:
    what = f"{text.where}, line {text.rows[0][0]}"
    if columns is not None:
        found = chosen_columns(columns, names, width, what)
    elif names is not None:
        found = columns_of(names, what)
    else:
        found = _unnamed(text, body, width, what)
    positions = found.points + (found.normals or ())
    values = _values(text, body, width, positions)
    points = check_points(values[:, :3], text.where)
    normals = None if found.normals is None else unit_normals(values[:, 3:], len(points), f"{text.where}: normals")
    unit = _common_unit(text, found, what)
    return PointSet(points, normals, unit, notes=(found.note,) if found.note else ())


def _values(text: _Text, body: list[tuple[int, str]], width: int, positions: tuple[int, ...]) -> Array:
    return np.array([_numbers(row, text, width, positions) for row in body], dtype=np.float64).reshape(
        -1, len(positions)
    )


# --- names of columns --------------------------------------------------------------------------------------------


def _names(text: _Text, first: list[str], columns: Chosen) -> tuple[list[str] | None, bool]:
    """The names of the columns, or None, and whether the first row holds them."""
    requested = columns.split(",") if isinstance(columns, str) else columns or ()
    has_numbers = any(to_number(field) is not None for field in first)
    if not has_numbers or names_axes(first) or (requested and _all_in(requested, first)):
        return first, True
    _check_numbered(text, first, bool(requested))
    found = [names for comment in text.comments if (names := _names_in(comment, text.separator, len(first), requested))]
    if any(columns_of(names, text.where) != columns_of(found[0], text.where) for names in found[1:]):
        raise ColumnsError(f"{text.where}: two comments name the columns differently; choose by --columns")
    return (found[0] if found else None), False


def _all_in(requested: Sequence[str | int], first: list[str]) -> bool:
    return all(isinstance(name, str) and name.strip() in first for name in requested)


def _check_numbered(text: _Text, first: list[str], is_chosen: bool) -> None:
    """Refuse a first row 0, 1, 2 ... that is no point but the numbers that pandas gives to columns without names."""
    numbers = first[1:] if first[0] == "" else first
    if numbers != list(map(str, range(len(numbers)))) or len(text.rows) < 2:
        return
    # A first row of whole numbers above whole numbers may be a point.
    whole = first[0] != "" and all(field.lstrip("+-").isdecimal() for field in text.split(text.rows[1]))
    if whole and (is_chosen or text.separator != ","):
        return
    raise ColumnsError(
        f"{text.where}, line {text.rows[0][0]}: the row {', '.join(first)} may be a point or the numbers of the "
        f"columns; of the columns, leave the line out or say --columns {','.join(numbers[:3])} (columns= in Python)"
        + ("; of a point, name the columns from left to right, as --columns x,y,z" if whole else "")
    )


def _names_in(comment: str, separator: str | None, width: int, requested: Sequence[str | int]) -> list[str] | None:
    """The names of the columns, where a comment has as many, with x, y and z or the requested ones among them."""
    text = LABEL.sub("", comment, count=1) if LABEL.match(comment) else comment
    if (end := UNIT_AT_END.fullmatch(text)) and unit_of(end[2]):
        text = end[1]
        suffix = f" [{end[2]}]"
    else:
        suffix = ""
    for each in dict.fromkeys([separator, ",", ";", "\t", None]):
        names = _fields(text, each)
        if len(names) == width and (names_axes(names) or (requested and _all_in(requested, names))):
            return [name + suffix for name in names]
    return None


def _unnamed(text: _Text, body: list[tuple[int, str]], width: int, what: str) -> Columns:
    """Three columns without names are x, y, z, where no comment says otherwise."""
    if width == 3:
        for comment in text.comments:
            if _may_name_another_order(comment):
                raise ColumnsError(
                    f"{text.where}: the comment {comment[:60]!r} may say that the columns are not x, y, z; name them "
                    "from left to right by --columns, such as z,y,x (columns= in Python)"
                )
        return Columns((0, 1, 2))
    if width < 3:
        raise ColumnsError(f"{what}: expected 3 columns x, y, z, or more with names, found {width}")
    raise ColumnsError(
        f"{what}: expected 3 columns, or a header that names x, y and z; found {width} columns without names"
        + _looks(text, body, width)
    )


def _may_name_another_order(comment: str) -> bool:
    """Whether the words of a comment are x, y and z in another order, or the axes of an image."""
    words = re.findall(r"[a-z]+", comment.lower())
    letters = ["".join(word for word in words if len(word) == 1 and word in axes) for axes in (AXES, "ijk")]
    return bool(OTHER_ORDERS & {*letters, *words}) or all(names & set(words) for names in OF_IMAGES)


def _looks(text: _Text, body: list[tuple[int, str]], width: int) -> str:
    """A hint how to name columns by what they look like; nothing about words among the numbers."""
    rows = [text.split(row) for row in body]
    numbers = [[to_number(field) for field in row] for row in rows if len(row) == width]
    every = np.array(numbers, dtype=np.float64).reshape(-1, width)  # NaN where there is no number
    whole = text.separator == "," and width == 6 and all(field.lstrip("+-").isdecimal() for field in rows[0])
    return naming_hint(every) + ("; decimal commas are not read" if whole else "")


def _common_unit(text: _Text, found: Columns, what: str) -> str:
    """The unit in the names of the columns, or that of a comment such as `# unit: mm`."""
    stated = [match[1] for comment in text.comments if (match := UNIT_COMMENT.fullmatch(comment))]
    units = {unit for word in stated if (unit := unit_of(word))} | ({found.unit} - {"unknown"})
    if len(units) > 1:
        raise ColumnsError(f"{what}: expected one unit of length, found {' and '.join(sorted(units))}")
    return next(iter(units), "unknown")


# --- lines and fields --------------------------------------------------------------------------------------------


def _check_count(declared: float, found: int, where: str) -> None:
    if declared != found:
        raise FileFormatError(f"{where}: the table says that it has {declared:.15g} points, found {found}")


def _check_end(data: bytes, where: str) -> None:
    if not data.endswith(LINE_ENDS):
        raise FileFormatError(
            f"{where}: the last line has no end: its last number may be cut; add a line end if it is not"
        )


def _lines(data: bytes, where: str) -> list[str]:
    text = utf8_text(data, where, "a text table")
    if "\0" in text:
        raise FileFormatError(f"{where}: expected a text table, found {signature(data)}")
    return text.splitlines() or [""]


def _parsed_lines(lines: list[str], where: str) -> _Text:
    """Comments, rows, separator, and the number of rows where the first line is nothing else."""
    given = SEPARATOR.fullmatch(lines[0].strip().strip('"'))
    comments: list[str] = []
    rows: list[tuple[int, str]] = []
    for number, line in enumerate(lines, 1):
        # A comment after the first row names no columns.
        prefix = next((prefix for prefix in COMMENTS if line.lstrip().startswith(prefix)), None)
        if prefix and not rows:
            comments.append(line.lstrip().lstrip("#/%! \t").rstrip())
        content = "" if prefix or (given and number == 1) else line.partition("#")[0].strip(" ")
        if content.strip():
            rows.append((number, content))
    if not rows:
        raise FileFormatError(f"{where}: the table has no rows; expected x y z on each line")
    # A whole number alone, above a row of three fields or more, is the count of an .xyz file.
    alone = len(rows) > 1 and re.fullmatch(r"\s*\d{1,15}\s*", rows[0][1])
    count = int(rows.pop(0)[1]) if alone and len(_fields(rows[1][1], _separator(rows[1][1]))) >= 3 else None
    separator = given[1] if given else _separator(rows[0][1])
    return _Text(comments, _without_last(rows, separator), separator, count, where)


def _without_last(rows: list[tuple[int, str]], separator: str | None) -> list[tuple[int, str]]:
    """The rows without the separator that ends each of them."""
    if separator and all(line.rstrip(" ").endswith(separator) for _, line in rows):
        return [(number, line.rstrip(" ")[:-1]) for number, line in rows]
    return rows


def _separator(line: str) -> str | None:
    for separator in ";\t,":
        if separator in line.strip():
            return separator
    return None  # any run of blanks


def _fields(line: str, separator: str | None) -> list[str]:
    """The fields of a line; blanks before a unit in brackets separate nothing."""
    if separator is None:
        line = re.sub(r"\s+(?=[\[(])", "", line)
    return [QUOTED.sub(r"\1", field.strip()) for field in line.split(separator)]


def _split(line: str, separator: str | None, where: str, number: int) -> list[str]:
    fields = _fields(line, separator)
    if "," in line:
        # Between "1, 2, 3" and "1,5 2,5 3,5" the blanks decide: in the second they stand inside the fields.
        blanks_inside = any(len(field.split()) > 1 for field in fields)
        # Only where blanks stand inside comma-separated fields can a comma be decimal.
        suspects = fields if separator != "," else line.split() if blanks_inside else []
        if any(DECIMAL_COMMA.fullmatch(suspect) for suspect in suspects):
            raise FileFormatError(f"{where}, line {number}: decimal commas are not read; write numbers with a point")
    return fields


def _numbers(row: tuple[int, str], text: _Text, width: int, positions: tuple[int, ...]) -> list[float | None]:
    fields = text.split(row)
    if len(fields) != width:
        raise FileFormatError(
            f"{text.where}, line {row[0]}: expected {width} columns as in the first row, found {len(fields)}"
        )
    chosen = [fields[position] for position in positions]
    values = [to_number(field) for field in chosen]
    if None in values:
        raise FileFormatError(f"{text.where}, line {row[0]}: expected numbers, found {chosen[values.index(None)]!r}")
    return values
