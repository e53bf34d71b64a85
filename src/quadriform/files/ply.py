"""PLY: vertices and polygons of ASCII and binary files. What the header declares is compared with what follows."""

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from quadriform.errors import FileFormatError
from quadriform.files.metadata import as_comment
from quadriform.files.numbers import check_last_index, check_last_number, fits_single_precision, floats, whole
from quadriform.files.polygons import NO_CELLS, Cells, Polygons, starts_of
from quadriform.files.reading import check_budget, signature
from quadriform.shapes.mesh import Mesh

TYPES = {"char": "i1", "int8": "i1", "uchar": "u1", "uint8": "u1", "short": "i2", "int16": "i2", "ushort": "u2"}
TYPES |= {"uint16": "u2", "int": "i4", "int32": "i4", "uint": "u4", "uint32": "u4"}
TYPES |= {"float": "f4", "float32": "f4", "double": "f8", "float64": "f8"}
BYTE_ORDERS = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}
BYTE_NAMES: dict[str, Literal["little", "big"]] = {"<": "little", ">": "big"}
VERTEX_INDICES = ("vertex_indices", "vertex_index")
Values = tuple[NDArray[Any], NDArray[np.int64] | None]
"""The numbers of a property, row after row; and of a list how many each row has, (rows,)."""
Rows = dict[str, Values]
"""The values of an element by the names of its properties."""


@dataclass(frozen=True)
class _Property:
    name: str
    type: str
    count_type: str | None


@dataclass
class _Element:
    name: str
    count: int
    properties: list[_Property]


def parse_ply(data: bytes, where: str) -> Polygons:
    """Vertices, as stored, and polygons of a PLY file; comments and other elements and properties are passed over.

    Raises:
        FileFormatError: not a PLY, other numbers of rows or values than the header declares, or no vertices x, y, z.
        FileLimitError: the header declares more than the budget.
    """
    order, elements, body = _header(data, where)
    total = sum(element.count for element in elements)
    check_budget(total, where)
    if order and len(body) < total:
        raise FileFormatError(f"{where}: the header declares {total} rows, found only {len(body)} bytes")
    found = _binary(elements, body, order, where) if order else _ascii(elements, body, total, where)
    if "vertex" not in found:
        raise FileFormatError(f"{where}: expected the element vertex, found {', '.join(found) or 'none'}")
    columns = [_coordinate(found["vertex"], axis, where) for axis in "xyz"]
    indices, counts = _polygons(found, where)
    return Polygons(np.column_stack(columns).astype(np.float64), indices, counts)


# --- header ------------------------------------------------------------------------------------------------------


def _header(data: bytes, where: str) -> tuple[str, list[_Element], bytes]:
    """Byte order ("" for ASCII), the elements, and what follows the header."""
    # A binary body may begin with the byte of "\n", which is no part of the last line end.
    first = re.match(rb"ply[ \t]*(\r\n|\n|\r)", data)
    end = re.search(rb"[\r\n]end_header[ \t]*" + first[1], data) if first else None
    if end is None:
        raise FileFormatError(f"{where}: expected a PLY header, found {signature(data)}")
    lines = [line.split() for line in re.split(r"\r\n|\n|\r", data[: end.start()].decode("latin-1"))]
    order, elements = None, list[_Element]()
    for words in lines[1:]:
        match words:
            case ["format", name, "1.0"] if name in BYTE_ORDERS:
                order = BYTE_ORDERS[name]
            case ["element", name, count] if count.isascii() and count.isdigit():
                elements.append(_Element(name, int(count), []))
            case ["property", *rest] if elements:
                elements[-1].properties.append(_property(rest, where))
            case [] | ["comment" | "obj_info", *_]:
                continue
            case _:
                raise FileFormatError(f"{where}: expected a line of a PLY header, found {' '.join(words)[:60]!r}")
    if order is None or len({element.name for element in elements}) != len(elements):
        raise FileFormatError(f"{where}: expected one format and elements of different names in the PLY header")
    return order, elements, data[end.end() :]


