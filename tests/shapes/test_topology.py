"""Meshes of every kind: closed or with exactly the cuts' loops, one winding, outward, and no slivers."""

import numpy as np
import pytest
from shapes_made import KINDS, made

from quadriform.shapes.control_box import ControlBox
from quadriform.shapes.directions import sphere_grid
from quadriform.shapes.mesh import split_quads
from quadriform.shapes.model import DeformableModel

LOOPS = {"ellipsoid": 0, "toroid": 0, "hyperboloid1": 2, "hyperboloid2": 2}
EULER = {"ellipsoid": 2, "toroid": 0, "hyperboloid1": 0, "hyperboloid2": 2}
EXPONENTS = [(1.0, 1.0), (0.6, 1.4), (0.3, 0.3), (2.0, 2.0)]


def half_edges(faces):
    return np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])


def boundary_loops(faces):
    """How many closed chains the edges without an opposite form; each vertex must have one way on."""
    directed = {tuple(edge) for edge in half_edges(faces)}
    way = {a: b for a, b in directed if (b, a) not in directed}
    assert sorted(way) == sorted(way.values())
    loops = 0
    while way:
        at = next(iter(way))
        while at in way:
            at = way.pop(at)
        loops += 1
    return loops


def smallest_angle(mesh):
    a, b, c = (mesh.vertices[mesh.faces[:, k]] for k in range(3))
    smallest = np.inf
    for at, one, other in ((a, b, c), (b, c, a), (c, a, b)):
        u, v = one - at, other - at
        lengths = np.linalg.norm(u, axis=1) * np.linalg.norm(v, axis=1)
        assert lengths.min() > 0
        smallest = min(smallest, np.arccos(np.clip((u * v).sum(axis=1) / lengths, -1, 1)).min())
    return np.degrees(smallest)


@pytest.mark.parametrize("resolution", [1, 2, 7, 12])
@pytest.mark.parametrize("kind", KINDS)
def test_closed_or_cut_with_one_winding(kind, resolution):
    mesh = made(kind).mesh(resolution)
    edges = half_edges(mesh.faces)
    assert len(np.unique(edges, axis=0)) == len(edges), "two faces run along an edge in the same sense"
    assert boundary_loops(mesh.faces) == LOOPS[kind]
    assert len(np.unique(mesh.faces)) == len(mesh.vertices), "a vertex without a face"
    undirected = len(np.unique(np.sort(edges, axis=1), axis=0))
    assert len(mesh.vertices) - undirected + len(mesh.faces) == EULER[kind]
    assert mesh.faces.dtype == np.int64


@pytest.mark.parametrize("exponents", EXPONENTS)
@pytest.mark.parametrize("kind", KINDS)
def test_faces_look_outward(kind, exponents):
    s = made(kind, exponents)
    mesh = s.mesh(12)
    normals, gradients = mesh.area_vectors(), s.gradient(mesh.vertices[mesh.faces].mean(axis=1))
    cosines = (normals * gradients).sum(axis=1) / np.linalg.norm(normals, axis=1) / np.linalg.norm(gradients, axis=1)
    assert cosines.min() > 0.9


@pytest.mark.parametrize("exponents", EXPONENTS)
@pytest.mark.parametrize("kind", KINDS)
def test_no_slivers(kind, exponents):
    """No angle below 15 degrees, at poles, seams and rims neither."""
    assert smallest_angle(made(kind, exponents).mesh(12)) > 15


@pytest.mark.parametrize(("stretch", "diagonal"), [((3.0, 1.0), {1, 3}), ((1.0, 3.0), {0, 2}), ((1.0, 1.0), {0, 2})])
def test_quads_are_cut_along_their_shorter_diagonal(stretch, diagonal):
    """A rhombus; where both diagonals are equal, along the first."""
    rhombus = np.array([[-1.0, 0, 0], [0, -1, 0], [1, 0, 0], [0, 1, 0]]) * [*stretch, 1]
    triangles = split_quads(np.array([[0, 1, 2, 3]]), rhombus)
    assert set(triangles[0]) & set(triangles[1]) == diagonal
    normals = np.cross(*(rhombus[triangles[:, k]] - rhombus[triangles[:, 0]] for k in (1, 2)))
    assert (normals[:, 2] > 0).all()


def test_vertices_lie_even_on_the_sphere():
    """No bunching: the largest of all cells is at most 2.5 times the smallest, where latitude and longitude have 20."""
    directions, quads = sphere_grid(16)
    a, b, c, d = (directions[quads[:, k]] for k in range(4))
    areas = np.linalg.norm(np.cross(c - a, d - b), axis=1) / 2
    assert areas.max() / areas.min() < 2.5


def test_grid_has_the_symmetries_of_the_cube():
    directions, _ = sphere_grid(6)

    def rows(points):
        return np.unique(points.round(12) + 0.0, axis=0)

    for image in (-directions, directions[:, [1, 2, 0]], directions * [-1, 1, 1], directions[:, [1, 0, 2]]):
        np.testing.assert_array_equal(rows(image), rows(directions))


def test_deformed_mesh_stays_closed_and_outward(rng):
    s = made(exponents=(0.8, 1.2))
    box = ControlBox.around(s)
    box = box.with_control_points(box.control_points + 0.3 * rng.normal(size=box.control_points.shape))
    mesh = DeformableModel({"surface": s}, box).mesh(resolution=12)
    assert boundary_loops(mesh.faces) == 0
    assert mesh.volume() > 0
