"""One body in the dialects of each mesh format that programs write, and contents that must be refused by name.

The body is a prism over the outline of the letter U: its two caps are concave polygons with eight corners, its eight
sides are squares and rectangles. All its coordinates are whole numbers, so that every type of number can hold them.
"""

import base64
import itertools
import lzma
import struct
import zlib

import numpy as np

OUTLINE = np.array([(0, 0), (3, 0), (3, 3), (2, 3), (2, 1), (1, 1), (1, 3), (0, 3)])
VERTICES = np.vstack([np.column_stack([OUTLINE, np.full(8, z)]) for z in (0, 2)]).astype(float)
POLYGONS = [list(range(7, -1, -1)), list(range(8, 16)), *([k, (k + 1) % 8, (k + 1) % 8 + 8, k + 8] for k in range(8))]
VOLUME, AREA = 14.0, 46.0
CAP = [(0, 1, 5), (1, 4, 5), (1, 2, 4), (2, 3, 4), (0, 5, 7), (5, 6, 7)]
TRIANGLES = [tuple(k + 8 for k in t) for t in CAP] + [t[::-1] for t in CAP]
TRIANGLES += [(p[0], p[1], p[2]) for p in POLYGONS[2:]] + [(p[0], p[2], p[3]) for p in POLYGONS[2:]]
TRIANGLES = np.array(TRIANGLES)

# --- PLY ---------------------------------------------------------------------------------------------------------

PLY_TYPES = {"char": "b", "uchar": "B", "short": "h", "ushort": "H", "int": "i", "uint": "I", "float": "f"}
PLY_TYPES |= {"double": "d", "int8": "b", "uint8": "B", "int16": "h", "uint16": "H", "int32": "i", "uint32": "I"}
PLY_TYPES |= {"float32": "f", "float64": "d"}
ORDERS = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}


def ply(form="ascii", elements=None, comment=b"comment made", end=b"\n", after=b""):
    """Elements are (name, properties, rows); a property is (type, name) or (length type, type, name)."""
    elements = ply_body() if elements is None else elements
    head, rows = [b"ply", b"format " + form.encode() + b" 1.0", comment], []
    for name, properties, values in elements:
        head.append(f"element {name} {len(values)}".encode())
        head += [f"property {'list ' * (len(each) == 3)}{' '.join(each)}".encode() for each in properties]
        rows += [ply_row(properties, row, ORDERS[form]) for row in values]
    body = b"".join(row + end for row in rows) if form == "ascii" else b"".join(rows)
    return end.join([*head, b"end_header", b""]) + body + after


def ply_row(properties, row, order):
    words = []
    for each, value in zip(properties, row):
        many = list(value) if len(each) == 3 else [value]
        words += [(each[0], len(many))] if len(each) == 3 else []
        words += [(each[-2], number) for number in many]
    if not order:
        return " ".join(f"{number:g}" for _, number in words).encode()
    kinds = [PLY_TYPES[kind] for kind, _ in words]
    return b"".join(
        struct.pack(order + kind, number if kind in "fd" else int(number)) for kind, (_, number) in zip(kinds, words)
    )


def ply_body(kind="float", length="uchar", index="int", name="vertex_indices"):
    return [
        ("vertex", [(kind, axis) for axis in "xyz"], VERTICES),
        ("face", [(length, index, name)], [(p,) for p in POLYGONS]),
    ]