def _property(words: Sequence[str], where: str) -> _Property:
    match words:
        case [kind, name] if kind in TYPES:
            return _Property(name, TYPES[kind], None)
        case ["list", count, kind, name] if kind in TYPES and TYPES.get(count, "f")[0] != "f":
            return _Property(name, TYPES[kind], TYPES[count])
    raise FileFormatError(f"{where}: a property of a type that PLY does not have: {' '.join(words)[:60]!r}")


# --- binary ------------------------------------------------------------------------------------------------------


def _binary(elements: list[_Element], body: bytes, order: str, where: str) -> dict[str, Rows]:
    found, at = dict[str, Rows](), 0
    for element in elements:
        rows = _equal_rows(element, body, at, order, where) or _uneven_rows(element, body, at, order, where)
        found[element.name], at = rows
    if body[at:].strip():  # trailing blanks and line ends are ignored
        raise FileFormatError(f"{where}: {len(body) - at} bytes are left after the last row that the header declares")
    return found


def _equal_rows(element: _Element, body: bytes, at: int, order: str, where: str) -> tuple[Rows, int] | None:
    """The rows as one table, if the lists of all rows have the counts of the first row, as triangles do; else None."""
    none = [0] * len(element.properties)
    first = _counts_of_row(element, body, at, order, where)[0] if element.count else none
    fields: list[Any] = []
    for n, (each, count) in enumerate(zip(element.properties, first)):
        fields += [(f"count {n}", order + each.count_type)] if each.count_type else []
        fields.append((f"{n}", order + each.type, (count,)))
    record, found = np.dtype(fields), Rows()
    end = at + record.itemsize * element.count
    if end > len(body):
        return None
    # NumPy refuses rows without bytes, which an element without properties has.
    table = np.frombuffer(body, record, element.count, at) if fields else np.empty(element.count, record)
    for n, (each, count) in enumerate(zip(element.properties, first)):
        counts = table[f"count {n}"].astype(np.int64) if each.count_type else None
        if counts is not None and (counts != count).any():
            return None
        found[each.name] = table[f"{n}"].reshape(-1), counts
    return found, end


def _uneven_rows(element: _Element, body: bytes, at: int, order: str, where: str) -> tuple[Rows, int]:
    counts, starts = np.empty((2, element.count, len(element.properties)), dtype=np.int64)
    for row in range(element.count):
        counts[row], starts[row], at = _counts_of_row(element, body, at, order, where)
    content, found = np.frombuffer(body, np.uint8), Rows()
    for n, each in enumerate(element.properties):
        kind = np.dtype(order + each.type)
        # Of all rows' numbers one behind the other: the position in its row, the first byte, then all bytes of each.
        in_row = np.arange(counts[:, n].sum()) - np.repeat(starts_of(counts[:, n]), counts[:, n])
        first_byte = np.repeat(starts[:, n], counts[:, n]) + kind.itemsize * in_row
        values = content[first_byte[:, None] + np.arange(kind.itemsize)].reshape(-1).view(kind)
        found[each.name] = values, counts[:, n] if each.count_type else None
    return found, at


def _counts_of_row(element: _Element, body: bytes, at: int, order: str, where: str) -> tuple[list[int], list[int], int]:
    """For the row that begins at byte `at`: the count of numbers of each property, where they begin, and its end."""
    counts, starts = [], []
    for each in element.properties:
        count = 1
        if each.count_type:
            width = int(each.count_type[1])
            count = int.from_bytes(body[at : at + width], BYTE_NAMES[order], signed=each.count_type[0] == "i")
            at += width
        counts.append(count)
        starts.append(at)
        at += count * int(each.type[1])
        if count < 0 or at > len(body):
            raise FileFormatError(f"{where}: one of {element.count} rows of {element.name} goes beyond the file")
    return counts, starts, at


# --- ASCII -------------------------------------------------------------------------------------------------------


def _ascii(elements: list[_Element], body: bytes, total: int, where: str) -> dict[str, Rows]:
    lines = [words for line in re.split(rb"\r\n|\n|\r", body) if (words := line.split())]
    if len(lines) != total:
        raise FileFormatError(f"{where}: the header declares {total} rows, found {len(lines)}")
    if lines and not body[-1:].isspace():
        _check_last(elements, lines, where)
    rows = iter(lines)
    return {each.name: _ascii_rows(each, [next(rows) for _ in range(each.count)], where) for each in elements}


