"""Triangles one by one: areas, angles, distances, crossings, samples, and the curve that orders them."""

from itertools import combinations

import numpy as np
import pytest
from shapes_made import SKEW

from quadriform.shapes import comparison, crossings, mesh_points
from quadriform.shapes import mesh as meshes
from quadriform.shapes.mesh import Mesh
from quadriform.shapes.solid import Solid
from quadriform.shapes.superquadric import Superquadric
from quadriform.shapes.voxels import voxel_spacing, voxels_inside

TETRAHEDRON = Mesh(
    np.array([[0.0, 0, 0], [3, 0, 0], [0, 4, 0], [0, 0, 5]]), np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]])
)


def test_a_tetrahedron_has_its_areas_and_volume():
    np.testing.assert_allclose(np.linalg.norm(TETRAHEDRON.area_vectors(), axis=1)[[0, 1, 3]], [6, 7.5, 10])
    np.testing.assert_allclose(TETRAHEDRON.area_vectors().sum(axis=0), 0, atol=1e-12)
    assert TETRAHEDRON.volume() == pytest.approx(10) and TETRAHEDRON.is_closed()
    far = Mesh(TETRAHEDRON.vertices + 1e6, TETRAHEDRON.faces)
    assert far.volume() == pytest.approx(10, rel=1e-8)
    assert not Mesh(TETRAHEDRON.vertices, TETRAHEDRON.faces[[0, 1, 2, 2]]).is_closed()
    assert not Mesh(TETRAHEDRON.vertices, np.vstack([TETRAHEDRON.faces[:3], TETRAHEDRON.faces[3:, ::-1]])).is_closed()


def test_ranks_count_from_zero_for_each_and_an_extrapolation_is_of_order_two():
    assert meshes.ranks(np.array([3, 0, 2, 1])).tolist() == [0, 1, 2, 0, 1, 0]
    assert meshes.richardson(5 + 4.0, 5 + 1.0) == 5
    assert meshes.sorted_unique(np.array([5, 1, 5, 3])).tolist() == [1, 3, 5]


def test_solid_angles_are_shares_of_the_sphere(rng):
    """By counting directions; an octant is an eighth."""
    assert meshes.solid_angles(*np.eye(3)[:, None])[0] == pytest.approx(np.pi / 2)
    assert meshes.solid_angles(*np.eye(3)[[0, 2, 1]][:, None])[0] == pytest.approx(-np.pi / 2)
    a, b, c = rng.normal(size=(3, 1, 3))
    a, b, c = (v / np.linalg.norm(v) for v in (a, b, c))
    directions = rng.normal(size=(200_000, 3))
    inside = np.ones(len(directions), dtype=bool)
    sign = np.sign(np.linalg.det([a[0], b[0], c[0]]))
    for p, q in ((a, b), (b, c), (c, a)):
        inside &= sign * (directions @ np.cross(p, q)[0]) > 0
    assert meshes.solid_angles(a, b, c)[0] == pytest.approx(sign * 4 * np.pi * inside.mean(), rel=0.05)


def plain_distance(point, corners):
    """To the nearest point of a triangle: by its plane where it is above it, else by its edges."""
    a, b, c = corners
    weights, *_ = np.linalg.lstsq(np.column_stack([b - a, c - a]), point - a, rcond=None)
    best = [] if min(*weights, 1 - weights.sum()) < 0 else [np.linalg.norm(point - a - weights @ [b - a, c - a])]
    for p, q in ((a, b), (b, c), (c, a)):
        along = np.clip((point - p) @ (q - p) / max((q - p) @ (q - p), 1e-300), 0, 1)
        best.append(np.linalg.norm(point - p - along * (q - p)))
    return min(best)


def test_distances_to_triangles_are_to_their_planes_edges_or_corners(rng):
    points, corners = rng.normal(size=(200, 3)) * 2, rng.normal(size=(200, 3, 3))
    corners[:5, 2] = corners[:5, 1]  # a needle
    corners[5] = corners[5, 0]  # a point
    expected = [plain_distance(*each) for each in zip(points, corners)]
    np.testing.assert_allclose(comparison._to_triangles(points, corners), expected, rtol=1e-9)