def ply_dialects():
    plain = ply_body()
    (_, xyz, rows), (_, corners, faces) = plain
    normals = [("float", axis) for axis in ("nx", "ny", "nz")]
    colours = [("uchar", name) for name in ("red", "green", "blue", "alpha")]
    uneven = [[*row, list(range(n % 4))] for n, row in enumerate(rows)]
    textured = [(7, corner[0], [0.5] * n) for n, corner in enumerate(faces)]
    rich = [
        ("material", [("uchar", "red"), ("float", "shine")], [(1, 0.5), (2, 0.25)]),
        ("vertex", [*normals, *xyz, *colours], [[0, 0, 1, *row, 1, 2, 3, 255] for row in rows]),
        ("edge", [("int", "vertex1"), ("int", "vertex2")], [(0, 1), (1, 2)]),
        ("face", [("uchar", "flags"), *corners, ("uchar", "float", "texcoord")], textured),
        ("tag", [("int", "short", "numbers")], [([1, 2],), ([],), ([3],)]),
    ]
    for form in ORDERS:
        for kind in PLY_TYPES:
            yield f"coordinates {kind}, {form}", ply(form, ply_body(kind))
            if kind not in ("float", "double", "float32", "float64"):
                yield f"lengths and corners {kind}, {form}", ply(form, ply_body(length=kind, index=kind))
        yield f"vertex_index, {form}", ply(form, ply_body(name="vertex_index"))
        yield f"more elements and properties, {form}", ply(form, rich)
        yield (
            f"uneven list of vertices, {form}",
            ply(form, [("vertex", [*xyz, ("uchar", "int", "view")], uneven), plain[1]]),
        )
        for comment in (
            "comment Körper".encode(),
            "comment Körper".encode("latin-1"),
            b"obj_info num_cols 5",
            b"comment",
            b"comment end_header",
        ):
            yield f"{comment!r}, {form}", ply(form, comment=comment)
        yield f"CRLF, {form}", ply(form, end=b"\r\n")
        yield f"CR, {form}", ply(form, end=b"\r")
        yield f"a line end more, {form}", ply(form, after=b"\n")


def ply_refused():
    whole = ply()
    cases = {
        "int64": (b"property list uchar int vertex", b"property list uchar int64 vertex"),
        "list lengths that are no whole numbers": (b"list uchar int", b"list float int"),
        "no z": (b"property float z", b"property float depth"),
        "corners by another name": (b"vertex_indices", b"corners"),
        "version 2": (b"ascii 1.0", b"ascii 2.0"),
        "no format": (b"format ascii 1.0\n", b""),
        "an element twice": (b"element face", b"element vertex"),
        "a word that no header has": (b"comment made", b"remark made"),
        "a negative count": (b"element face 10", b"element face -1"),
        "a row less": (b"element face 10", b"element face 11"),
        "two corners": (b"4 0 1 9 8\n", b"2 0 1\n"),
        "a vertex that is not there": (b"4 0 1 9 8\n", b"4 0 1 9 16\n"),
        "half a vertex": (b"4 0 1 9 8\n", b"4 0 1.5 9 8\n"),
        "a row that is too long": (b"4 0 1 9 8\n", b"4 0 1 9 8 7\n"),
        "a decimal comma": (b"\n3 0 0\n", b"\n3,5 0 0\n"),
        "an underscore": (b"\n3 0 0\n", b"\n3_0 0 0\n"),
        "NaN": (b"\n3 0 0\n", b"\nnan 0 0\n"),
        "strips": (b"element face", b"element tristrips"),
    }
    for name, (old, new) in cases.items():
        assert old in whole, name
        yield name, whole.replace(old, new, 1)
    for form in ("binary_little_endian", "binary_big_endian"):
        yield f"cut, {form}", ply(form)[:-3]
        yield f"more numbers, {form}", ply(form, after=b"\1\2\3")
        lengths, eight = ply(form, ply_body(length="int")), ORDERS[form] + "i"
        yield f"lists beyond the file, {form}", lengths.replace(struct.pack(eight, 8), struct.pack(eight, -8), 1)


# --- OBJ ---------------------------------------------------------------------------------------------------------


def obj(corner=lambda k, n: f"{k + 1}", vertex="v {:g} {:g} {:g}", between="", end="\n", encoding="utf-8"):
    lines = ["# made", *(vertex.format(*row) for row in VERTICES), *filter(None, [between])]
    lines += ["f " + " ".join(corner(k, n) for n, k in enumerate(polygon)) for polygon in POLYGONS]
    return (end.join(lines) + end).encode(encoding)


def obj_interleaved():
    """Each polygon after vertices of its own, counted back from the last."""
    lines = []
    for polygon in POLYGONS:
        lines += ["v {:g} {:g} {:g}".format(*VERTICES[k]) for k in polygon]
        lines.append("f " + " ".join(str(n - len(polygon)) for n in range(len(polygon))))
    return ("\n".join(lines) + "\n").encode()


