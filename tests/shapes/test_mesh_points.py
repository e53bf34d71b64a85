"""Points that stand for a mesh: by area where vertices are few, the vertices themselves where they are dense."""

import numpy as np
import pytest
from scipy.spatial import cKDTree
from shapes_made import made
from shapes_meshes import box_mesh, cone_mesh, dense_dome, prism_mesh

import quadriform as qf
from quadriform.errors import OptionError, PointsError, WarningKind
from quadriform.shapes.mesh import Mesh
from quadriform.shapes.mesh_points import MOST_SAMPLES, SAMPLES, mesh_points

SPARSE = {"block": box_mesh(), "prism": prism_mesh(), "dome": dense_dome(), "plate": box_mesh((100, 100, 0.1))}
SPARSE["open prism"] = Mesh(prism_mesh().vertices, prism_mesh().faces[:128])
SPARSE["two blocks"] = Mesh(
    np.concatenate([box_mesh().vertices, box_mesh((40, 5, 5)).vertices + 50]),
    np.concatenate([box_mesh().faces, box_mesh().faces + 8]),
)


def area_moments(mesh):
    """Mean and second moments over the area, exactly: midpoints of edges integrate polynomials of degree two."""
    corners = mesh.vertices[mesh.faces]
    middles = (corners + np.roll(corners, 1, axis=1)) / 2
    areas = np.linalg.norm(mesh.area_vectors(), axis=1) / mesh.area()
    mean = np.einsum("m,mkx->x", areas, middles) / 3
    return mean, np.einsum("m,mkx,mky->xy", areas, middles - mean, middles - mean) / 3


@pytest.mark.parametrize("name", SPARSE)
def test_points_are_even_over_the_area(name):
    mesh = SPARSE[name]
    points, note = mesh_points(mesh)
    assert "spread evenly over the area" in note
    mean, moments = area_moments(mesh)
    size = np.sqrt(np.trace(moments))
    assert np.abs(points.mean(axis=0) - mean).max() < 6e-3 * size  # as many random points: 1.4e-2
    assert np.abs(np.cov(points.T) - moments).max() < 6e-3 * size**2


@pytest.mark.parametrize("name", SPARSE)
def test_no_part_of_the_surface_is_without_points(name):
    """No place on the surface is further than two and a half spacings from a point."""
    mesh = SPARSE[name]
    points = mesh_points(mesh)[0]
    rng = np.random.default_rng(0)
    areas = np.linalg.norm(mesh.area_vectors(), axis=1)
    triangle = rng.choice(len(areas), 20_000, p=areas / areas.sum())
    weights = rng.dirichlet(np.ones(3), 20_000)
    places = np.einsum("nk,nki->ni", weights, mesh.vertices[mesh.faces[triangle]])
    spacing = np.sqrt(mesh.area() / len(points))
    assert cKDTree(points).query(places)[0].max() < 2.5 * spacing


def test_points_lie_on_the_surface_of_the_block():
    points = mesh_points(box_mesh())[0]
    share = points / [10, 20, 30]
    assert (np.abs(share - np.round(share)).min(axis=1) < 1e-12).all()
    assert ((share > -1e-12) & (share < 1 + 1e-12)).all()


@pytest.mark.parametrize("name", SPARSE)
def test_neither_order_nor_repetition_of_triangles_matters(name):
    mesh = SPARSE[name]
    rng = np.random.default_rng(1)
    place = rng.permutation(len(mesh.vertices))
    vertices = np.empty_like(mesh.vertices)
    vertices[place] = mesh.vertices
    faces = np.roll(place[mesh.faces], 1, axis=1)[rng.permutation(len(mesh.faces))]
    faces = np.concatenate([faces, faces[:5, ::-1], faces[:3], np.repeat(faces[:4, :1], 3, axis=1)])
    assert np.array_equal(mesh_points(Mesh(vertices, faces))[0], mesh_points(mesh)[0])


def test_a_soup_of_triangles_has_the_same_points():
    mesh = prism_mesh()
    soup = Mesh(mesh.vertices[mesh.faces].reshape(-1, 3), np.arange(3 * len(mesh.faces)).reshape(-1, 3))
    assert np.array_equal(mesh_points(soup)[0], mesh_points(mesh)[0])


@pytest.mark.parametrize("scale", [1e-150, 1e-3, 1e6, 1e150])
def test_any_unit(scale):
    mesh = box_mesh()
    points = mesh_points(Mesh(mesh.vertices * scale, mesh.faces))[0]
    np.testing.assert_allclose(points / scale, mesh_points(mesh)[0], atol=1e-9)


