"""VTK's XML files: polygons (.vtp), and the wall as hexahedra with its local axes (.vtu).

They are written as base64; polygons are read as ASCII, base64 or raw bytes, compressed or not.
"""

import base64
import binascii
import lzma
import re
import xml.etree.ElementTree as ElementTree
import zlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from quadriform.errors import FileFormatError
from quadriform.files.numbers import count_of, floats, whole
from quadriform.files.polygons import NO_CELLS, Cells, Indices, Polygons
from quadriform.files.reading import check_budget, signature
from quadriform.shapes.mesh import Mesh
from quadriform.shapes.wall import HexMesh

TYPES = {"Float32": "f4", "Float64": "f8", "Int8": "i1", "UInt8": "u1", "Int16": "i2", "UInt16": "u2"}
TYPES |= {"Int32": "i4", "UInt32": "u4", "Int64": "i8", "UInt64": "u8"}
ORDERS = {"LittleEndian": "<", "BigEndian": ">"}
HEXAHEDRON = 12
"""VTK's number of this kind of cell."""
DAMAGED = (ValueError, OverflowError, IndexError, binascii.Error, zlib.error, lzma.LZMAError, EOFError)
"""What damaged content raises."""
APPENDED = re.compile(rb"<AppendedData([^>]*)>")


def encode_vtp(mesh: Mesh, metadata: Mapping[str, str]) -> bytes:
    """The bytes of a .vtp file with the vertices in double precision and the metadata as field data."""
    m = len(mesh.faces)
    kinds = {"Verts": 0, "Lines": 0, "Strips": 0, "Polys": m}
    parts = {"Points": [_data_array("Points", mesh.vertices)], "Polys": _cell_arrays(mesh.faces)}
    return _document("PolyData", metadata, {"Points": len(mesh.vertices)} | kinds, parts)


def encode_vtu(mesh: HexMesh, metadata: Mapping[str, str]) -> bytes:
    """The bytes of a .vtu file in double precision; metadata, such as frame and unit, as field data.

    The cells carry `radial`, `circumferential` and `longitudinal` unit vectors and `depth`, from 0 at the inner to 1
    at the outer surface.
    """
    names = ("radial", "circumferential", "longitudinal")
    axes = [_data_array(name, mesh.axes[:, k]) for k, name in enumerate(names)]
    types = _data_array("types", np.full(len(mesh.cells), HEXAHEDRON, np.uint8))
    parts = {
        "Points": [_data_array("Points", mesh.vertices)],
        "Cells": [*_cell_arrays(mesh.cells), types],
        "CellData": [*axes, _data_array("depth", mesh.depth)],
    }
    return _document("UnstructuredGrid", metadata, {"Points": len(mesh.vertices), "Cells": len(mesh.cells)}, parts)


def _document(
    kind: str, metadata: Mapping[str, str], counts: Mapping[str, int], parts: Mapping[str, list[str]]
) -> bytes:
    """The bytes of a file with one piece.

    Args:
        kind: VTK's name of the data set.
        metadata: names and texts of the field data.
        counts: how many points and cells of each kind there are.
        parts: the arrays of each part of the piece.
    """
    sizes = "".join(f' NumberOf{name}="{count}"' for name, count in counts.items())
    lines = [
        '<?xml version="1.0"?>',
        f'<VTKFile type="{kind}" version="1.0" byte_order="LittleEndian" header_type="UInt64">',
        f"<{kind}>",
        f"<FieldData>{''.join(_text_array(name, value) for name, value in metadata.items())}</FieldData>",
        f"<Piece{sizes}>",
        *(f"<{name}>{''.join(arrays)}</{name}>" for name, arrays in parts.items()),
        "</Piece>",
        f"</{kind}>",
        "</VTKFile>",
    ]
    return ("\n".join(lines) + "\n").encode()


def _cell_arrays(corners: Indices) -> list[str]:
    """The arrays of cells that all have as many corners, (m, corners)."""
    ends = corners.shape[1] * np.arange(1, len(corners) + 1)
    return [_data_array("connectivity", corners.ravel()), _data_array("offsets", ends)]


def _data_array(name: str, values: NDArray[Any]) -> str:
    """Numbers (n,) or vectors (n, 3) as an array of the file, in base64."""
    little = values.astype(values.dtype.newbyteorder("<"))
    kind = next(name for name, code in TYPES.items() if code == little.dtype.str[1:])
    # VTK precedes the bytes of an array by their number.
    content = base64.b64encode(np.array(little.nbytes, dtype="<u8").tobytes() + little.tobytes()).decode()
    shape = f' NumberOfComponents="{values.shape[1]}"' if values.ndim > 1 else ""
    return f'<DataArray type="{kind}" Name="{name}"{shape} format="binary">{content}</DataArray>'