def obj_dialects():
    plain = obj()
    yield "plain", plain
    yield "counted back", obj(lambda k, n: f"{k - 16}")
    yield "interleaved, counted back", obj_interleaved()
    textures = "vt 0 0\nvt 1 0\nvt 1 1\nvn 0 0 1"
    yield "v/vt", obj(lambda k, n: f"{k + 1}/{n % 3 + 1}", between=textures)
    yield "v//vn", obj(lambda k, n: f"{k + 1}//1", between=textures)
    yield "v/vt/vn counted back", obj(lambda k, n: f"{k - 16}/{-1 - n % 3}/-1", between=textures)
    materials = "mtllib äöü.mtl\no body\ng left right\nusemtl Grün\ns off"
    for encoding in ("utf-8", "latin-1", "utf-8-sig"):
        yield f"materials in {encoding}", obj(between=materials, encoding=encoding)
    split = plain.replace(b"f 1 2 10 9", b"usemtl a\nf 1 2 10 9").replace(b"f 4 5 13 12", b"g b\nusemtl c\nf 4 5 13 12")
    yield "materials between polygons", split
    yield "lines that go on", plain.replace(b"f 1 2 10 9", b"f 1 2 \\\n10 9").replace(b"v 3 3 0", b"v 3 \\\n 3\\\n 0")
    yield "CRLF", obj(end="\r\n")
    yield "CR", obj(end="\r")
    yield "weights", obj(vertex="v {:g} {:g} {:g} 1.0")
    yield "colours", obj(vertex="v {:g} {:g} {:g} 0.1 0.2 0.3")
    yield "exponents", obj(vertex="v {:.3e} {:+.1f} {:g}.")
    yield "indented, with tabs", b"  " + plain.replace(b"v ", b"\tv\t").replace(b"\nf ", b"\n  f  ")
    yield "comments behind", plain.replace(b"f 1 2 10 9", b"f 1 2 10 9 # a side")
    yield "lines and points", plain + b"l 1 2 3\np 1\n"
    yield "polygons first", b"\n".join(sorted(plain.splitlines(), key=lambda line: line[:1] == b"v"))
    yield "no line end at the end", plain.rstrip()


def obj_refused():
    plain, side = obj(), b"f 1 2 10 9"
    for name, line in {
        "vertex 0": b"f 0 1 2",
        "a vertex that is not there": b"f 1 2 17",
        "a vertex before the first": b"f -17 -1 -2",
        "two corners": b"f 1 2",
        "a word": b"f 1 2 x",
        "half an index": b"f 1.5 2 3",
        "a comment within a word": b"f 1 2 1#0",
    }.items():
        yield name, plain.replace(side, line)
    for name, line in {"two numbers": b"v 1 2", "a decimal comma": b"v 1,5 2 3", "NaN": b"v nan 2 3"}.items():
        yield name, plain + line + b"\n"
    yield "free-form surface", plain + b"cstype bspline\ndeg 3 3\nsurf 0 1 0 1 1 2 3 4\n"
    yield "unknown word", plain + b"fo 1 2 3\n"
    yield "UTF-16", plain.decode().encode("utf-16")
    yield "numbers of a binary file", bytes(range(256)) * 4


# --- STL ---------------------------------------------------------------------------------------------------------


def stl(name="made", end="\n", number="{:.6e}", close="endsolid made", upper=False):
    lines = [f"solid {name}"]
    for triangle in TRIANGLES:
        lines += ["facet normal 0 0 0", " outer loop"]
        lines += ["  vertex " + " ".join(number.format(x) for x in VERTICES[k]) for k in triangle]
        lines += [" endloop", "endfacet"]
    text = end.join([*lines, close]) + end
    return (text.upper() if upper else text).encode("utf-8")


