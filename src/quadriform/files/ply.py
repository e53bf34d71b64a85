"""PLY: vertices and polygons of ASCII and binary files. What the header declares is compared with what follows."""

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from quadriform.errors import FileFormatError
from quadriform.files.metadata import as_comment
from quadriform.files.numbers import fits_single_precision, floats, whole
from quadriform.files.polygons import Polygons
from quadriform.files.reading import check_budget, signature
from quadriform.shapes.mesh import Mesh

TYPES = {"char": "i1", "int8": "i1", "uchar": "u1", "uint8": "u1", "short": "i2", "int16": "i2", "ushort": "u2"}
TYPES |= {"uint16": "u2", "int": "i4", "int32": "i4", "uint": "u4", "uint32": "u4"}
TYPES |= {"float": "f4", "float32": "f4", "double": "f8", "float64": "f8"}
BYTE_ORDERS = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}
VERTEX_INDICES = ("vertex_indices", "vertex_index")
Values = NDArray[Any] | tuple[NDArray[Any], NDArray[np.int64]]
"""Scalar property: (rows,). List property: all numbers in a row, and the number of entries of each list (rows,)."""


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
    first = re.match(
        rb"ply[ \t]*(\r\n|\n|\r)", data
    )  # a binary body may begin with the byte of "\n", which is no part of the last line end
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


def _binary(elements: list[_Element], body: bytes, order: str, where: str) -> dict[str, dict[str, Values]]:
    found, at = dict[str, dict[str, Values]](), 0
    for element in elements:
        lists = any(each.count_type for each in element.properties)
        reader = _rows_with_lists if lists and element.count else _rows
        found[element.name], at = reader(element, body, at, order, where)
    if body[at:].strip():  # trailing blanks and line ends are ignored
        raise FileFormatError(f"{where}: {len(body) - at} bytes are left after the last row that the header declares")
    return found


def _rows(element: _Element, body: bytes, at: int, order: str, where: str) -> tuple[dict[str, Values], int]:
    record = np.dtype([(f"{n}", order + each.type) for n, each in enumerate(element.properties)])
    end = at + record.itemsize * element.count
    if end > len(body):
        raise FileFormatError(f"{where}: the header declares {end} bytes after it, found {len(body)}")
    table = np.frombuffer(body, record, element.count, at) if record.itemsize else np.empty(element.count, record)
    return {each.name: table[f"{n}"] for n, each in enumerate(element.properties)}, end


def _rows_with_lists(element: _Element, body: bytes, at: int, order: str, where: str) -> tuple[dict[str, Values], int]:
    first = _counts_of_row(element, body, at, order, where)[0]
    return _equal_rows(element, first, body, at, order) or _uneven_rows(element, body, at, order, where)


def _equal_rows(
    element: _Element, counts: list[int], body: bytes, at: int, order: str
) -> tuple[dict[str, Values], int] | None:
    """The rows as one table, if the lists of all rows have the counts of the first row, as triangles do; else None."""
    fields: list[Any] = []
    for n, (each, count) in enumerate(zip(element.properties, counts)):
        fields += [(f"count {n}", order + each.count_type)] if each.count_type else []
        fields.append((f"{n}", order + each.type, (count,)) if each.count_type else (f"{n}", order + each.type))
    record = np.dtype(fields)
    if at + record.itemsize * element.count > len(body):
        return None
    table, found = np.frombuffer(body, record, element.count, at), dict[str, Values]()
    for n, (each, count) in enumerate(zip(element.properties, counts)):
        if each.count_type and not (table[f"count {n}"] == count).all():
            return None
        values = table[f"{n}"]
        found[each.name] = (values.reshape(-1), np.full(element.count, count)) if each.count_type else values
    return found, at + record.itemsize * element.count