def _text_array(name: str, value: str) -> str:
    """A string as field data: VTK wants its characters as numbers, closed by a zero."""
    from xml.sax.saxutils import quoteattr  # it loads Python's client of HTTP

    codes = " ".join(str(code) for code in (*value.encode(), 0))
    return f'<DataArray type="String" Name={quoteattr(name)} NumberOfTuples="1" format="ascii">{codes}</DataArray>'


def parse_vtp(data: bytes, where: str) -> Polygons:
    """Vertices, polygons and triangle strips of a .vtp file; lines, single vertices and fields are passed over.

    Raises:
        FileFormatError: no such XML, entities, an unknown compression, or counts that do not agree.
        FileLimitError: an array declares more than the budget.
    """
    file = _file_of(data, where)
    pieces = [_piece(piece, file) for piece in file.root.findall("PolyData/Piece")]
    if file.root.get("type") != "PolyData" or not pieces:
        kind = file.root.get("type")
        raise FileFormatError(f"{where}: expected a VTK PolyData file, found {kind!r} with {len(pieces)} pieces")
    before = np.cumsum([0] + [len(piece.vertices) for piece in pieces])
    return Polygons(
        np.concatenate([piece.vertices for piece in pieces]),
        np.concatenate([piece.corners + start for piece, start in zip(pieces, before)]),
        np.concatenate([piece.lengths for piece in pieces]),
    )


@dataclass(frozen=True)
class _File:
    """The XML of a file, how its arrays are packed, and its appended data."""

    root: ElementTree.Element
    order: str
    header: str
    compressor: str
    appended: bytes
    in_base64: bool
    where: str


def _file_of(data: bytes, where: str) -> _File:
    found = APPENDED.search(data)
    xml, appended, tag = data, b"", b""
    if found is not None:
        xml, tag = data[: found.start()] + b"</VTKFile>", found[1]
        appended = data[found.end() : data.rfind(b"</AppendedData>")].lstrip().removeprefix(b"_")
    root = _parse_xml(xml, where)
    order, kind = root.get("byte_order", "LittleEndian"), root.get("header_type", "UInt32")
    if order not in ORDERS or kind not in ("UInt32", "UInt64"):
        raise FileFormatError(f"{where}: expected a byte order and header type of VTK, found {order!r} and {kind!r}")
    order = ORDERS[order]
    return _File(root, order, order + TYPES[kind], root.get("compressor", ""), appended, b"raw" not in tag, where)


def _parse_xml(data: bytes, where: str) -> ElementTree.Element:
    if b"<!DOCTYPE" in data or b"\0" in data:  # no DTD, so no entities to expand or to fetch
        raise FileFormatError(f"{where}: expected plain VTK XML, found a document type or binary data")
    try:
        return ElementTree.fromstring(data)
    except (ElementTree.ParseError, ValueError, LookupError) as error:
        raise FileFormatError(f"{where}: expected a VTK XML file, found {signature(data)} ({error})") from error


def _piece(piece: ElementTree.Element, file: _File) -> Polygons:
    where, points = file.where, piece.find("Points/DataArray")
    count = count_of(piece.get("NumberOfPoints", "0").strip(), f"{where}, NumberOfPoints")
    vertices = np.empty(0) if points is None and count == 0 else _values(points, "Points/DataArray", file)
    if len(vertices) != 3 * count:
        raise FileFormatError(f"{where}: NumberOfPoints declares other than the {len(vertices) / 3:g} points found")
    found = Polygons.with_strips(vertices, _cells(piece, "Polys", file), _cells(piece, "Strips", file))
    if len(found.corners) and not 0 <= found.corners.min() <= found.corners.max() < count:
        raise FileFormatError(f"{where}: a polygon names a vertex that is not among the {count}")
    return found


def _cells(piece: ElementTree.Element, name: str, file: _File) -> Cells:
    """Corners and lengths of the cells of a kind."""
    count = count_of(piece.get(f"NumberOf{name}", "0").strip(), f"{file.where}, NumberOf{name}")
    if count == 0 and piece.find(f"{name}/DataArray[@Name='offsets']") is None:
        return NO_CELLS
    arrays = [f"{name}/DataArray[@Name='{part}']" for part in ("connectivity", "offsets")]
    corners, ends = (_values(piece.find(path), path, file).astype(np.int64) for path in arrays)
    lengths = np.diff(ends, prepend=0)
    if len(ends) != count or (lengths < 0).any() or len(corners) != (ends[-1] if count else 0):
        raise FileFormatError(f"{file.where}: NumberOf{name} declares {count} cells, found other offsets")
    return corners, lengths


