"""Mesh files made byte by byte: rows of unequal lists, blocks that are compressed, sections in any order."""

import base64
import lzma
import struct
import zlib

import numpy as np
import pytest
from shapes_made import made, single

from quadriform.errors import FileFormatError
from quadriform.files import legacy_vtk, stl, vtk_xml
from quadriform.files.legacy_vtk import parse_legacy_vtk
from quadriform.files.ply import parse_ply
from quadriform.files.stl import parse_stl
from quadriform.files.vtk_xml import parse_vtp
from quadriform.files.vtkhdf import encode_vtkhdf
from quadriform.shapes.control_box import ControlBox
from quadriform.shapes.mesh import split_quads
from quadriform.shapes.superquadric import Superquadric

VERTICES = np.array([[0.0, 0, 0], [4, 0, 0], [4, 4, 0], [0, 4, 0], [2, 6, 0.5], [1, 1, 9]])
FACES = [[0, 1, 2, 3], [3, 2, 4], [0, 1, 5], [5, 4, 3, 2, 1]]
KINDS = {"uchar": "B", "char": "b", "ushort": "H", "short": "h", "uint": "I", "int": "i", "double": "d", "float": "f"}


@pytest.mark.parametrize("order", ["<", ">"])
@pytest.mark.parametrize("count", ["uchar", "ushort", "int"])
@pytest.mark.parametrize("faces", [FACES, FACES[1:3], []], ids=["unequal", "equal", "none"])
def test_rows_of_a_binary_ply_have_lists_of_any_length(order, count, faces):
    """Between two numbers of each row, behind an element that is passed over."""
    name = "little" if order == "<" else "big"
    head = f"ply\nformat binary_{name}_endian 1.0\nelement edge 2\nproperty list {count} short pair\n"
    head += "element vertex 6\nproperty double x\nproperty double y\nproperty uchar red\nproperty float z\n"
    head += f"element face {len(faces)}\nproperty ushort before\nproperty list {count} uint vertex_index\n"
    head += "property float quality\nend_header\n"
    body = b"".join(struct.pack(f"{order}{KINDS[count]}{n}h", n, *range(n)) for n in (2, 3))
    body += b"".join(struct.pack(f"{order}ddBf", x, y, 200, z) for x, y, z in VERTICES)
    for face in faces:
        body += struct.pack(f"{order}H{KINDS[count]}{len(face)}If", 65535, len(face), *face, 0.25)
    found = parse_ply(head.encode() + body, "m")
    np.testing.assert_array_equal(found.vertices, VERTICES)
    assert found.corners.tolist() == [corner for face in faces for corner in face]
    assert found.lengths.tolist() == [len(face) for face in faces]
    for cut in (1, len(body) // 2) if faces else ():
        with pytest.raises(FileFormatError):
            parse_ply(head.encode() + body[:-cut], "m")


def packed(values, compressor, size):
    """An array as VTK holds it: the number of bytes, or of blocks, their sizes, and what they are packed to."""
    content = values.tobytes()
    if not compressor:
        return struct.pack("<I", len(content)) + content
    pack = zlib.compress if compressor == "vtkZLibDataCompressor" else lzma.compress
    blocks = [content[at : at + size] for at in range(0, len(content), size)]
    last = len(blocks[-1]) if blocks and len(blocks[-1]) < size else 0
    parts = [pack(block) for block in blocks]
    sizes = [len(part) for part in parts]
    return struct.pack(f"<{3 + len(sizes)}I", len(blocks), size, last, *sizes) + b"".join(parts)


def vtp(form, compressor="", size=24):
    """Polygons and a strip in one piece, as base64 or appended."""
    appended, arrays = b"", {}

    def array(name, kind, values, components=""):
        nonlocal appended
        data = packed(values, compressor, size)
        if form == "binary":
            cut = 4 * (3 + struct.unpack("<I", data[:4])[0]) if compressor else 4
            text = base64.b64encode(data[:cut]) + base64.b64encode(data[cut:])  # header and content by themselves
            arrays[name] = (
                f'<DataArray type="{kind}" Name="{name}" {components}format="binary">{text.decode()}</DataArray>'
            )
        else:
            arrays[name] = (
                f'<DataArray type="{kind}" Name="{name}" {components}format="appended" offset="{len(appended)}"/>'
            )
            appended += data

    array("points", "Float64", VERTICES.astype("<f8"), 'NumberOfComponents="3" ')
    ends = np.cumsum([len(face) for face in FACES])
    array("connectivity", "Int64", np.concatenate(FACES).astype("<i8"))
    array("offsets", "Int32", ends.astype("<i4"))
    polys = arrays["connectivity"] + arrays["offsets"]
    array("connectivity", "UInt8", np.array([0, 1, 2, 3, 4], dtype="u1"))
    array("offsets", "Int64", np.array([5], dtype="<i8"))
    strips = arrays["connectivity"] + arrays["offsets"]
    return (
        f'<?xml version="1.0"?><VTKFile type="PolyData" byte_order="LittleEndian" header_type="UInt32" '
        f'compressor="{compressor}"><PolyData><Piece NumberOfPoints="6" NumberOfPolys="4" NumberOfStrips="1">'
        f"<Points>{arrays['points']}</Points><Polys>{polys}</Polys><Strips>{strips}</Strips></Piece></PolyData>"
    ).encode() + (
        b'<AppendedData encoding="raw">_' + appended + b"</AppendedData></VTKFile>"
        if form == "appended"
        else b"</VTKFile>"
    )


@pytest.mark.parametrize("size", [24, 48, 4096])
@pytest.mark.parametrize("compressor", ["", "vtkZLibDataCompressor", "vtkLZMADataCompressor"])
@pytest.mark.parametrize("form", ["binary", "appended"])
def test_arrays_of_a_vtp_are_blocks_in_any_packing(form, compressor, size):
    found = parse_vtp(vtp(form, compressor, size), "m")
    np.testing.assert_array_equal(found.vertices, VERTICES)
    assert found.lengths.tolist() == [4, 3, 3, 5, 3, 3, 3]
    assert found.corners.tolist() == [*np.concatenate(FACES), 0, 1, 2, 2, 1, 3, 2, 3, 4]


@pytest.mark.parametrize("declared", [2, 4])
def test_blocks_of_another_size_than_declared_are_damage(declared):
    content = np.arange(6, dtype="<i4").tobytes()
    part = zlib.compress(content)
    data = struct.pack("<4I", 1, len(content) + declared - 3, 0, len(part)) + part
    with pytest.raises(ValueError, match="a block of"):
        vtk_xml._unpacked(data, "<u4", "vtkZLibDataCompressor", "m")
    with pytest.raises(ValueError, match="blocks declared"):
        vtk_xml._unpacked(struct.pack("<I", 99) + bytes(40), "<u4", "vtkZLibDataCompressor", "m")
    assert vtk_xml._unpacked(struct.pack("<3I", 0, 0, 0), "<u4", "vtkZLibDataCompressor", "m") == b""
    assert vtk_xml._unpacked(struct.pack("<I", 3) + b"abc \n", "<u4", "", "m") == b"abc"
    for wrong in (struct.pack("<I", 3) + b"abcd", struct.pack("<I", 3) + b"ab"):
        with pytest.raises(ValueError, match="3 bytes declared"):
            vtk_xml._unpacked(wrong, "<u4", "", "m")


@pytest.mark.parametrize("compressor", ["vtkZLibDataCompressor", "vtkLZMADataCompressor"])
def test_a_block_is_read_to_its_checksum(compressor):
    """A block that lacks its last bytes is damage even where all values could be unpacked."""
    whole = packed(np.arange(60, dtype="<i4"), compressor, 240)
    assert len(vtk_xml._unpacked(whole, "<u4", compressor, "m")) == 240
    for lost in range(1, len(whole) - 16):
        with pytest.raises(vtk_xml.DAMAGED):
            vtk_xml._unpacked(whole[:-lost], "<u4", compressor, "m")


def test_a_piece_without_points_may_leave_them_out():
    empty = '<Piece NumberOfPoints="0"></Piece>'
    found = parse_vtp(vtp("binary").replace(b"<PolyData>", f"<PolyData>{empty}".encode(), 1), "m")
    assert len(found.vertices) == 6 and found.corners[:4].tolist() == [0, 1, 2, 3]
    with pytest.raises(FileFormatError):
        parse_vtp(vtp("binary").replace(b'NumberOfPoints="6"', b'NumberOfPoints="5"'), "m")


def legacy(binary, version, metadata=True):
    """A legacy file with polygons, a strip and fields among its sections."""
    mode, blank = ("BINARY", b"\n") if binary else ("ASCII", b"\n")

    def numbers(values, code):
        values = np.ravel(values)
        return values.astype(code).tobytes() + b"\n" if binary else " ".join(map(str, values.tolist())).encode() + b"\n"

    data = f"# vtk DataFile Version {version}\ntitle\n{mode}\nDATASET POLYDATA\n".encode()
    data += b"FIELD FieldData 1\nname 2 1 int\n" + numbers([7, 8], ">i4")
    data += b"POINTS 6 double\n" + numbers(VERTICES, ">f8")
    if metadata:
        data += b"METADATA\nINFORMATION 0\n\n"
    for name, cells in (("POLYGONS", FACES), ("TRIANGLE_STRIPS", [[0, 1, 2, 3]])):
        corners = [corner for cell in cells for corner in cell]
        if version == "5.1":
            data += f"{name} {len(cells) + 1} {len(corners)}\nOFFSETS vtktypeint64\n".encode()
            data += (
                numbers(np.cumsum([0, *map(len, cells)]), ">i8")
                + b"CONNECTIVITY vtktypeint64\n"
                + numbers(corners, ">i8")
            )
        else:
            rows = [word for cell in cells for word in (len(cell), *cell)]
            data += f"{name} {len(cells)} {len(rows)}\n".encode() + numbers(rows, ">i4")
    return data + blank + b"POINT_DATA 6\nSCALARS s float\nLOOKUP_TABLE default\n" + numbers(np.arange(6), ">f4")


@pytest.mark.parametrize("metadata", [True, False])
@pytest.mark.parametrize("version", ["4.2", "5.1"])
@pytest.mark.parametrize("binary", [True, False])
def test_sections_of_a_legacy_file_are_found_one_after_the_other(binary, version, metadata):
    found = parse_legacy_vtk(legacy(binary, version, metadata), "m")
    np.testing.assert_array_equal(found.vertices, VERTICES)
    assert found.lengths.tolist() == [4, 3, 3, 5, 3, 3]
    assert found.corners.tolist() == [*np.concatenate(FACES), 0, 1, 2, 2, 1, 3]


def test_a_cursor_reads_line_by_line_and_number_by_number():
    of = legacy_vtk._Cursor(b"\n\n a b \n1 2  3\n4 rest", 0, False, "m")
    assert of.line() == ["a", "b"]
    assert of.values(4, "int").tolist() == [1, 2, 3, 4] and of.line() == ["rest"] and of.line() == []
    with pytest.raises(FileFormatError, match="3 numbers declared, found 2"):
        legacy_vtk._Cursor(b"1 2", 0, False, "m").values(3, "float")
    last = legacy_vtk._Cursor(b"1 2", 0, False, "m")
    assert last.values(2, "float").tolist() == [1, 2] and last.at == 3
    binary = legacy_vtk._Cursor(bytes(7), 0, True, "m")
    with pytest.raises(FileFormatError, match="2 numbers declared, found 7 bytes"):
        binary.values(2, "int")


def test_corners_of_an_stl_that_rounding_parted_are_one_vertex():
    """Within a millionth of the extent, on open edges alone."""
    body = Superquadric().mesh(4)
    corners = body.vertices[body.faces]
    rng = np.random.default_rng(1)
    moved = corners + 1e-7 * rng.uniform(-1, 1, corners.shape)
    record = np.zeros(len(corners), dtype=[("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
    record["corners"] = moved
    data = bytes(80) + struct.pack("<I", len(corners)) + record.tobytes()
    found = parse_stl(data, "m")
    assert len(found.vertices) == len(body.vertices) and len(found.lengths) == len(body.faces)
    np.testing.assert_allclose(found.vertices[found.corners].reshape(-1, 3, 3), corners, atol=3e-7)
    assert parse_stl(data + bytes(49), "m").corners.tolist() == found.corners.tolist()
    assert parse_stl(data + bytes(200), "m").corners.tolist() == found.corners.tolist()
    with pytest.raises(FileFormatError, match="declares"):
        parse_stl(data + bytes(50) + b"\1", "m")
    extent = 2 * np.quantile(np.abs(body.vertices - np.median(body.vertices, axis=0)), 0.9, axis=0).max()
    assert stl._rounding(body.vertices) == pytest.approx(1e-6 * extent)
    far = body.vertices + 1e4
    assert stl._rounding(far) == pytest.approx(2 * np.spacing(np.float32(1e4)))


@pytest.mark.parametrize(("gap", "merged"), [(0.4e-6, True), (0.6e-6, False)])
def test_corners_farther_apart_than_a_tenth_of_an_edge_stay_two(gap, merged):
    """Of triangles with edges of five millionths of the extent, which would be put together at one millionth."""
    tiny = 5e-6 * np.array([[0, 0, 0], [1, 0, 0], [0.5, 0.866025404, 0]])
    shifts = [(gap * k, 0, 0) for k in range(2)] + [(1e-3 * k, 1e-3, 0) for k in range(1, 4)]
    triangles = [tiny + np.array(shift) for shift in shifts]
    triangles.append(np.array([[4.0, 0, 0], [0, 4, 0], [-4, -4, 0]]))
    vertices, faces = np.concatenate(triangles), np.arange(18).reshape(6, 3)
    assert 1e-6 < stl._rounding(vertices) < 4e-6
    found, index = stl._merged(vertices, faces)
    assert len(found) == (15 if merged else 18) and len(index) == 6


def test_a_moving_surface_has_its_points_one_step_after_the_other(tmp_path):
    h5py = pytest.importorskip("h5py")
    surfaces, box = made(), ControlBox.around(made())
    states = [single(surfaces, box.with_control_points(scale * box.control_points)) for scale in (1.0, 1.1, 0.8)]
    path = tmp_path / "m.vtkhdf"
    path.write_bytes(
        encode_vtkhdf([s.__class__(s.surfaces, s.box, "LPS", "mm") for s in states], [0.0, 0.5, 2.0], resolution=4)
    )
    rest, quads = surfaces.grid(4)
    faces = split_quads(quads, states[0].deform(rest))
    with h5py.File(path) as file:
        root, n = file["VTKHDF"], len(rest)
        assert root["NumberOfPoints"][:].tolist() == [n]
        np.testing.assert_allclose(root["Points"][:], np.concatenate([state.deform(rest) for state in states]))
        assert root["Polygons/Connectivity"][:].tolist() == faces.ravel().tolist()
        assert root["Polygons/Offsets"][:].tolist() == list(range(0, 3 * len(faces) + 1, 3))
        assert root["Polygons/NumberOfCells"][:].tolist() == [len(faces)]
        assert root["Polygons/NumberOfConnectivityIds"][:].tolist() == [3 * len(faces)]
        assert root["Lines/Offsets"][:].tolist() == [0] and root["Lines/NumberOfCells"][:].tolist() == [0]
        steps = root["Steps"]
        assert steps["PointOffsets"][:].tolist() == [0, n, 2 * n] and steps["Values"][:].tolist() == [0, 0.5, 2]
        assert steps["NumberOfParts"][:].tolist() == [1, 1, 1] and steps.attrs["NSteps"] == 3
        assert not steps["PartOffsets"][:].any() and steps["CellOffsets"].shape == (3, 4)
        assert not steps["CellOffsets"][:].any() and not steps["ConnectivityIdOffsets"][:].any()
        assert root.attrs["Version"].tolist() == [2, 0] and root.attrs["SURFACES"] == b"surface"
        assert not root["PointData/surface"][:].any()
