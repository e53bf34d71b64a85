"""Meshes out and in again; damaged ones refused where the reader underneath would not."""

import base64
import xml.etree.ElementTree as ElementTree

import numpy as np
import pytest
import trimesh

from quadriform.errors import FileFormatError, FileLimitError, OptionError, OutputError, PointsError
from quadriform.files.meshes import WRITE_SUFFIXES, encode_mesh, read_mesh, read_space_and_unit, write_mesh
from quadriform.shapes.mesh import Mesh

EXACTNESS = {".ply": 1e-6, ".stl": 1e-6, ".obj": 1e-8, ".vtp": 0.0}
SQUARE = Mesh(np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0.5]]), np.array([[0, 1, 2], [0, 2, 3]]))
PLY = (
    "ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\nelement face 2\n"
    "property list uchar int vertex_indices\nend_header\n0 0 0\n1 0 0\n0 1 0\n0 0 1\n3 0 1 2\n3 0 1 3\n"
)


@pytest.mark.parametrize("suffix", WRITE_SUFFIXES)
@pytest.mark.parametrize("scale", [1e-3, 1.0, 1e3])
def test_round_trip(tmp_path, mesh, suffix, scale):
    mesh = Mesh(mesh.vertices * scale, mesh.faces)
    path = tmp_path / f"m{suffix}"
    write_mesh(mesh, path, "LPS", "mm")
    back = read_mesh(path)
    assert back.vertices.shape == mesh.vertices.shape
    assert back.faces.dtype == np.int64
    corners, expected = back.vertices[back.faces], mesh.vertices[mesh.faces]
    assert np.abs(corners - expected).max() <= EXACTNESS[suffix] * np.abs(mesh.vertices).max()
    assert back.volume() == pytest.approx(mesh.volume(), rel=1e-5)


@pytest.mark.parametrize("suffix", WRITE_SUFFIXES)
def test_the_same_mesh_gives_the_same_bytes(mesh, suffix):
    assert encode_mesh(mesh, suffix, "LPS", "mm") == encode_mesh(mesh, suffix, "LPS", "mm")


@pytest.mark.parametrize("suffix", [".ply", ".stl", ".obj"])
def test_frame_and_unit_stand_in_the_head(mesh, suffix):
    head = encode_mesh(mesh, suffix, "LPS", "mm")[:160]
    assert b"SPACE=LPS UNIT=mm" in head
    assert not (suffix == ".stl" and head.startswith(b"solid"))


def test_vtp_is_what_the_format_describes(mesh):
    root = ElementTree.fromstring(encode_mesh(mesh, ".vtp", "RAS", "m"))
    codes = {item.get("Name"): item.text for item in root.findall("PolyData/FieldData/DataArray")}
    assert {k: bytes(map(int, v.split())) for k, v in codes.items()} == {"SPACE": b"RAS\0", "UNIT": b"m\0"}
    raw = base64.b64decode(root.find("PolyData/Piece/Points/DataArray").text)
    assert int.from_bytes(raw[:8], "little") == len(raw) - 8 == mesh.vertices.size * 8
    assert np.array_equal(np.frombuffer(raw[8:]).reshape(-1, 3), mesh.vertices)