def _values(element: ElementTree.Element | None, path: str, file: _File) -> NDArray[Any]:
    """The numbers of a DataArray."""
    where = f"{file.where}, {path}"
    form = "" if element is None else element.get("format", "ascii")
    if element is None or element.get("type") not in TYPES or form not in ("ascii", "binary", "appended"):
        raise FileFormatError(f"{where}: expected numbers as ascii, binary or appended, found others or none")
    dtype, text = np.dtype(file.order + TYPES[element.get("type", "")]), element.text or ""
    if form == "ascii":
        values = floats(text.split(), where)
        return values.astype(dtype) if dtype.kind == "f" else whole(values, where)
    try:
        packed = _base64(text.encode()) if form == "binary" else _appended(element, file)
        content = _unpacked(packed, file.header, file.compressor, where)
        return np.frombuffer(content, dtype=dtype)
    except DAMAGED as error:
        raise FileFormatError(f"{where} is damaged ({error})") from error


def _appended(element: ElementTree.Element, file: _File) -> bytes:
    """The bytes that belong to an element: from its offset to the next one."""
    # Only beginnings are stored: an array ends where the next one begins.
    offsets = [int(each.get("offset", "-1")) for each in file.root.iter("DataArray") if each.get("offset")]
    start = int(element.get("offset", "-1"))
    if not 0 <= start < len(file.appended):
        raise ValueError(f"offset {start} in {len(file.appended)} bytes of appended data")
    end = min((offset for offset in offsets if offset > start), default=len(file.appended))
    part = file.appended[start:end]
    return _base64(part) if file.in_base64 else part


def _base64(text: bytes) -> bytes:
    """Bytes of base64; header and numbers may each end with their own padding."""
    parts = re.findall(rb"[^=]+=*", b"".join(text.split()))
    return b"".join(base64.b64decode(part, validate=True) for part in parts)


# --- blocks, which may be compressed -------------------------------------------------------------------------------


def _unpacked(packed: bytes, header: str, compressor: str, where: str) -> bytes:
    """The bytes of an array.

    Args:
        packed: its header and its content as they lie in the file.
        header: NumPy's name of the type of the header's numbers.
        compressor: VTK's name of the class that compressed it; empty for none.
        where: the file and the array.

    Raises:
        FileFormatError: an unknown compressor, or one that is not installed.
        FileLimitError: the header declares more than the budget.
        DAMAGED: the content is not what the header declares.
    """
    width = np.dtype(header).itemsize
    count = int(np.frombuffer(packed[:width], header)[0])  # of bytes, or of blocks
    if not compressor:
        content = packed[width:]
        if count > len(content) or content[count:].strip():  # line ends may follow
            raise ValueError(f"{count} bytes declared, {len(content)} found")
        return content[:count]
    decompress = _decompressor(compressor, where)
    if count * width > len(packed):
        raise ValueError(f"{count} blocks declared in {len(packed)} bytes")
    sizes = np.frombuffer(packed[: (3 + count) * width], header).astype(object)[1:]  # Python's integers: no overflow
    if count == 0:
        return b""
    # Unpacked sizes of a block and of the last one, 0 where that is as long, then the packed size of each.
    lengths = [sizes[0]] * (count - 1) + [sizes[1] or sizes[0]]
    check_budget(sum(lengths), where)
    at, blocks = (3 + count) * width, []
    for size, length in zip(sizes[2:], lengths):
        blocks.append(decompress(packed[at : at + size], length))
        if len(blocks[-1]) != length:
            raise ValueError(f"a block of {length} bytes declared, {len(blocks[-1])} found")
        at += size
    return b"".join(blocks)


def _decompressor(name: str, where: str) -> Callable[[bytes, int], bytes]:
    if name == "vtkZLibDataCompressor":
        return lambda block, length: _to_its_end(zlib.decompressobj(), block, length)
    if name == "vtkLZMADataCompressor":
        return lambda block, length: _to_its_end(lzma.LZMADecompressor(), block, length)
    if name == "vtkLZ4DataCompressor":
        return _lz4(where)
    raise FileFormatError(f"{where}: compressed by {name!r}, which is not known; save it with zlib or uncompressed")


def _to_its_end(stream: Any, block: bytes, length: int) -> bytes:
    """At most a byte more than declared; the checksum behind the last byte is read too."""
    content: bytes = stream.decompress(block, length + 1)
    if len(content) == length and not stream.eof:
        raise ValueError(f"a block of {length} bytes ends before its checksum")
    return content


def _lz4(where: str) -> Callable[[bytes, int], bytes]:
    try:
        from lz4 import block
    except ImportError as error:
        raise FileFormatError(
            f"{where}: compressed with LZ4; save it with zlib or uncompressed, or install the package lz4"
        ) from error

    def decompress(packed: bytes, length: int) -> bytes:
        """The bytes of a block; ValueError where it is damaged, as from the other libraries."""
        try:
            return bytes(block.decompress(packed, uncompressed_size=length))
        except block.LZ4BlockError as error:
            raise ValueError(str(error)) from error

    return decompress
