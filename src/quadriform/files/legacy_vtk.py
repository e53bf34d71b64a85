"""VTK's older files (.vtk), ASCII and binary, as far as they hold polygons."""

import re
from typing import Any

import numpy as np
from numpy.typing import NDArray

from quadriform.errors import FileFormatError
from quadriform.files.numbers import check_last_index, check_last_number, count_of, floats, whole
from quadriform.files.polygons import NO_CELLS, Cells, Polygons
from quadriform.files.reading import check_budget, signature

TYPES = {"float": ">f4", "double": ">f8", "char": ">i1", "unsigned_char": ">u1", "short": ">i2", "int": ">i4"}
TYPES |= {"unsigned_short": ">u2", "unsigned_int": ">u4", "long": ">i8", "unsigned_long": ">u8", "vtkidtype": ">i4"}
TYPES |= {f"vtktype{sign}int{8 * size}": f">{sign or 'i'}{size}" for sign in ("", "u") for size in (1, 2, 4, 8)}
HEAD = re.compile(rb"# vtk DataFile Version (\d+)\.\d+[^\n]*\n[^\n]*\n\s*(ASCII|BINARY)\s*?\n", re.IGNORECASE)
CELLS = ("vertices", "lines", "polygons", "triangle_strips")
END = ("point_data", "cell_data")


def parse_legacy_vtk(data: bytes, where: str) -> Polygons:
    """Vertices, polygons and triangle strips of a .vtk file; lines, single vertices and fields are passed over.

    Raises:
        FileFormatError: no such file, another data set than POLYDATA, cut short, or counts that do not agree.
        FileLimitError: a header declares more than the budget.
    """
    head = HEAD.match(data)
    if head is None:
        raise FileFormatError(f"{where}: expected a legacy VTK file, found {signature(data)}")
    cursor = _Cursor(data, head.end(), head[2].upper() == b"BINARY", where)
    words = cursor.line()
    if [word.lower() for word in words] != ["dataset", "polydata"]:
        raise FileFormatError(f"{where}: expected DATASET POLYDATA, found {' '.join(words)[:60]!r}")
    sections = _sections(cursor, int(head[1]) >= 5)
    cells = (sections.get(name, NO_CELLS) for name in ("polygons", "triangle_strips"))
    return Polygons.with_strips(sections.get("points", np.empty(0)), *cells)


class _Cursor:
    """A place in the file; `where` is for messages, `last` are the numbers that end the file without a line end."""

    def __init__(self, data: bytes, at: int, binary: bool, where: str) -> None:
        self.data, self.at, self.binary, self.where = data, at, binary, where
        self.last: list[bytes] = []

    def line(self) -> list[str]:
        """Words of the next line that is not blank; none at the end."""
        while self.at < len(self.data):
            end = self.data.find(b"\n", self.at)
            end = len(self.data) if end < 0 else end
            words = self.data[self.at : end].decode("ascii", "surrogateescape").split()
            self.at = end + 1
            if words:
                return words
        return []

    def values(self, count: int, kind: str) -> NDArray[Any]:
        """Numbers (count,) of a type of VTK."""
        if kind.lower() not in TYPES:
            raise FileFormatError(f"{self.where}: expected numbers of a type of VTK, found {kind[:60]!r}")
        dtype = np.dtype(TYPES[kind.lower()])
        check_budget(count * dtype.itemsize, self.where)
        if self.binary:
            if count * dtype.itemsize > len(self.data) - self.at:
                raise FileFormatError(f"{self.where}: {count} numbers declared, found {len(self.data) - self.at} bytes")
            values = np.frombuffer(self.data, dtype, count, self.at)
            self.at += count * dtype.itemsize
            return values
        words = self.data[self.at :].split(None, count)
        if len(words) < count:
            raise FileFormatError(f"{self.where}: {count} numbers declared, found {len(words)}")
        # The last of the split parts is the rest of the file: its length gives the end of the numbers.
        self.at = len(self.data) - (len(words[count]) if len(words) > count else 0)
        self.last = words if len(words) == count and not self.data[-1:].isspace() else []
        values = floats(words[:count], self.where)
        return values.astype(dtype) if dtype.kind == "f" else whole(values, self.where)