def test_vtp_in_ascii_is_read(tmp_path):
    path = tmp_path / "m.vtp"
    path.write_text(
        '<VTKFile type="PolyData"><PolyData><Piece NumberOfPoints="3" NumberOfPolys="1"><Points>'
        '<DataArray type="Float32" NumberOfComponents="3" format="ascii">0 0 0 1 0 0 0 1 0</DataArray></Points><Polys>'
        '<DataArray type="Int32" Name="connectivity" format="ascii">0 1 2</DataArray>'
        '<DataArray type="Int32" Name="offsets" format="ascii">3</DataArray></Polys></Piece></PolyData></VTKFile>'
    )
    assert read_mesh(path).area() == pytest.approx(0.5, rel=1e-12)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('NumberOfPoints="4"', 'NumberOfPoints="5"', "NumberOfPoints"),
        ('NumberOfPolys="2"', 'NumberOfPolys="1"', "NumberOfPolys"),
        ('NumberOfPolys="2"', 'NumberOfPolys="two"', "whole number"),
        ('format="binary"', 'format="appended"', "appended data"),
        ("</Points>", "", "expected a VTK XML file"),
        ("<PolyData>", '<!DOCTYPE x [<!ENTITY a "b">]><PolyData>', "document type"),
        ('type="PolyData"', 'type="PolyData" compressor="z"', "compressed"),
        ('type="PolyData"', 'type="ImageData"', "PolyData"),
        ('type="Float64"', 'type="Int128"', "Points/DataArray"),
        ("AAAA", "AA", "damaged"),
        (">YAAA", ">UAAA", "80 bytes declared, 96 found"),
    ],
)
def test_bad_vtp(tmp_path, old, new, message):
    text = encode_mesh(SQUARE, ".vtp", "LPS", "mm").decode()
    assert old in text
    path = tmp_path / "m.vtp"
    path.write_text(text.replace(old, new))
    with pytest.raises(FileFormatError, match=message):
        read_mesh(path)


@pytest.mark.parametrize(
    ("content", "error", "message"),
    [
        (PLY[:-8], FileFormatError, "declares 6 rows, found 5"),
        (PLY + "1 1 1\n", FileFormatError, "declares 6 rows, found 7"),
        (PLY.replace("vertex 4", "vertex 3"), FileFormatError, "declares 5 rows, found 6"),
        (PLY.replace("vertex 4", "vertex 2000000000000"), FileLimitError, "budget"),
        (PLY.replace("ascii", "binary_little_endian").replace("vertex 4", "vertex 2000"), FileFormatError, "only"),
        (PLY.replace("3 0 1 3", "3 0 1 4"), FileFormatError, "names vertex 4"),
        (PLY.replace("3 0 1 3", "3 0 1 -1"), FileFormatError, "names vertex|face"),
        (PLY.replace("3 0 1 3", "3 0 1"), FileFormatError, "PLY|ply|declares"),
        (PLY.replace("0 0 1", "0 0 nan"), PointsError, "not finite"),
        (PLY.replace("0 0 1\n", "a b c\n"), FileFormatError, "expected a number"),
        ("hello", FileFormatError, "expected a PLY header, found text"),
    ],
)
def test_bad_ply(tmp_path, content, error, message):
    path = tmp_path / "m.ply"
    path.write_text(content)
    with pytest.raises(error, match=message):
        read_mesh(path)


@pytest.mark.parametrize("suffix", [".stl", ".obj"])
@pytest.mark.parametrize("content", ["hello\n", "solid x\nendsolid x\n", "v 1 2\nv 3 4\nv 5 6\nf 1 2 3\n", "f 1 2 3\n"])
def test_files_without_a_mesh(tmp_path, suffix, content):
    path = tmp_path / f"m{suffix}"
    path.write_text(content)
    with pytest.raises(FileFormatError, match=r"m\.(stl|obj)'"):
        read_mesh(path)


