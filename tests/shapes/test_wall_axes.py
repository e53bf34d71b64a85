"""Rays, cells and axes of a wall against plain computations, cell by cell."""

from itertools import product

import numpy as np
import pytest
from shapes_made import SKEW, made, turned

from quadriform.errors import OptionError
from quadriform.shapes import wall
from quadriform.shapes.control_box import ControlBox
from quadriform.shapes.model import DeformableModel
from quadriform.shapes.superquadric import Superquadric

INNER = Superquadric(semi_axes=(2.0, 1.8, 4.0), exponents=(0.8, 1.1), rotation=SKEW, translation=(1.2, -1.8, 0.4))
OUTER = made(semi_axes=(3.5, 3.2, 6.0), exponents=(1.0, 0.9))


def model(noise=0.1, inner=INNER):
    box = ControlBox.around(OUTER)
    moves = np.random.default_rng(0).normal(0, noise, box.control_points.shape)
    return DeformableModel({"epi": OUTER, "endo": inner}, box.with_control_points(box.control_points + moves))


def test_rays_leave_a_body_where_the_implicit_function_is_one(rng):
    centre, rays = (
        OUTER.translation + np.array([0.5, -0.3, 1.0]),
        rng.normal(size=(30, 3)) * rng.uniform(0.01, 50, (30, 1)),
    )
    found = wall.exits(OUTER, centre, rays)
    np.testing.assert_allclose(OUTER.implicit(centre + found[:, None] * rays), 1, rtol=1e-12)
    assert (found > 0).all()
    long = Superquadric(semi_axes=(1.0, 1.0, 50.0), translation=(0, 0, 45.0))
    np.testing.assert_allclose(wall.exits(long, np.zeros(3), np.array([[0, 0, 1.0], [0, 0, -2.0]])), [95, 2.5])


def test_vertices_divide_the_rays_before_deformation():
    of = model()
    mesh = wall.wall_mesh(of, layers=3, resolution=2)
    start, quads = INNER.grid(2)
    stop = INNER.translation + wall.exits(OUTER, INNER.translation, start - INNER.translation)[:, None] * (
        start - INNER.translation
    )
    expected = [of.deform(start + k / 3 * (stop - start)) for k in range(4)]
    np.testing.assert_allclose(mesh.vertices, np.concatenate(expected), rtol=1e-9)
    n, cells = len(start), []
    for layer in range(3):
        cells += [[*(quad + layer * n), *(quad + (layer + 1) * n)] for quad in quads]
    np.testing.assert_array_equal(mesh.cells, cells)
    np.testing.assert_allclose(mesh.depth, np.repeat([1 / 6, 3 / 6, 5 / 6], len(quads)))


def trilinear(corners, at):
    """The point of a cell at (i, j, k) of the unit cube."""
    order = [(i, j, k) for k in (0, 1) for i, j in ((0, 0), (1, 0), (1, 1), (0, 1))]
    return sum(
        np.prod([a if c else 1 - a for a, c in zip(at, corner)]) * point for corner, point in zip(order, corners)
    )


def test_jacobians_and_volumes_of_cells_are_those_of_the_trilinear_map():
    mesh = wall.wall_mesh(model(), layers=1, resolution=2)
    found, volumes, h = mesh.jacobians(), mesh.volumes(), 1e-6
    order = [(i, j, k) for k in (0, 1) for i, j in ((0, 0), (1, 0), (1, 1), (0, 1))]
    nodes, weights = np.polynomial.legendre.leggauss(3)
    for cell in range(0, len(mesh.cells), 5):
        corners = mesh.vertices[mesh.cells[cell]]

        def determinant(at, corners=corners):
            steps = h * np.eye(3)
            return np.linalg.det([(trilinear(corners, at + s) - trilinear(corners, at - s)) / (2 * h) for s in steps])

        np.testing.assert_allclose(found[cell], [determinant(np.array(at, dtype=float)) for at in order], rtol=1e-6)
        integral = sum(
            np.prod(weights[list(at)]) / 8 * determinant((nodes[list(at)] + 1) / 2)
            for at in product(range(3), repeat=3)
        )
        assert volumes[cell] == pytest.approx(integral, rel=1e-6)


def test_axes_of_a_cell_are_the_normal_of_its_layer_and_directions_around_the_long_axis():
    axis = np.array([0.2, -0.3, 1.0])
    mesh = wall.wall_mesh(model(), layers=2, resolution=2, long_axis=axis)
    for cell, axes in zip(mesh.cells, mesh.axes):
        corners = mesh.vertices[cell]
        u = corners[[1, 2, 5, 6]].mean(axis=0) - corners[[0, 3, 4, 7]].mean(axis=0)
        v = corners[[2, 3, 6, 7]].mean(axis=0) - corners[[0, 1, 4, 5]].mean(axis=0)
        radial = np.cross(u, v)
        around = np.cross(axis, radial)
        for found, expected in zip(axes, (radial, around, np.cross(radial, around))):
            np.testing.assert_allclose(found, expected / np.linalg.norm(expected), atol=1e-9)


@pytest.mark.parametrize("k", range(3))
def test_on_the_axis_any_direction_across_is_circumferential(k):
    cube = np.array([[i, j, z] for z in (0, 1) for i, j in ((0, 0), (1, 0), (1, 1), (0, 1))], dtype=float)
    turn = np.roll(np.eye(3), k, axis=0)
    (axes,) = wall._axes((cube @ turn.T)[None], turn[:, 2])
    np.testing.assert_allclose(axes[0], turn[:, 2], atol=1e-12)
    np.testing.assert_allclose(axes @ axes.T, np.eye(3), atol=1e-12)
    np.testing.assert_allclose(np.linalg.det(axes), 1)


@pytest.mark.parametrize("sign", [1, -1])
def test_the_long_axis_leads_from_the_far_end_of_the_longest_semi_axis(sign):
    """One end is drawn out: it is the apex."""
    rotation = turned(2) * [1, 1, 1]
    inner = Superquadric(semi_axes=(1.0, 3.0, 1.5), rotation=rotation, translation=(10.0, -5.0, 3.0))
    box = ControlBox.around(inner, (3, 3, 3))
    points = box.control_points.copy()
    points[:, 2 if sign > 0 else 0] += sign * 4 * rotation[:, 1]
    found = wall._long_axis(DeformableModel({"endo": inner}, box.with_control_points(points)), "endo")
    np.testing.assert_allclose(found, -sign * rotation[:, 1], atol=1e-9)


def test_an_inner_surface_that_touches_the_outer_one_is_refused():
    """At both tips."""
    outer, inner = Superquadric(semi_axes=(2.0, 2.0, 2.0)), Superquadric(semi_axes=(1.0, 1.0, 2.0))
    of = DeformableModel({"epi": outer, "endo": inner}, ControlBox.around(outer))
    with pytest.raises(OptionError, match="'endo' lies outside 'epi' at 2 of 26 points"):
        wall.wall_mesh(of, resolution=2)