def _check_last(elements: list[_Element], lines: list[list[bytes]], where: str) -> None:
    """Refuse a last word without a line end that may be cut, where it is a coordinate or an index of a vertex."""
    last = next(each for each in reversed(elements) if each.count)
    words = [row[-1].decode("ascii", "backslashreplace") for row in lines[-last.count :]]
    match last.name, last.properties[-1].name if last.properties else "":
        case "vertex", ("x" | "y" | "z" | "X" | "Y" | "Z"):
            check_last_number(words, where)
        case "face", name if name in VERTEX_INDICES and words[-1].isdecimal():
            vertices = sum(each.count for each in elements if each.name == "vertex")
            check_last_index(int(words[-1]), vertices - 1, where)


def _ascii_rows(element: _Element, rows: list[list[bytes]], where: str) -> Rows:
    words: list[list[bytes]] = [[] for _ in element.properties]
    counts: list[list[int]] = [[] for _ in element.properties]
    for number, row in enumerate(rows):
        for n, part in enumerate(_parts(element, row, f"{where}, row {number} of {element.name}")):
            words[n] += part
            counts[n].append(len(part))
    found = Rows()
    for n, each in enumerate(element.properties):
        in_element = f"{where}, {each.name} of {element.name}"
        values: NDArray[Any] = floats(words[n], in_element)
        values = values if each.type[0] == "f" else whole(values, in_element)
        found[each.name] = values, np.array(counts[n], dtype=np.int64) if each.count_type else None
    return found


def _parts(element: _Element, row: list[bytes], where: str) -> Iterator[list[bytes]]:
    """The words of each property of a row."""
    at = 0
    for each in element.properties:
        count = 1
        if each.count_type:
            count = int(row[at]) if at < len(row) and row[at].isdigit() else -1
            at += 1
        if count < 0 or at + count > len(row):
            raise FileFormatError(f"{where}: expected {each.name} as the header declares, found {len(row)} words")
        yield row[at : at + count]
        at += count
    if at != len(row):
        raise FileFormatError(f"{where}: expected {at} numbers in the row, found {len(row)}")


# --- vertices and polygons ---------------------------------------------------------------------------------------


def _coordinate(vertex: Rows, axis: str, where: str) -> NDArray[Any]:
    values = vertex.get(axis, vertex.get(axis.upper()))
    if values is None or values[1] is not None:
        raise FileFormatError(f"{where}: expected vertices x y z, found the properties {', '.join(vertex) or 'none'}")
    return values[0]


def _polygons(found: dict[str, Rows], where: str) -> Cells:
    """The vertex indices of all faces in a row, and the number of vertices of each face."""
    if "tristrips" in found:
        raise FileFormatError(f"{where}: triangle strips in a PLY are not read; save triangles instead")
    face = found.get("face", {})
    values = next((face[name] for name in VERTEX_INDICES if name in face), None)
    if values is not None and values[1] is not None:
        return values[0].astype(np.int64), values[1]
    if any(len(numbers if counts is None else counts) for numbers, counts in face.values()):
        raise FileFormatError(
            f"{where}: expected a list {' or '.join(VERTEX_INDICES)} of face, found {', '.join(face)}"
        )
    return NO_CELLS


def encode_ply(mesh: Mesh, metadata: Mapping[str, str]) -> bytes:
    """The bytes of a binary PLY: vertices in single precision where that holds them, else in double precision."""
    is_single = fits_single_precision(mesh.vertices)
    number = "float" if is_single else "double"
    header = [
        "ply",
        "format binary_little_endian 1.0",
        f"comment {as_comment(metadata)}",
        f"element vertex {len(mesh.vertices)}",
        *(f"property {number} {axis}" for axis in "xyz"),
        f"element face {len(mesh.faces)}",
        "property list uchar int vertex_indices",
        "end_header",
    ]
    # One structured array writes the count and the three indices of each face without a loop.
    faces = np.empty(len(mesh.faces), dtype=[("count", "u1"), ("indices", "<i4", 3)])
    faces["count"], faces["indices"] = 3, mesh.faces
    vertices = mesh.vertices.astype("<f4" if is_single else "<f8")
    return ("\n".join(header) + "\n").encode() + vertices.tobytes() + faces.tobytes()
