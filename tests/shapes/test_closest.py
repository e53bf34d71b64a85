"""Closest points: against closed forms, against brute force, and the side they lie on."""

from itertools import product

import numpy as np
import pytest
from scipy.optimize import nnls
from scipy.spatial import cKDTree
from shapes_made import SKEW, made, turned

from quadriform.shapes.closest import (
    RESOLUTION,
    SAFETY,
    CandidateIndex,
    _neighbours,
    closest_on,
    surface_points,
    update_foot_points,
)
from quadriform.shapes.control_box import ControlBox
from quadriform.shapes.superquadric import Superquadric

SIZE = np.linalg.norm([6.0, 4.0, 8.0])


def undeformed(**numbers):
    surface = Superquadric(semi_axes=(3.0, 2.0, 4.0), **numbers)
    return surface, ControlBox.around(surface)


def deformed(exponents, size=0.3, seed=1):
    surface, box = undeformed(exponents=exponents)
    moves = np.random.default_rng(seed).normal(0, size, box.control_points.shape)
    return surface, box.with_control_points(box.control_points + moves)


def around(rng, n=600):
    """Targets inside, near and far."""
    return np.concatenate([rng.uniform(-5, 5, (n, 3)), rng.normal(size=(n // 2, 3)) * 40])


def to_ellipsoid(targets, axes):
    """Distance by the root of the Lagrange equation, sum (a x / (a^2 + t))^2 = 1 with t > -min a^2."""
    low = np.full(len(targets), -(axes.min() ** 2))
    high = np.linalg.norm(targets, axis=1) * axes.max() + 1
    for _ in range(200):
        t = (low + high) / 2
        outside = ((axes * targets / (axes**2 + t[:, None])) ** 2).sum(axis=1) > 1
        low, high = np.where(outside, t, low), np.where(outside, high, t)
    feet = axes**2 * targets / (axes**2 + high[:, None])
    return feet, np.linalg.norm(targets - feet, axis=1) * np.sign(high)


def brute(surface, box, targets):
    """Distance to the nearest of 86,000 vertices, polished from the four nearest."""
    vertices = surface.grid(120)[0]
    nearest = cKDTree(box.deform(vertices)).query(targets, k=4)[1]
    polished = [box.deform(update_foot_points(surface, box, targets, vertices[column], 60)) for column in nearest.T]
    return np.linalg.norm(targets - polished, axis=2).min(axis=0)


def graded(surface, n=14):
    """Undeformed surface points that crowd towards the planes of symmetry and the axes, (m, 3)."""
    small = np.concatenate([[0], np.logspace(-8, 0, n)])
    u, v = (grid.ravel() for grid in np.meshgrid(small, small, indexing="ij"))
    octant = np.concatenate([np.roll(np.column_stack([np.ones_like(u), u, v]), axis, axis=1) for axis in range(3)])
    signs = np.array(np.meshgrid(*[(-1, 1)] * 3)).reshape(3, -1).T
    directions = np.unique((octant[:, None] * signs).reshape(-1, 3), axis=0)
    return surface.project(directions * surface.semi_axes @ surface.rotation.T + surface.translation)


def brute_beside_planes(surface, box, targets):
    """Distance to the nearest of many vertices, most of them beside planes of symmetry, from the six nearest."""
    vertices = np.concatenate([surface.grid(60)[0], graded(surface, 40)])
    nearest = cKDTree(box.deform(vertices)).query(targets, k=6)[1]
    polished = [box.deform(update_foot_points(surface, box, targets, vertices[column], 120)) for column in nearest.T]
    return np.linalg.norm(targets - polished, axis=2).min(axis=0)


RIDGES = [(2.0, 0.4), (2.0, 2.0), (1.0, 2.0), (1.5, 1.5), (0.3, 1.9), (1.9, 1.2), (4.0, 1.0), (1.0, 3.0)]


@pytest.mark.parametrize(("exponents", "size"), [*product(RIDGES, (0.0, 0.15)), ((3.0, 2.5), 0.0)])
def test_beside_edges_and_cusps_nothing_is_nearer(exponents, size, rng):
    """Exponents above 1, where the curvature is infinite along the planes of symmetry; inside, outside, at tips."""
    surface, box = deformed(exponents, size, seed=3)
    near = box.deform(graded(surface, 3))
    spread = box.deform(surface.project(rng.normal(size=(60, 3))))
    targets = np.concatenate([near, near + rng.normal(0, 0.2, near.shape), spread + rng.normal(0, 0.3, spread.shape)])
    targets = np.concatenate([targets, rng.uniform(-5, 5, (60, 3))])
    found = closest_on(surface, box, targets)
    close = 1e-9 if max(exponents) <= 2 else 5e-9  # at the tip of a thin arm
    assert (np.abs(found.signed) - brute_beside_planes(surface, box, targets)).max() < close * SIZE
    np.testing.assert_allclose(surface.implicit(found.origins), 1, rtol=1e-9)
    np.testing.assert_allclose(np.linalg.norm(targets - found.points, axis=1), np.abs(found.signed), atol=1e-12)


@pytest.mark.parametrize("semi_axes", [(1.0, 1.0, 1.0), (3.0, 2.0, 4.0)])
def test_an_octahedron_by_its_faces_edges_and_corners(semi_axes, rng):
    """Exponents of 2: eight triangles, the nearest point of each by SciPy's least squares over its corners."""
    surface = Superquadric(semi_axes=semi_axes, exponents=(2, 2))
    corners = np.diag(semi_axes)
    targets = rng.normal(size=(60, 3)) * 1.5 * np.array(semi_axes)
    outside = surface.implicit(targets) > 1
    exact = []
    for target in targets[outside]:
        triangle = corners * np.where(target < 0, -1, 1)
        rows = np.vstack([triangle.T, np.full(3, 1e6)])  # weights of the corners, >= 0, whose sum is one
        weights = nnls(rows, np.append(target, 1e6))[0]
        exact.append(np.linalg.norm(target - weights / weights.sum() @ triangle))
    found = closest_on(surface, ControlBox.around(surface), targets).signed
    np.testing.assert_allclose(found[outside], exact, atol=1e-7)
    plane = (1 - surface.implicit(targets[~outside])) / np.linalg.norm(1 / np.array(semi_axes))
    np.testing.assert_allclose(-found[~outside], plane, atol=1e-9)


def test_sphere(rng):
    surface = Superquadric(semi_axes=(2.0, 2.0, 2.0), translation=(1, 2, 3), rotation=SKEW)
    targets = around(rng)
    offset = targets - [1, 2, 3]
    radius = np.linalg.norm(offset, axis=1)
    foot = closest_on(surface, ControlBox.around(surface), targets)
    np.testing.assert_allclose(foot.signed, radius - 2, atol=1e-12)
    np.testing.assert_allclose(foot.points, [1, 2, 3] + 2 * offset / radius[:, None], atol=1e-9)
    np.testing.assert_allclose(foot.normals, offset / radius[:, None], atol=1e-9)


def test_ellipsoid_by_its_lagrange_equation(rng):
    surface, box = undeformed()
    targets = around(rng, 3000)
    feet, signed = to_ellipsoid(targets, surface.semi_axes)
    found = closest_on(surface, box, targets)
    np.testing.assert_allclose(found.signed, signed, atol=1e-9 * SIZE)
    well = np.abs(targets).min(axis=1) > 0.1  # on the planes of symmetry two feet are as near
    np.testing.assert_allclose(found.points[well], feet[well], atol=1e-6)


def test_medial_axis_of_an_ellipsoid():
    surface, box = undeformed()
    x = np.linspace(-1.5, 1.5, 31)
    targets = np.column_stack([x, np.zeros(31), 0.3 * x])  # on the medial axis: two feet, mirrored in y
    targets = np.concatenate([targets, [[0, 0, 0], [1e-9, -1e-9, 0], [3 - 4 / 3, 0, 0], [0, 0, 3.0]]])
    found = closest_on(surface, box, targets).signed
    best = brute(surface, box, targets)
    np.testing.assert_allclose(-found, best, atol=1e-9)
    assert found[31] == pytest.approx(-2, abs=1e-12)


@pytest.mark.parametrize("exponents", [(1, 1), (0.6, 1.2), (0.3, 0.3), (0.1, 0.1), (0.1, 1.0), (1.4, 0.5)])
@pytest.mark.parametrize("size", [0.0, 0.3])
def test_no_vertex_of_a_dense_mesh_leads_closer(exponents, size, rng):
    surface, box = deformed(exponents, size)
    targets = around(rng)
    found = closest_on(surface, box, targets)
    assert (np.abs(found.signed) - brute(surface, box, targets)).max() < 1e-9 * SIZE
    np.testing.assert_allclose(surface.implicit(found.origins), 1, rtol=1e-9)
    np.testing.assert_allclose(box.deform(found.origins), found.points, atol=1e-12)


@pytest.mark.parametrize("exponents", [(1, 1), (0.6, 1.2), (0.1, 0.1), (0.01, 0.01), (1.9, 1.9)])
def test_sign_is_that_of_the_implicit_function(exponents, rng):
    surface, box = undeformed(exponents=exponents)
    near = surface.project(rng.normal(size=(2000, 3))) * rng.choice([0.97, 0.9999, 1.0001, 1.03], (2000, 1))
    targets = np.concatenate([around(rng), near])
    np.testing.assert_array_equal(closest_on(surface, box, targets).signed < 0, surface.implicit(targets) < 1)


def test_cube_with_sharp_edges_is_a_box_from_far(rng):
    surface, box = undeformed(exponents=(0.01, 0.01))
    targets = rng.normal(size=(2000, 3)) * 30
    targets = targets[np.abs(targets).max(axis=1) > 5]
    exact = np.linalg.norm(np.maximum(np.abs(targets) - [3, 2, 4], 0), axis=1)
    np.testing.assert_allclose(closest_on(surface, box, targets).signed, exact, atol=0.07)
    assert (closest_on(surface, box, targets).signed >= exact - 1e-12).all()


def test_inside_a_sharp_edge_the_nearer_face_is_found(rng):
    surface, box = undeformed(exponents=(0.05, 0.05))
    edge = rng.choice([-1.0, 1.0], (6000, 3)) * [3, 2, 4]
    along = rng.integers(0, 3, 6000)
    depth = rng.uniform(0.02, 0.4, (6000, 3))
    depth[np.arange(6000), along] = rng.uniform(0.5, 2, 6000) * np.take([3, 2, 4], along)
    targets = edge - np.sign(edge) * depth
    targets = targets[surface.implicit(targets) < 0.999]
    faces = ([3, 2, 4] - np.abs(targets)).min(axis=1)
    found = -closest_on(surface, box, targets).signed
    assert (found <= faces + 1e-9).all()  # the surface lies within the box that it touches
    assert (found - brute(surface, box, targets)).max() < 1e-9 * SIZE


@pytest.mark.parametrize("distance", [1e3, 1e6])
def test_very_far_targets_see_the_supporting_point(distance, rng):
    surface, box = deformed((0.6, 1.0))
    directions = rng.normal(size=(50, 3))
    directions /= np.linalg.norm(directions, axis=1)[:, None]
    found = closest_on(surface, box, distance * directions)
    support = (found.points * directions).sum(axis=1)
    best = (box.deform(surface.grid(200)[0]) @ directions.T).max(axis=0)
    assert (support - best).min() > -60 / distance
    assert (found.signed > 0).all()


def test_a_turn_of_everything_turns_the_answer(rng):
    surface, box = deformed((0.5, 0.9))
    targets, turn = around(rng), turned(4)
    other = Superquadric(semi_axes=surface.semi_axes, exponents=surface.exponents, rotation=turn)
    turned_box = ControlBox(turn @ box.origin, box.edges @ turn.T, box.control_points @ turn.T)
    here, there = closest_on(surface, box, targets).signed, closest_on(other, turned_box, targets @ turn.T).signed
    np.testing.assert_allclose(there, here, atol=1e-9)


@pytest.mark.parametrize("kind", ["toroid", "hyperboloid1", "hyperboloid2"])
def test_other_kinds_find_their_own_normal_offsets(kind, rng):
    surface = made(kind, (0.8, 1.0))
    box = ControlBox.around(surface)
    vertices = surface.grid(12)[0]
    inner = vertices[:: 7 if kind == "toroid" else 11]
    normals = surface.gradient(inner)
    normals /= np.linalg.norm(normals, axis=1)[:, None]
    found = closest_on(surface, box, inner + 0.05 * normals)
    np.testing.assert_allclose(found.signed, 0.05, atol=1e-9)
    np.testing.assert_allclose(found.points, inner, atol=1e-7)


@pytest.mark.parametrize("exponents", [(1.3, 1.2), (0.8, 1.5), (3.0, 2.5)])
@pytest.mark.parametrize("kind", ["hyperboloid1", "hyperboloid2"])
def test_ridges_that_run_to_infinity_are_searched_in_any_unit(kind, exponents, rng):
    """Exponents above 1 of unbounded kinds: no overflow, no refusal of coordinates that the caller never gave."""
    surface = made(kind, exponents)
    vertices = surface.grid(40)[0]
    targets = vertices[::29] + 0.2 * rng.normal(size=(len(vertices[::29]), 3))
    found = [
        np.abs(closest_on(each, ControlBox.around(each), unit * targets).signed) / unit
        for unit, each in ((unit, made_in(unit, surface)) for unit in (1e-6, 1.0, 1e6))
    ]
    assert (found[1] <= cKDTree(vertices).query(targets)[0] + 1e-12).all()
    np.testing.assert_allclose(found[0], found[1], atol=1e-9)
    np.testing.assert_allclose(found[2], found[1], atol=1e-9)


def made_in(unit, surface):
    """The same body in another unit of length."""
    return Superquadric(
        surface.kind,
        unit * surface.semi_axes,
        surface.exponents,
        surface.rotation,
        unit * surface.translation,
        height=unit * surface.height,
    )


def test_updates_of_foot_points_never_lead_away_and_few_come_near(rng):
    surface, box = deformed((0.7, 1.1))
    origins = surface.project(rng.normal(size=(2000, 3)))
    targets = box.deform(origins) + rng.normal(0, 0.05, origins.shape)
    before = np.linalg.norm(targets - box.deform(origins), axis=1)
    few, rest = (
        np.linalg.norm(targets - box.deform(update_foot_points(surface, box, targets, origins, slides)), axis=1)
        for slides in (3, 60)
    )
    assert (few <= before + 1e-12).all()
    assert np.quantile(few - rest, 0.99) < 1e-4
    np.testing.assert_array_equal(update_foot_points(surface, box, targets, origins, 0), origins)


@pytest.mark.parametrize("exponents", [(1.9, 1.0), (1.0, 1.9), (1.95, 1.95)])
def test_rounding_chooses_no_side_of_an_edge(exponents, rng):
    """Grid points stand on the edges; their normals halve the angle between both sides, wherever the surface lies."""
    plain = Superquadric(semi_axes=(3.0, 2.0, 4.0), exponents=exponents)
    grid, _ = plain.grid(8)
    _, wanted = surface_points(plain, ControlBox.around(plain), grid)
    assert np.abs(wanted[np.abs(grid) < 1e-12]).max() < 1e-12
    for seed in range(5):
        rotation, translation = turned(seed), rng.normal(size=3)
        placed = Superquadric("ellipsoid", plain.semi_axes, exponents, rotation, translation)
        points = grid @ rotation.T + translation
        _, normals = surface_points(placed, ControlBox.around(placed), points)
        np.testing.assert_allclose(normals, wanted @ rotation.T, atol=1e-9)
        gradient = placed.gradient(points)
        np.testing.assert_allclose(gradient, plain.gradient(grid) @ rotation.T, atol=1e-9)


@pytest.mark.parametrize("exponents", [(0.1, 0.1), (0.01, 1.9996), (2.0, 2.0)])
@pytest.mark.parametrize("seed", range(3))
def test_rounding_does_not_choose_between_faces_that_are_equally_near(exponents, seed):
    """Old bug: of points on a plane of symmetry, such as voxels on edges, each kernel of BLAS led some elsewhere."""
    surface = Superquadric(semi_axes=(1.0, 1.0, 1.0), exponents=exponents, rotation=turned(seed))
    box = ControlBox.around(surface)
    signs = np.array(list(product((-1, 0, 1), repeat=3)))[:, None]
    targets = (signs * np.array([0.5, 0.55])[:, None]).reshape(-1, 3) @ surface.rotation.T
    rounding = 1e-15 * np.random.default_rng(seed).normal(size=targets.shape)
    one, other = closest_on(surface, box, targets), closest_on(surface, box, targets + rounding)
    np.testing.assert_allclose(one.points, other.points, atol=1e-6)


def test_neighbours_of_a_vertex_are_the_vertices_of_its_cells():
    table = _neighbours("ellipsoid")
    quads = Superquadric().grid(RESOLUTION)[1]
    for vertex in range(0, table.shape[1], 97):
        cells = set(quads[(quads == vertex).any(axis=1)].ravel()) - {vertex}
        assert set(table[:, vertex]) - {vertex} == cells
    assert all((row != np.arange(table.shape[1])).any() for row in table)  # none is only padding


def test_targets_with_many_equally_near_vertices_are_compared_with_all():
    """More targets near the centre of a ball than are compared at once; every vertex whose cell may be nearest."""
    surface = Superquadric()
    candidates = CandidateIndex.of(surface, ControlBox.around(surface))
    targets = np.random.default_rng(2).normal(0, 0.02, (700, 3))
    nearest = cKDTree(candidates.points).query(targets)[0]
    codes = np.concatenate(candidates._among_all(np.arange(700), targets, nearest))
    squared = ((targets[:, None] - candidates.points) ** 2).sum(axis=2)
    room = candidates.cell**2 + nearest[:, None] * np.minimum(
        candidates.cell**2 * candidates.curvature, 2 * candidates.cell
    )
    expected = np.flatnonzero(squared - nearest[:, None] ** 2 <= room)
    assert len(np.setxor1d(codes, expected)) <= 1e-4 * len(expected)  # but for ties in the last digit
    assert len(np.unique(codes // len(candidates.points))) == 700


@pytest.mark.parametrize("radius", [0.5, 3.0])
def test_cells_of_a_sphere_have_its_curvature_at_least(radius):
    surface = Superquadric(semi_axes=(radius,) * 3)
    candidates = CandidateIndex.of(surface, ControlBox.around(surface))
    found = candidates.curvature * radius / SAFETY
    assert found.min() > 1 - 1e-9 and np.median(found) < 1.05
