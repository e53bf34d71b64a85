"""Mesh files as other programs write them, each a fault that was found once; made here, and those of a folder read."""

import json

import numpy as np
import pytest
from mesh_dialects import TRIANGLES, VERTICES, VOLUME, obj, obj_interleaved, ply, ply_body, stl
from shapes_made import made

import quadriform as qf
from quadriform.cli.main import main
from quadriform.errors import FileFormatError, PointsError, QuadriformError
from quadriform.files import read_mesh, read_points
from quadriform.files.meshes import encode_mesh, read_mesh_or_points
from quadriform.shapes.comparison import enclosed_volume, is_closed
from quadriform.shapes.mesh import Mesh


@pytest.fixture
def written(tmp_path):
    def write(name, content):
        (tmp_path / name).write_bytes(content)
        return tmp_path / name

    return write


def soup(mesh, noise):
    """ASCII STL whose corners are moved a little, each in another way."""
    corners = mesh.vertices[mesh.faces]
    corners = corners + noise * np.random.default_rng(0).uniform(-1, 1, corners.shape)
    lines = ["solid a"]
    for triangle in corners:
        rows = [" ".join(f"{x:.9e}" for x in corner) for corner in triangle]
        lines += ["facet normal 0 0 0", "outer loop", *(f"vertex {row}" for row in rows), "endloop", "endfacet"]
    return "\n".join([*lines, "endsolid a", ""]).encode()


@pytest.mark.parametrize("shift", [0.0, 1e3])
def test_corners_of_an_stl_that_differ_in_the_last_digits_are_one(written, shift):
    mesh = made().mesh(12)
    size = np.ptp(mesh.vertices, axis=0).max()
    found = read_mesh(written("a.stl", soup(Mesh(mesh.vertices + shift * size, mesh.faces), 2e-7 * size)))
    assert len(found.vertices) == len(mesh.vertices)
    assert is_closed(found)
    assert enclosed_volume(found) == pytest.approx(mesh.volume(), rel=1e-5)


def test_small_parts_of_an_stl_are_not_merged(written):
    """A bead of a millionth of the extent, far from the origin of a large open plate, keeps its vertices."""
    square = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1.0, 0]])
    bead = made().mesh(4)
    small = bead.vertices / np.ptp(bead.vertices, axis=0).max()
    for scale in (1e-4, 1e-6):
        vertices = np.concatenate([square, square + np.array([2, 0, 0]), small * scale + 0.5])
        faces = np.concatenate([[[0, 1, 2], [0, 2, 3]], np.array([[0, 1, 2], [0, 2, 3]]) + 4, bead.faces + 8])
        found = read_mesh(written("a.stl", soup(Mesh(vertices, faces), 0.0)))
        assert len(found.vertices) == len(np.unique(vertices, axis=0))


def test_a_closed_stl_is_merged_by_equal_bits_alone(written):
    mesh = made().mesh(12)
    found = read_mesh(written("a.stl", encode_mesh(mesh, ".stl", "LPS", "mm")))
    single = np.unique(mesh.vertices.astype(np.float32).astype(float), axis=0)
    assert np.array_equal(found.vertices, single)


def test_a_line_end_behind_a_binary_ply(written):
    for after in (b"\n", b"\r\n"):
        mesh = read_mesh(written("a.ply", ply("binary_little_endian", after=after)))
        assert mesh.volume() == pytest.approx(VOLUME)


def test_points_of_a_ply_that_are_not_numbers(written):
    rows = np.vstack([VERTICES, np.full((2, 3), np.nan)])
    for form in ("ascii", "binary_little_endian"):
        path = written("a.ply", ply(form, [("vertex", ply_body()[0][1], rows)]))
        with pytest.raises(PointsError, match="2 of 18 rows are not finite, the first at index 16"):
            read_points(path)


def test_a_cloud_with_lists_of_unequal_length_and_no_faces(written):
    properties = [*ply_body()[0][1], ("uchar", "int", "view")]
    rows = [[*row, list(range(n % 3))] for n, row in enumerate(VERTICES)]
    empty = ("face", [("ushort", "int", "vertex_indices")], [])
    path = written("a.ply", ply("binary_little_endian", [("vertex", properties, rows), empty]))
    assert np.array_equal(read_points(path), VERTICES)
    assert len(read_mesh_or_points(path).faces) == 0


def test_vertices_of_an_obj_counted_back_between_polygons(written):
    mesh = read_mesh(written("a.obj", obj_interleaved()))
    assert enclosed_volume(mesh) == pytest.approx(VOLUME)


def test_materials_and_textures_multiply_no_vertices(written):
    textures = "mtllib a.mtl\nvt 0 0\nvt 1 0\nvt 1 1\nvn 0 0 1\nusemtl red"
    content = obj(lambda k, n: f"{k + 1}/{(k + n) % 3 + 1}/1", between=textures)
    path = written("a.obj", content.replace(b"f 4", b"usemtl blue\nf 4"))
    assert np.array_equal(read_points(path), VERTICES)
    assert read_mesh(path).volume() == pytest.approx(VOLUME)


