"""VTK's XML polygon files (.vtp), as far as triangles need them: ASCII, or base64 in the file, uncompressed."""

import base64
import xml.etree.ElementTree as ElementTree
from typing import Any
from xml.sax.saxutils import quoteattr

import numpy as np
from numpy.typing import NDArray

from quadriform.errors import FileFormatError
from quadriform.files.reading import signature
from quadriform.points import Array
from quadriform.shapes.mesh import Mesh

TYPES = {
    "Float32": "<f4",
    "Float64": "<f8",
    "Int32": "<i4",
    "Int64": "<i8",
    "UInt32": "<u4",
    "UInt64": "<u8",
}


def encode_vtp(mesh: Mesh, space: str, unit: str) -> bytes:
    """The bytes of a .vtp file with the vertices in double precision; frame and unit as field data."""
    n, m = len(mesh.vertices), len(mesh.faces)
    offsets = 3 * np.arange(1, m + 1, dtype="<i8")
    polygons = data_array("connectivity", mesh.faces.astype("<i8"), "Int64") + data_array("offsets", offsets, "Int64")
    lines = [
        '<?xml version="1.0"?>',
        '<VTKFile type="PolyData" version="1.0" byte_order="LittleEndian" header_type="UInt64">',
        "<PolyData>",
        f"<FieldData>{text_array('SPACE', space)}{text_array('UNIT', unit)}</FieldData>",
        f'<Piece NumberOfPoints="{n}" NumberOfVerts="0" NumberOfLines="0" NumberOfStrips="0" NumberOfPolys="{m}">',
        f"<Points>{data_array('Points', mesh.vertices.astype('<f8'), 'Float64', 3)}</Points>",
        f"<Polys>{polygons}</Polys>",
        "</Piece>",
        "</PolyData>",
        "</VTKFile>",
    ]
    return ("\n".join(lines) + "\n").encode()


def data_array(name: str, values: NDArray[Any], kind: str, components: int = 1) -> str:
    """An array of a VTK XML file, base64 in the file; `kind` is VTK's name of the type that `values` already have."""
    raw = values.tobytes()
    content = base64.b64encode(np.uint64(len(raw)).astype("<u8").tobytes() + raw).decode()
    shape = f' NumberOfComponents="{components}"' if components > 1 else ""
    return f'<DataArray type="{kind}" Name="{name}"{shape} format="binary">{content}</DataArray>'


def text_array(name: str, value: str) -> str:
    """A string as field data: VTK wants its characters as numbers, closed by a zero."""
    codes = " ".join(str(code) for code in (*value.encode(), 0))
    return f'<DataArray type="String" Name={quoteattr(name)} NumberOfTuples="1" format="ascii">{codes}</DataArray>'


def parse_vtp(data: bytes, where: str) -> tuple[Array, NDArray[np.int64]]:
    """Vertices (n, 3) and triangles (m, 3) of a .vtp file with one piece.

    Raises:
        FileFormatError: no such XML, entities, several pieces, compression, polygons other than triangles, or counts
            that do not agree.
    """
    root = _parse_xml(data, where)
    pieces = root.findall("PolyData/Piece")
    if root.get("type") != "PolyData" or len(pieces) != 1:
        raise FileFormatError(f"{where}: expected a VTK PolyData file with one piece, found {len(pieces)} pieces")
    if root.get("compressor") or root.get("byte_order", "LittleEndian") != "LittleEndian":
        raise FileFormatError(f"{where}: compressed or big-endian .vtp is not read; save it uncompressed")
    header = TYPES.get(root.get("header_type", "UInt32"), "<u4")
    vertices = _values(pieces[0], "Points/DataArray", header, where)
    polygons = _values(pieces[0], "Polys/DataArray[@Name='connectivity']", header, where)
    offsets = _values(pieces[0], "Polys/DataArray[@Name='offsets']", header, where)
    if len(vertices) % 3 or len(vertices) != 3 * _count(pieces[0], "NumberOfPoints", where):
        raise FileFormatError(f"{where}: NumberOfPoints promises other than the {len(vertices) / 3:g} points found")
    if not np.array_equal(offsets, 3 * np.arange(1, _count(pieces[0], "NumberOfPolys", where) + 1)):
        raise FileFormatError(f"{where}: expected NumberOfPolys triangles, found other polygons or another number")
    if len(polygons) != 3 * len(offsets) or (
        polygons.size and not 0 <= polygons.min() <= polygons.max() < len(vertices) // 3
    ):
        raise FileFormatError(f"{where}: the triangles name vertices that are not there")
    return vertices.reshape(-1, 3).astype(np.float64), polygons.reshape(-1, 3).astype(np.int64)


def _parse_xml(data: bytes, where: str) -> ElementTree.Element:
    if b"<!DOCTYPE" in data or b"\0" in data:  # no DTD, so no entities to expand or to fetch
        raise FileFormatError(f"{where}: expected plain VTK XML, found a document type or binary data")
    try:
        return ElementTree.fromstring(data)
    except (ElementTree.ParseError, ValueError, LookupError) as error:
        raise FileFormatError(f"{where}: expected a VTK XML file, found {signature(data)} ({error})") from error


def _count(piece: ElementTree.Element, name: str, where: str) -> int:
    try:
        return int(piece.get(name, "0"))
    except ValueError as error:
        raise FileFormatError(f"{where}: {name} is no whole number: {piece.get(name)!r}") from error


def _values(piece: ElementTree.Element, path: str, header: str, where: str) -> NDArray[Any]:
    element = piece.find(path)
    if element is None or element.get("type") not in TYPES or element.get("format") not in ("ascii", "binary"):
        raise FileFormatError(f"{where}: expected {path} as ascii or inline base64 numbers; appended data is not read")
    dtype = np.dtype(TYPES[element.get("type", "")])
    content = (element.text or "").strip()
    try:
        if element.get("format") == "ascii":
            return np.array(content.split(), dtype=dtype)
        raw = base64.b64decode(content, validate=True)
        start = np.dtype(header).itemsize
        size = int(np.frombuffer(raw[:start], dtype=header)[0])
        if size != len(raw) - start:
            raise ValueError(f"{size} bytes promised, {len(raw) - start} found")
        return np.frombuffer(raw, dtype=dtype, offset=start)
    except (ValueError, OverflowError, IndexError) as error:
        raise FileFormatError(f"{where}: {path} is damaged ({error})") from error