def test_dense_vertices_are_taken_as_they_are():
    mesh = made().mesh(24)
    points, note = mesh_points(mesh)
    assert points is mesh.vertices and note is None


def test_slivers_do_not_make_a_dense_mesh_sparse():
    mesh = made().mesh(24)
    far = np.argmax(np.linalg.norm(mesh.vertices - mesh.vertices[0], axis=1))
    sliver = [0, far, mesh.faces[mesh.faces[:, 0] == far][0, 1]]
    assert mesh_points(Mesh(mesh.vertices, np.vstack([mesh.faces, [[0, far, 0], sliver]])))[1] is None


def test_a_cloud_without_triangles_and_triangles_without_area_are_their_vertices():
    vertices = box_mesh().vertices
    for faces in (np.empty((0, 3), np.int64), np.array([[0, 0, 1], [2, 2, 2]])):
        assert mesh_points(Mesh(vertices, faces)) == (vertices, None)


def test_vertices_of_no_triangle_stay():
    mesh = box_mesh()
    points, note = mesh_points(Mesh(np.vstack([mesh.vertices, [[99.0, 0, 0]]]), mesh.faces))
    assert "1 vertices that no triangle uses" in note
    assert points[-1].tolist() == [99.0, 0, 0]


def test_as_many_points_as_vertices_within_limits():
    assert len(mesh_points(box_mesh())[0]) == SAMPLES < MOST_SAMPLES
    dome = dense_dome(100, 200)
    assert len(mesh_points(dome)[0]) == len(dome.vertices) > SAMPLES


def test_where_a_mesh_stands_does_not_matter():
    mesh, away = box_mesh(), np.array([70.0, -20.0, 300.0])
    points, note = mesh_points(mesh)
    moved, moved_note = mesh_points(Mesh(mesh.vertices + away, mesh.faces))
    np.testing.assert_allclose(moved, points + away, atol=1e-10)
    assert moved_note == note and f"{np.sqrt(mesh.area() / SAMPLES):.3g} apart" in note


class TestFits:
    @pytest.fixture(autouse=True)
    def fewer(self, monkeypatch):
        """Fewer points, which know these bodies as well."""
        monkeypatch.setattr("quadriform.shapes.mesh_points.SAMPLES", 800)

    @pytest.mark.parametrize("mesh", [box_mesh(), prism_mesh()], ids=["block", "prism"])
    def test_the_volume_of_a_body_with_few_vertices(self, mesh):
        found = qf.fit(mesh, box=(3, 3, 3))
        assert found.model.volume() == pytest.approx(mesh.volume(), rel=0.01)
        assert found.n_points == 800 and "spread evenly over the area" in found.notes[0]

    def test_a_cone_is_a_closed_body_without_folds(self):
        """Its rim, where base and mantle meet at 63 degrees, was once taken for the edge of an open cloud."""
        mesh = cone_mesh()
        found = qf.fit(mesh, box=(3, 3, 3))
        assert found.model.volume() == pytest.approx(mesh.volume(), rel=0.01)
        assert not {WarningKind.FOLDING, WarningKind.PARTIAL_COVERAGE} & found.warnings.keys()

    def test_a_dense_mesh_is_fitted_as_its_vertices(self):
        mesh = made().mesh(12)
        one, two = (qf.fit_superquadric(given) for given in (mesh, mesh.vertices))
        assert np.array_equal(one.superquadric.parameters, two.superquadric.parameters) and one.notes == ()

    def test_a_mesh_of_trimesh(self):
        import trimesh

        ours = box_mesh()
        theirs = trimesh.Trimesh(ours.vertices, ours.faces, process=False)
        one, two = (qf.fit_superquadric(given).superquadric.parameters for given in (ours, theirs))
        assert np.array_equal(one, two)

    def test_weights_are_for_points(self):
        with pytest.raises(OptionError, match="weights"):
            qf.fit(box_mesh(), weights=np.ones(8))

    @pytest.mark.parametrize("faces", [[[0, 1, 8]], [[-1, 0, 1]], [[0, 1, 2, 3]], [[0.0, 1, 2]]])
    def test_faces_that_cannot_be(self, faces):
        with pytest.raises(PointsError, match="mesh, faces"):
            qf.fit(Mesh(box_mesh().vertices, np.array(faces)))