def binary_stl(head=b"made", after=b"", noise=0.0):
    corners = VERTICES[TRIANGLES] + noise * np.sin(np.arange(TRIANGLES.size * 3)).reshape(-1, 3, 3)
    record = np.zeros(len(TRIANGLES), [("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("colour", "<u2")])
    record["corners"], record["colour"] = corners, 0x7C00
    return head.ljust(80) + struct.pack("<I", len(TRIANGLES)) + record.tobytes() + after


def stl_dialects():
    for name in ("", "facet normal 0 0 0", "vertex 1 2 3", "endsolid", "Körper", "a\tb", "solid solid"):
        yield f"name {name!r}", stl(name)
    yield "upper case", stl(upper=True)
    yield "CRLF", stl(end="\r\n")
    yield "whole numbers", stl(number="{:.0f}")
    yield "end without a name", stl(close="endsolid")
    yield "end with another name", stl(close="endsolid vertex facet")
    half = stl().replace(b"endfacet\n", b"endfacet\nendsolid made\n\nsolid other\n", 9)
    yield "several solids", half
    yield "binary", binary_stl()
    yield "binary that begins with solid", binary_stl(b"solid by a program that writes so")
    yield "binary with 20 bytes more", binary_stl(after=b"\1\2\3\4" * 5)
    yield "binary, filled up with zeros", binary_stl(after=bytes(4096))
    yield "corners that differ in the last bits", binary_stl(noise=4e-7)
    yield "corners that differ in the last digits", stl(number="{:.5e}").replace(b"3.00000e+00", b"3.000001e+00", 7)


def stl_refused():
    text, binary = stl(), binary_stl()
    yield "cut text", text[: len(text) // 2]
    yield "cut before the end", text[: text.rindex(b"endsolid")]
    yield "a facet with four corners", text.replace(b" endloop", b"  vertex 0 0 0\n endloop", 1)
    yield "a facet with two corners", text.replace(b"  vertex 0.000000e+00 0.000000e+00 2.000000e+00\n", b"", 1)
    yield "a corner of two numbers", text.replace(b"vertex 0.000000e+00 ", b"vertex ", 1)
    yield "a decimal comma", text.replace(b"vertex 0.0", b"vertex 0,0", 1)
    yield "another word", text.replace(b" outer loop", b" inner loop", 1)
    yield "cut", binary[:-10]
    yield "more triangles than promised", binary + binary[-100:]
    yield "NaN", binary.replace(np.float32(3).tobytes(), np.float32(np.nan).tobytes(), 1)
    yield "no triangle", binary[:80] + bytes(4)
    yield "text of another kind", b"hello\n"


# --- VTK ---------------------------------------------------------------------------------------------------------

PACKERS = {"": None, "vtkZLibDataCompressor": zlib.compress}
PACKERS["vtkLZMADataCompressor"] = lambda block: lzma.compress(block, lzma.FORMAT_XZ, preset=0)
VTK_NAMES = {
    "f4": "Float32",
    "f8": "Float64",
    "i4": "Int32",
    "i8": "Int64",
    "u4": "UInt32",
    "u8": "UInt64",
    "i1": "Int8",
}


def packed(raw, header, compressor, block=64):
    """Header and content of an array, each as VTK encodes it."""
    if not compressor:
        return [np.array([len(raw)], header).tobytes() + raw]
    blocks = [raw[at : at + block] for at in range(0, len(raw), block)]
    small = [PACKERS[compressor](each) for each in blocks]
    last = len(raw) % block
    return [np.array([len(blocks), block, last, *map(len, small)], header).tobytes(), b"".join(small)]


class Vtp:
    """A .vtp file in one way of packing."""

    def __init__(self, form, order="<", header="u4", compressor="", real="f4", index="i8"):
        self.form, self.order, self.header, self.compressor = form, order, order + header, compressor
        self.real, self.index, self.appended = order + real, order + index, b""

    def array(self, name, values, kind, more=""):
        start = f'<DataArray type="{VTK_NAMES[kind[1:]]}" Name="{name}"{more}'.encode()
        if self.form == "ascii":
            return start + b' format="ascii">' + " ".join(f"{x:g}" for x in np.ravel(values)).encode() + b"</DataArray>"
        parts = packed(np.ascontiguousarray(values, dtype=kind).tobytes(), self.header, self.compressor)
        coded = b"".join(parts) if self.form == "raw" else b"".join(map(base64.b64encode, parts))
        if self.form == "binary":
            return start + b' format="binary">\n   ' + coded + b"\n</DataArray>"
        start += f' format="appended" offset="{len(self.appended)}"/>'.encode()
        self.appended += coded
        return start

    def cells(self, name, cells):
        corners = [k for cell in cells for k in cell]
        parts = [
            self.array("connectivity", corners, self.index),
            self.array("offsets", np.cumsum([*map(len, cells)]), self.index),
        ]
        return f"<{name}>".encode() + b"".join(parts) + f"</{name}>".encode()

    def piece(self, vertices, polygons, strips=()):
        counts = f'NumberOfPoints="{len(vertices)}" NumberOfStrips="{len(strips)}" NumberOfPolys="{len(polygons)}"'
        points = b"<Points>" + self.array("Points", vertices, self.real, ' NumberOfComponents="3"') + b"</Points>"
        normals = (
            b"<PointData>" + self.array("Normals", vertices, self.real, ' NumberOfComponents="3"') + b"</PointData>"
        )
        cells = self.cells("Polys", polygons) + (self.cells("Strips", strips) if strips else b"")
        return f"<Piece {counts}>".encode() + normals + points + cells + b"</Piece>"

    def file(self, *pieces, kind="PolyData"):
        order = {"<": "LittleEndian", ">": "BigEndian"}[self.order]
        head = f'<?xml version="1.0"?>\n<VTKFile type="{kind}" version="1.0" byte_order="{order}"'
        head += f' header_type="{VTK_NAMES[self.header[1:]]}"' + (
            f' compressor="{self.compressor}"' if self.compressor else ""
        )
        coding = b"raw" if self.form == "raw" else b"base64"
        more = (
            b'<AppendedData encoding="' + coding + b'">\n _' + self.appended + b"\n</AppendedData>"
            if self.appended
            else b""
        )
        return head.encode() + f"><{kind}>".encode() + b"".join(pieces) + f"</{kind}>".encode() + more + b"</VTKFile>\n"


def vtp_dialects():
    for form, order, header, compressor in itertools.product(("binary", "base64", "raw"), "<>", ("u4", "u8"), PACKERS):
        file = Vtp(form, order, header, compressor)
        yield f"{form} {order} {header} {compressor}", file.file(file.piece(VERTICES, POLYGONS))
    for real, index in itertools.product(("f8", "i4"), ("i4", "u4", "i1", "u8")):
        file = Vtp("binary", real=real, index=index)
        yield f"{real} {index}", file.file(file.piece(VERTICES, POLYGONS))
    for compressor in PACKERS:
        file = Vtp("ascii", compressor=compressor)
        yield f"ascii {compressor}", file.file(file.piece(VERTICES, POLYGONS))
    file = Vtp("ascii")
    yield "strips", file.file(file.piece(VERTICES, POLYGONS[:2] + POLYGONS[3:], [[0, 1, 8, 9]]))
    yield "two pieces", file.file(file.piece(VERTICES, POLYGONS[:4]), file.piece(VERTICES, POLYGONS[4:]))


def vtp_refused():
    file = Vtp("ascii")
    piece = file.piece(VERTICES, POLYGONS)
    whole = file.file(piece)
    yield "another kind of data", file.file(piece, kind="UnstructuredGrid")
    yield "no piece", file.file()
    file = Vtp("binary", compressor="vtkZLibDataCompressor")
    zipped = file.file(file.piece(VERTICES, POLYGONS))
    yield "an unknown compressor", zipped.replace(b"ZLib", b"Zip")
    yield "other bytes than zlib's", zipped.replace(b"ZLib", b"LZMA")
    yield "too many blocks", zipped.replace(b64([3, 64]), b64([2**31, 64]))
    yield "appended data that is not there", whole.replace(b'format="ascii"', b'format="appended" offset="0"')
    yield "an offset that is no number", whole.replace(b'format="ascii"', b'format="appended" offset="x"')
    yield "a vertex that is not there", whole.replace(b">7 6 5", b">7 6 16")
    yield "a negative vertex", whole.replace(b">7 6 5", b">7 6 -1")
    yield "offsets that fall", whole.replace(b">8 16 ", b">16 8 ")
    yield "a word", whole.replace(b">7 6 5", b">7 six 5")
    yield "half an index", whole.replace(b">7 6 5", b">7 6.5 5")
    yield "another byte order", whole.replace(b"LittleEndian", b"MiddleEndian")
    raw = Vtp("raw", compressor="vtkZLibDataCompressor")
    cut = raw.file(raw.piece(VERTICES, POLYGONS))
    yield "cut appended data", cut[: cut.rindex(b"\n</AppendedData>") - 30] + b"\n</AppendedData></VTKFile>"


def b64(numbers):
    return base64.b64encode(np.array(numbers, "<u4").tobytes())[:8]


def legacy(version="4.2", binary=False, real="float", title="made", polygons=None, strips=(), more=b""):
    polygons = POLYGONS if polygons is None else polygons
    kinds = {"float": ">f4", "double": ">f8", "int": ">i4", "vtktypeint64": ">i8", "unsigned_char": ">u1"}

    def numbers(values, kind):
        if binary:
            return np.array(values).astype(kinds[kind]).tobytes() + b"\n"
        return (
            b"\n".join(b" ".join(b"%g" % x for x in row) + b" " for row in np.array_split(np.ravel(values), 5)) + b"\n"
        )

    def cells(name, cells):
        flat = [k for cell in cells for k in cell]
        if version.startswith("5"):
            ends = np.cumsum([0, *map(len, cells)])
            head = f"{name} {len(ends)} {len(flat)}\nOFFSETS vtktypeint64\n".encode()
            return head + numbers(ends, "vtktypeint64") + b"CONNECTIVITY vtktypeint64\n" + numbers(flat, "vtktypeint64")
        rows = [k for cell in cells for k in (len(cell), *cell)]
        return f"{name} {len(cells)} {len(rows)}\n".encode() + numbers(rows, "int")

    head = f"# vtk DataFile Version {version}\n{title}\n{'BINARY' if binary else 'ASCII'}\nDATASET POLYDATA\n".encode()
    points = f"POINTS 16 {real}\n".encode() + numbers(VERTICES.ravel(), real)
    metadata = b"METADATA\nINFORMATION 1\nNAME L2_NORM_RANGE LOCATION vtkDataArray\nDATA 2 1 1 \n\n"
    field = b"FIELD FieldData 1\nage 1 3 int\n" + numbers([1, 2, 3], "int")
    data = b"POINT_DATA 16\nSCALARS a float 1\nLOOKUP_TABLE default\n" + numbers(range(16), "float")
    parts = [head, field, points, metadata, cells("VERTICES", [[0], [1]]), cells("LINES", [[0, 1, 2]])]
    return b"".join(
        [*parts, cells("POLYGONS", polygons), cells("TRIANGLE_STRIPS", strips) if strips else b"", data, more]
    )


def legacy_dialects():
    for version, binary, real in itertools.product(("3.0", "4.2", "5.1"), (False, True), ("float", "double", "int")):
        yield f"{version} {binary} {real}", legacy(version, binary, real)
    yield "a title in Latin-1", legacy(title="made").replace(b"made", "Körper".encode("latin-1"))
    yield "an empty title", legacy(title="")
    yield "CRLF", legacy().replace(b"\n", b"\r\n")
    yield "lower case", legacy().replace(b"POLYGONS", b"polygons").replace(b"POINTS", b"points")
    yield "strips", legacy("5.1", polygons=POLYGONS[:2] + POLYGONS[3:], strips=[[0, 1, 8, 9]])


def legacy_refused():
    whole, binary = legacy(), legacy("5.1", True)
    yield "another kind of data", whole.replace(b"POLYDATA", b"UNSTRUCTURED_GRID")
    yield "no such file", b"hello\n"
    yield "no points", whole[: whole.index(b"POINTS")]
    yield "cut", whole[: whole.index(b"POLYGONS") + 30]
    yield "cut binary", binary[: binary.index(b"CONNECTIVITY") + 60]
    yield "points of another type", whole.replace(b"POINTS 16 float", b"POINTS 16 bit")
    yield "a count that is no number", whole.replace(b"POINTS 16", b"POINTS many")
    yield "more cells than numbers", whole.replace(b"POLYGONS 10", b"POLYGONS 11")
    yield "an unknown section", whole.replace(b"POLYGONS", b"PENTAGONS")
    yield "a vertex that is not there", whole.replace(b"POLYGONS 10 58\n8 7 6", b"POLYGONS 10 58\n8 16 6")
    yield "far more points than bytes", binary.replace(b"POINTS 16", b"POINTS 1000000")
    yield "offsets of another name", legacy("5.1").replace(b"OFFSETS", b"STARTS")


READ = {
    ".ply": ply_dialects,
    ".obj": obj_dialects,
    ".stl": stl_dialects,
    ".vtp": vtp_dialects,
    ".vtk": legacy_dialects,
}
REFUSED = {".ply": ply_refused, ".obj": obj_refused, ".stl": stl_refused, ".vtp": vtp_refused, ".vtk": legacy_refused}
OTHER_FORMATS = (".off", ".glb", ".gltf", ".3mf", ".dae", ".vtu", ".wrl", ".pcd", ".las", ".x3d", ".msh", ".step")