def test_samples_are_at_equal_steps_of_the_area(monkeypatch):
    monkeypatch.setattr(comparison, "SAMPLES", 400)
    found = comparison._sampled(TETRAHEDRON)
    areas = np.linalg.norm(TETRAHEDRON.area_vectors(), axis=1)
    counts = np.bincount(found.triangle[:400], minlength=4)
    assert np.abs(counts - 400 * areas / areas.sum()).max() <= 1
    np.testing.assert_array_equal(found.points[400:404], TETRAHEDRON.vertices)
    np.testing.assert_allclose(found.points[404:], found.corners.mean(axis=1))
    assert found.n_outer == 404 and found.triangle[404:].tolist() == [0, 1, 2, 3]
    for triangle, point in zip(found.triangle, found.points):
        assert plain_distance(point, found.corners[triangle]) < 1e-12
    inner = found.points[:400][found.triangle[:400] == 2]
    assert np.abs(inner.mean(axis=0) - found.corners[2].mean(axis=0)).max() < 0.2


def pierces(a, b, triangle):
    """Where a segment meets a triangle, by the linear system of both; None where it does not."""
    p, q, r = triangle
    matrix = np.column_stack([a - b, q - p, r - p])
    if abs(np.linalg.det(matrix)) < 1e-12:
        return None
    t, u, v = np.linalg.solve(matrix, a - p)
    return a + t * (b - a) if 0 <= t <= 1 and min(u, v, 1 - u - v) >= 0 else None


def test_crossings_are_where_edges_pass_through_triangles_of_no_common_corner(rng):
    vertices = rng.normal(size=(24, 3))
    faces = rng.permutation(24).reshape(8, 3)
    faces = np.concatenate([faces, [[faces[0, 0], faces[1, 1], faces[2, 2]]]])
    expected = []
    for one, other in combinations(range(9), 2):
        if set(faces[one]) & set(faces[other]):
            continue
        for edges_of, through in ((one, other), (other, one)):
            for k in range(3):
                found = pierces(
                    vertices[faces[edges_of, k - 1]], vertices[faces[edges_of, k]], vertices[faces[through]]
                )
                expected += [] if found is None else [found]
    found = crossings.crossings(Mesh(vertices, faces))
    assert len(expected) > 5
    assert {tuple(p) for p in np.round(found, 7)} == {tuple(p) for p in np.round(expected, 7)}


def test_boxes_that_overlap_are_found_by_the_cells_they_share(rng):
    low = rng.uniform(0, 10, (60, 3))
    high = low + rng.uniform(0.1, 3, (60, 3))
    high[0] = low[0] + 9
    expected = {
        (i, j) for i, j in combinations(range(60), 2) if (low[i] <= high[j]).all() and (low[j] <= high[i]).all()
    }
    pairs = crossings._sharing_a_cell(low, high)
    assert (pairs[0] < pairs[1]).all()
    found = {(int(i), int(j)) for i, j in zip(*crossings._overlapping(low, high, *pairs))}
    assert found == expected
    code, owner = np.array([1, 1, 1, 4, 7, 7]), np.array([0, 2, 5, 1, 3, 4])
    assert list(zip(*(each.tolist() for each in crossings._pairs(code, owner)))) == [(0, 2), (0, 5), (2, 5), (3, 4)]


def test_points_found_twice_are_one():
    points = np.array([[1.0, 2, 3], [1 + 1e-11, 2, 3], [1 + 1e-6, 2, 3], [5, 5, 5]])
    assert len(crossings._distinct(points)) == 3
    assert len(crossings._distinct(points[:0])) == 0


def test_only_meshes_that_every_ray_meets_once_are_star_shaped():
    ball = Superquadric().mesh(4)
    twice = Mesh(
        np.concatenate([ball.vertices, 2 * ball.vertices]),
        np.concatenate([ball.faces, ball.faces + len(ball.vertices)]),
    )
    assert crossings._is_star_shaped(ball) and not crossings._is_star_shaped(twice)
    assert not crossings._is_star_shaped(Mesh(ball.vertices, ball.faces[:, ::-1]))
    assert not crossings._is_star_shaped(Mesh(ball.vertices, ball.faces[1:]))