def _sections(cursor: _Cursor, offsets: bool) -> dict[str, Any]:
    """Points and cells by the names of their sections."""
    found: dict[str, Any] = {}
    while (words := cursor.line()) and words[0].lower() not in END:
        match [words[0].lower(), *words[1:]]:
            case ["points", count, kind]:
                found["points"] = cursor.values(3 * count_of(count, cursor.where), kind)
                check_last_number(
                    [word.decode("ascii", "backslashreplace") for word in cursor.last[2::3]], cursor.where
                )
            case [name, first, second] if name in CELLS:
                read = _cells_by_offsets if offsets else _cells_by_lengths
                found[name] = read(cursor, count_of(first, cursor.where), count_of(second, cursor.where))
                if cursor.last and len(found[name][0]):
                    check_last_index(int(found[name][0][-1]), len(found.get("points", ())) // 3 - 1, cursor.where)
            case ["metadata", *_]:
                _pass_metadata(cursor)
            case ["field", _, count]:
                for _ in range(count_of(count, cursor.where)):
                    _pass_field(cursor)
            case _:
                raise FileFormatError(f"{cursor.where}: expected a section of POLYDATA, found {' '.join(words)[:60]!r}")
    return found


def _cells_by_offsets(cursor: _Cursor, n_offsets: int, n_corners: int) -> Cells:
    """Corners and lengths as files of version 5 hold them."""
    arrays = []
    for name, count in (("offsets", n_offsets), ("connectivity", n_corners)):
        words = cursor.line()
        if len(words) != 2 or words[0].lower() != name:
            raise FileFormatError(f"{cursor.where}: expected {name.upper()} and a type, found {' '.join(words)[:60]!r}")
        arrays.append(cursor.values(count, words[1]).astype(np.int64))
    lengths = np.diff(arrays[0])
    if (lengths < 0).any() or (n_offsets and (arrays[0][0] != 0 or arrays[0][-1] != n_corners)):
        raise FileFormatError(f"{cursor.where}: the offsets of the cells do not go from 0 to {n_corners}")
    return arrays[1], lengths


def _cells_by_lengths(cursor: _Cursor, count: int, size: int) -> Cells:
    """Corners and lengths as files before version 5 hold them: each cell begins with its length."""
    values, lengths, at = cursor.values(size, "int").astype(np.int64), np.empty(count, dtype=np.int64), 0
    is_length = np.zeros(size, dtype=bool)
    # Each length says where the next one stands, so no array operation finds them.
    for cell in range(count):
        if at >= size or values[at] < 0:
            raise FileFormatError(f"{cursor.where}: {count} cells declared, found {cell} in {size} numbers")
        lengths[cell], is_length[at] = values[at], True
        at += 1 + int(values[at])
    if at != size:
        raise FileFormatError(f"{cursor.where}: {count} cells with {size} numbers declared, found {at}")
    return values[~is_length], lengths


def _pass_metadata(cursor: _Cursor) -> None:
    """To the blank line that ends it."""
    # From the end of its own line: the blank line may follow at once.
    end = re.compile(rb"\n[ \t\r]*\n").search(cursor.data, cursor.at - 1)
    cursor.at = len(cursor.data) if end is None else end.end()


def _pass_field(cursor: _Cursor) -> None:
    words = cursor.line()
    if len(words) == 1 and words[0].lower() == "metadata":
        _pass_metadata(cursor)
        words = cursor.line()
    if len(words) != 4:
        raise FileFormatError(f"{cursor.where}: expected an array of a field, found {' '.join(words)[:60]!r}")
    cursor.values(count_of(words[1], cursor.where) * count_of(words[2], cursor.where), words[3])
