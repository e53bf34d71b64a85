"""The inside of a mesh on a grid: a voxel counts by its centre, however the mesh lies or is wound."""

import numpy as np
import pytest
from shapes_made import made
from shapes_meshes import box_mesh

from quadriform.shapes.mesh import Mesh
from quadriform.shapes.superquadric import Superquadric
from quadriform.shapes.voxels import OFF_GRID, voxels_inside


def test_a_box_along_the_grid_holds_the_centres_inside_it():
    corners = np.array(list(np.ndindex(2, 2, 2)))
    quads = np.array([[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]])
    faces = np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])
    inside = voxels_inside(Mesh(corners * [2.0, 3.0, 1.0] + 0.5, faces), (5, 6, 4))
    expected = np.zeros((5, 6, 4), dtype=bool)
    expected[1:3, 1:4, 1:2] = True
    assert np.array_equal(inside, expected)


def test_it_is_the_inside_of_the_superquadric():
    for kind in ("ellipsoid", "toroid"):
        shape = made(kind).transformed(2.0, np.array([14.0, 17.0, 15.0]))
        points = np.stack(np.meshgrid(*map(np.arange, (30, 28, 32)), indexing="ij"), axis=-1).reshape(-1, 3)
        value = shape.implicit(points)
        mesh = shape.mesh(48)
        for faces in (mesh.faces, mesh.faces[:, ::-1]):
            inside = voxels_inside(Mesh(mesh.vertices, faces), (30, 28, 32)).reshape(-1)
            clear = np.abs(value - 1) > 0.02  # the chords of the mesh
            assert np.array_equal(inside[clear], value[clear] < 1)
            assert inside.sum() > 500


def test_what_lies_beyond_the_grid_is_cut_off():
    mesh = Superquadric(semi_axes=(50, 50, 50)).mesh(16)
    assert voxels_inside(mesh, (4, 5, 6)).all()
    assert not voxels_inside(Mesh(mesh.vertices + 100.0, mesh.faces), (4, 5, 6)).any()


def test_centres_on_a_face_count_on_the_lower_side_of_each_axis():
    """So that of two bodies that touch each centre on their common face belongs to one of them."""
    expected = np.zeros((5, 5, 5), dtype=bool)
    expected[:3, :3, :3] = True
    np.testing.assert_array_equal(voxels_inside(box_mesh((3.0, 3.0, 3.0)), expected.shape), expected)


@pytest.mark.parametrize("axis", [0, 1])
def test_triangles_that_are_seen_edge_on_enclose_nothing(axis):
    """Also where they lie in the line of a column of voxels."""
    box, upright = box_mesh((6.0, 6.0, 6.0)), np.zeros((3, 3))
    upright[:, axis], upright[:, 1 - axis], upright[:, 2] = 2 + OFF_GRID[axis], [1, 5, 9], [0, 3, 1]
    both = Mesh(np.concatenate([box.vertices, upright]), np.concatenate([box.faces, [[8, 9, 10]]]))
    np.testing.assert_array_equal(voxels_inside(both, (7, 7, 7)), voxels_inside(box, (7, 7, 7)))