def test_the_curve_takes_the_bits_of_the_coordinates_in_turn(rng):
    points = np.vstack([rng.uniform(0, 1, (20, 3)), [[0, 0, 0], [1, 1, 1]]])
    for point, found in zip(points, mesh_points._curve(points)):
        cells = [min(int(x * 2**21), 2**21 - 1) for x in point]
        bits = "".join(f"{cells[0] >> b & 1}{cells[1] >> b & 1}{cells[2] >> b & 1}" for b in reversed(range(21)))
        assert int(found) == int(bits, 2)


@pytest.mark.parametrize("count", [7, 50])
def test_points_spread_over_triangles_at_equal_steps_of_the_area(count):
    corners = TETRAHEDRON.vertices[TETRAHEDRON.faces] / 5
    areas = np.linalg.norm(TETRAHEDRON.area_vectors(), axis=1)
    triangle, weights = mesh_points._spread(corners, areas, count)
    order = np.argsort(mesh_points._curve(corners.mean(axis=1)), kind="stable")
    total = np.cumsum(areas[order])
    expected = [order[np.flatnonzero(total >= (k + 0.5) / count * total[-1])[0]] for k in range(count)]
    assert triangle.tolist() == expected
    assert (weights >= 0).all() and (weights <= 1).all()
    np.testing.assert_allclose(weights.sum(axis=1), 1)
    root = 1.324717957244746
    for k, row in enumerate(weights, 1):
        a, b = k / root % 1, k / root**2 % 1
        expected = (1 - a, 1 - b) if a + b > 1 else (a, b)
        np.testing.assert_allclose(row[1:], expected, atol=1e-9)


def test_a_mesh_is_sparse_where_a_hundredth_of_its_area_is_in_long_triangles():
    """Longer than a fifth of the root of the area."""
    areas = np.array([0.98, 0.0099, 0.0101])
    for long, sparse in ((1, False), (2, True)):
        corners = np.zeros((3, 3, 3))
        corners[:, 1, 0] = 0.19 * np.sqrt(areas.sum())
        corners[long, 1, 0] = 0.21 * np.sqrt(areas.sum())
        assert mesh_points._sparse(corners, areas) == sparse


def test_voxels_inside_are_those_with_windings_above_them():
    """Of a turned tetrahedron, by the signs of its faces' planes."""
    body = Mesh(TETRAHEDRON.vertices @ SKEW.T * 2 + [6, 6, 5], TETRAHEDRON.faces)
    found = voxels_inside(body, (12, 13, 11))
    expected = np.ones(found.shape, dtype=bool)
    centres = np.moveaxis(np.indices(found.shape), 0, -1)
    for face, area in zip(body.faces, body.area_vectors()):
        expected &= (centres - body.vertices[face[0]]) @ area < 0
    np.testing.assert_array_equal(found, expected)
    np.testing.assert_array_equal(voxels_inside(Mesh(body.vertices, body.faces[:, ::-1]), found.shape), expected)
    assert voxel_spacing(np.vstack([np.eye(3, 4) * 2, [0, 0, 0, 1]])).tolist() == [2, 2, 2]


@pytest.mark.parametrize("is_whole", [True, False])
def test_voxels_around_both_bodies_are_compared(is_whole):
    """Up to one size of the body beyond it; a body that is cut only within its voxels."""
    filled = np.zeros((20, 30, 10), dtype=bool)
    filled[5:9, 10:21, 3:5] = True
    of = Solid(filled, np.eye(4), is_whole)
    vertices = np.array([[2.5, -99, 3.2], [7.0, 99, 3.9]])
    found = [(each.start, each.stop, each.step) for each in of._axes(vertices)]
    y = (-1, 32, 1) if is_whole else (0, 30, 1)
    assert found == [(2, 9, 1), y, (3, 5, 1)]
    inside = of._at([range(4, 7), range(-1, 12, 4), range(3, 12, 2)])
    expected = np.zeros((3, 4, 5), dtype=bool)
    expected[1:, 3, 0] = True
    np.testing.assert_array_equal(inside, expected)
    long = Solid(np.ones((300, 2, 129), dtype=bool), np.eye(4))
    steps = [each.step for each in long._axes(np.array([[0.0, 0, 0], [299, 1, 128]]))]
    assert steps == [299 // 128 + 1, 1, 2]