@pytest.mark.parametrize("suffix", [".ply", ".stl", ".vtp"])
def test_a_binary_mesh_cut_anywhere_is_refused(tmp_path, mesh, suffix):
    whole = encode_mesh(mesh, suffix, "LPS", "mm").rstrip()
    path = tmp_path / f"m{suffix}"
    for length in range(1, len(whole), len(whole) // 40):
        path.write_bytes(whole[:length])
        with pytest.raises(FileFormatError):
            read_mesh(path)


@pytest.mark.parametrize("more", [b"\0", b"\0" * 12])
def test_a_binary_ply_with_more_than_it_promises_is_refused(tmp_path, mesh, more):
    path = tmp_path / "m.ply"
    path.write_bytes(encode_mesh(mesh, ".ply", "LPS", "mm") + more)
    with pytest.raises(FileFormatError, match="bytes are left after the last row"):
        read_mesh(path)


@pytest.mark.parametrize(
    "line",
    ["v 0 0", "v 0 0 1x", "f 1 2", "f 1 2 x", "f 1 2 /3", "f 1 2 0", "f 1 00/1 2", "f1 2 3", "v1 2 3"],
)
def test_a_line_of_an_obj_that_is_not_whole_is_refused(tmp_path, line):
    """Some readers leave such lines out without a word, and take vertex 0 for the first."""
    path = tmp_path / "m.obj"
    path.write_text(f"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n{line}\n")
    with pytest.raises(FileFormatError, match="line 5"):
        read_mesh(path)


def test_a_cloud_is_no_mesh(tmp_path):
    path = tmp_path / "m.obj"
    path.write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\n")
    with pytest.raises(FileFormatError, match="3 vertices without"):
        read_mesh(path)


def test_an_obj_opens_no_second_file(tmp_path):
    (tmp_path / "m.obj").write_text("mtllib other.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nusemtl a\nf 1 2 3\n")
    (tmp_path / "other.mtl").symlink_to("/dev/zero")  # reading it would never end
    assert len(read_mesh(tmp_path / "m.obj").faces) == 1


def test_seams_of_a_texture_split_no_vertices(tmp_path):
    (tmp_path / "m.obj").write_text(
        "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\nvt .5 .5\nf 1/1 2/2 3/3\nf 1/5 3/3 4/4\n"
    )
    text = PLY.replace("vertex_indices\n", "vertex_indices\nproperty list uchar float texcoord\n")
    text = text.replace("3 0 1 2", "3 0 1 2 6 0 0 1 0 0 1").replace("3 0 1 3", "3 0 1 3 6 .5 0 1 0 0 .7")
    (tmp_path / "m.ply").write_text(text)
    assert read_mesh(tmp_path / "m.obj").vertices.tolist() == [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]
    assert read_mesh(tmp_path / "m.ply").vertices.tolist() == [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]]


def test_single_precision_far_from_the_origin_is_refused(tmp_path, mesh):
    far = Mesh(mesh.vertices + 1e8, mesh.faces)
    with pytest.raises(OutputError, match="single precision"):
        write_mesh(far, tmp_path / "m.stl")
    assert not list(tmp_path.iterdir())
    write_mesh(far, tmp_path / "m.vtp")


@pytest.mark.parametrize(("offset", "number"), [(0, "float"), (5e6, "double"), (1e8, "double"), (1e29, "double")])
def test_a_ply_has_double_precision_where_single_would_spoil_it(tmp_path, mesh, offset, number):
    far = Mesh(mesh.vertices * max(1, offset / 1e20) + offset, mesh.faces)
    write_mesh(far, tmp_path / "m.ply", "LPS", "mm")
    header = (tmp_path / "m.ply").read_bytes().partition(b"end_header")[0].decode()
    assert f"property {number} x" in header
    back = read_mesh(tmp_path / "m.ply")
    assert np.array_equal(back.faces, far.faces)
    if number == "double":
        assert np.array_equal(back.vertices, far.vertices)
    independent = trimesh.load(tmp_path / "m.ply", process=False)
    assert np.array_equal(independent.vertices, back.vertices) and np.array_equal(independent.faces, far.faces)


def test_unknown_suffix_frame_and_unit(tmp_path, mesh):
    with pytest.raises(FileFormatError, match=r"expected \.ply \.stl \.obj \.vtp"):
        write_mesh(mesh, tmp_path / "m.off")
    with pytest.raises(OptionError, match="space"):
        write_mesh(mesh, tmp_path / "m.ply", space="up")
    with pytest.raises(OptionError, match="unit"):
        write_mesh(mesh, tmp_path / "m.ply", unit="mm\nelement vertex 0")
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("suffix", WRITE_SUFFIXES)
@pytest.mark.parametrize("marks", [("LPS", "mm"), ("RAS", "m"), ("unknown", "unknown")])
def test_marks_are_read_back(tmp_path, mesh, suffix, marks):
    write_mesh(mesh, tmp_path / f"m{suffix}", *marks)
    assert read_space_and_unit(tmp_path / f"m{suffix}") == marks


def test_a_mesh_without_marks(tmp_path):
    (tmp_path / "m.ply").write_text(PLY)
    assert read_space_and_unit(tmp_path / "m.ply") == ("unknown", "unknown")