def test_meshes_of_few_vertices_are_fitted_whatever_their_format(written):
    """The polygons of a PLY, the triangles of an STL: the same surface, the same superquadric to sampling."""
    volumes = []
    for name, content in (("a.ply", ply()), ("a.stl", stl())):
        mesh = read_mesh(written(name, content))
        volumes.append(qf.fit_superquadric(mesh).superquadric.volume())
        assert np.array_equal(np.unique(mesh.vertices, axis=0), np.unique(VERTICES[TRIANGLES].reshape(-1, 3), axis=0))
    assert volumes[0] == pytest.approx(volumes[1], rel=0.02)


SPHEROID, CYLINDER, SPHERES = 24_282.268, 2329.371, 24_552.77
CASES = {
    "cad/cyl64.stl": 18_819.291,
    "cad/cone64.stl": 3136.549,
    "ply/cyl_ngon_bin.ply": CYLINDER,
    "ply/cyl_tri_quad_bin.ply": CYLINDER,
    "ply/trailing_newline.ply": SPHEROID,
    "ply/cc760_var.ply": 162,
    "ply/nan_points.ply": PointsError,
    "obj/cont.obj": SPHEROID,
    "obj/neg_interleaved.obj": SPHEROID,
    "obj/neg_slash.obj": SPHEROID,
    "obj/uvw.obj": SPHEROID,
    "stl/cracks.stl": SPHEROID,
    "stl/trailing.stl": SPHEROID,
    "vtk/ascii.vtp": SPHERES,
    "vtk/default.vtp": SPHERES,
    "vtk/cloud.vtp": 362,
    "vtk/legacy_ascii.vtk": SPHERES,
}
"""Volume inside, number of points of a cloud, or the error."""


@pytest.mark.parametrize("name", CASES)
def test_files_that_failed_once(shared, name):
    path, expected = shared / "cases" / name, CASES[name]
    if not path.exists():
        pytest.skip(f"{name} is not beside this repository")
    if isinstance(expected, type):
        with pytest.raises(expected, match=path.name):
            read_mesh_or_points(path)
        return
    mesh = read_mesh_or_points(path)
    found = enclosed_volume(mesh) if isinstance(expected, float) else len(mesh.vertices)
    assert found == pytest.approx(expected, rel=1e-5)


@pytest.mark.parametrize("name", CASES)
def test_files_that_failed_once_on_a_terminal(shared, capsys, name):
    path, expected = shared / "cases" / name, CASES[name]
    if not path.exists():
        pytest.skip(f"{name} is not beside this repository")
    code, shown = main(["info", str(path), "--json"]), capsys.readouterr()
    if isinstance(expected, type):
        assert code == 4 and len(shown.err.splitlines()) == 1
        return
    record, mesh = json.loads(shown.out), read_mesh_or_points(path)
    assert (code, shown.err) == (0, "")
    assert record["kind"] == ("mesh" if isinstance(expected, float) else "points")
    assert record.get("vertices", record.get("points")) == len(mesh.vertices)
    assert record.get("area", 0.0) == pytest.approx(mesh.area(), rel=1e-12)


def test_there_is_no_other_case(shared):
    folders = [shared / "cases" / name for name in ("cad", "ply", "obj", "stl", "vtk")]
    if not all(folder.is_dir() for folder in folders):
        pytest.skip("the folder of cases is not beside this repository")
    found = {f"{folder.name}/{path.name}" for folder in folders for path in folder.iterdir()}
    assert found <= set(CASES)
    assert issubclass(PointsError, QuadriformError)


FACET = "facet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\nendloop\nendfacet\n"
SQUARE = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\n"


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("quad.stl", f"solid a\n{FACET.replace('endloop', 'vertex 1 1 0')}endsolid a\n", "4 corners in 1 facets"),
        ("edge.stl", "solid a\n" + FACET.replace("vertex 0 1 0\n", "") + "endsolid a\n", "2 corners in 1 facets"),
        ("cut.stl", "solid a\n" + FACET, "cut short, found 1 lines facet, 1 lines endfacet, 1 lines solid, 0 "),
        ("cut in a facet.stl", "solid a\n" + FACET + FACET[:43], "cut short, found 2 lines facet, 1 lines endfacet"),
        ("from zero.obj", SQUARE + "f 0 1 2 3\n", "line 5: .* whole numbers or more, counted from 1 .* 'f 0 1"),
        ("decimal.obj", SQUARE + "f 1.0 2.0 3.0\n", "line 5: expected three whole numbers"),
    ],
)
def test_what_is_wrong_with_a_mesh_is_reported(tmp_path, name, content, message):
    (tmp_path / name).write_text(content)
    with pytest.raises(FileFormatError, match=message):
        qf.load(tmp_path / name)