def _uneven_rows(element: _Element, body: bytes, at: int, order: str, where: str) -> tuple[dict[str, Values], int]:
    counts, starts = np.empty((2, element.count, len(element.properties)), dtype=np.int64)
    for row in range(element.count):
        counts[row], starts[row], at = _counts_of_row(element, body, at, order, where)
    content, found = np.frombuffer(body, np.uint8), dict[str, Values]()
    for n, each in enumerate(element.properties):
        kind = np.dtype(order + each.type)
        number = np.arange(counts[:, n].sum()) - np.repeat(np.cumsum(counts[:, n]) - counts[:, n], counts[:, n])
        begin = np.repeat(starts[:, n], counts[:, n]) + kind.itemsize * number
        values = content[begin[:, None] + np.arange(kind.itemsize)].reshape(-1).view(kind)
        found[each.name] = (values, counts[:, n]) if each.count_type else values
    return found, at


def _counts_of_row(element: _Element, body: bytes, at: int, order: str, where: str) -> tuple[list[int], list[int], int]:
    """For the row that begins at byte `at`: the count of numbers of each property, where they begin, and its end."""
    counts, starts = [], []
    for each in element.properties:
        count = 1
        if each.count_type:
            width = int(each.count_type[1])
            count = int.from_bytes(
                body[at : at + width], "little" if order == "<" else "big", signed=each.count_type[0] == "i"
            )
            at += width
        counts.append(count)
        starts.append(at)
        at += count * int(each.type[1])
        if count < 0 or at > len(body):
            raise FileFormatError(f"{where}: a list of {element.name} with {count} numbers goes beyond the file")
    return counts, starts, at


# --- ASCII -------------------------------------------------------------------------------------------------------


def _ascii(elements: list[_Element], body: bytes, total: int, where: str) -> dict[str, dict[str, Values]]:
    lines = [words for line in re.split(rb"\r\n|\n|\r", body) if (words := line.split())]
    if len(lines) != total:
        raise FileFormatError(f"{where}: the header declares {total} rows, found {len(lines)}")
    rows = iter(lines)
    return {each.name: _ascii_rows(each, [next(rows) for _ in range(each.count)], where) for each in elements}


def _ascii_rows(element: _Element, rows: list[list[bytes]], where: str) -> dict[str, Values]:
    words: list[list[bytes]] = [[] for _ in element.properties]
    counts: list[list[int]] = [[] for _ in element.properties]
    for number, row in enumerate(rows):
        for n, part in enumerate(_parts(element, row, f"{where}, row {number} of {element.name}")):
            words[n] += part
            counts[n].append(len(part))
    found = dict[str, Values]()
    for n, each in enumerate(element.properties):
        in_element = f"{where}, {each.name} of {element.name}"
        values: NDArray[Any] = floats(words[n], in_element)
        values = values if each.type[0] == "f" else whole(values, in_element)
        found[each.name] = (values, np.array(counts[n], dtype=np.int64)) if each.count_type else values
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


def _coordinate(vertex: dict[str, Values], axis: str, where: str) -> NDArray[Any]:
    values = vertex.get(axis, vertex.get(axis.upper()))
    if values is None or isinstance(values, tuple):
        raise FileFormatError(f"{where}: expected vertices x y z, found the properties {', '.join(vertex) or 'none'}")
    return values


def _polygons(found: dict[str, dict[str, Values]], where: str) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """The vertex indices of all faces in a row, and the number of vertices of each face."""
    if "tristrips" in found:
        raise FileFormatError(f"{where}: triangle strips in a PLY are not read; save triangles instead")
    face = found.get("face", {})
    values = next((face[name] for name in VERTEX_INDICES if name in face), None)
    if isinstance(values, tuple):
        return values[0].astype(np.int64), values[1]
    if len(face) and any(len(each[1] if isinstance(each, tuple) else each) for each in face.values()):
        raise FileFormatError(
            f"{where}: expected a list {' or '.join(VERTEX_INDICES)} of face, found {', '.join(face)}"
        )
    return np.empty(0, dtype=np.int64), np.empty(0, dtype=np.int64)


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
