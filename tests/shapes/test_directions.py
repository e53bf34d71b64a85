"""Grids on the sphere, the torus, tubes and the disc: their points by formulas, their quads by edges and winding."""

from collections import Counter

import numpy as np
import pytest

from quadriform.shapes import kinds
from quadriform.shapes.directions import disc_grid, sphere_grid, torus_grid, tube_grid
from quadriform.shapes.kinds import KINDS
from quadriform.shapes.superellipse import norm


def edges(quads):
    """Directed edges and how often each occurs."""
    return Counter((int(quad[k]), int(quad[(k + 1) % 4])) for quad in quads for k in range(4))


@pytest.mark.parametrize("resolution", [1, 2, 3, 4, 5])
def test_the_sphere_has_a_cubes_grid_at_equal_angles(resolution):
    n = {1: 2, 2: 2, 3: 4, 4: 4, 5: 6}[resolution]
    directions, quads = sphere_grid(resolution)
    assert directions.shape == (6 * n**2 + 2, 3) and quads.shape == (6 * n**2, 4)
    np.testing.assert_allclose(np.linalg.norm(directions, axis=1), 1, rtol=1e-12)
    on_cube = directions / np.abs(directions).max(axis=1, keepdims=True)
    steps = np.arctan(on_cube) / (np.pi / 4) * n / 2
    np.testing.assert_allclose(steps, np.round(steps), atol=1e-9)
    assert set(edges(quads).values()) == {1}
    assert all((b, a) in edges(quads) for a, b in edges(quads))
    a, b, c, d = (directions[quads[:, k]] for k in range(4))
    assert (np.einsum("ij,ij->i", np.cross(c - a, d - b), a + b + c + d) > 0).all()


@pytest.mark.parametrize(("resolution", "rows"), [(1, 4), (2, 4), (3, 6)])
def test_the_torus_closes_both_ways(resolution, rows):
    angles, quads = torus_grid(resolution)
    columns = 4 * resolution
    expected = [(2 * np.pi * i / rows, 2 * np.pi * j / columns) for i in range(rows) for j in range(columns)]
    np.testing.assert_allclose(angles, expected, atol=1e-12)
    corners = []
    for i in range(rows):
        for j in range(columns):
            up, right = (i + 1) % rows, (j + 1) % columns
            corners.append((i * columns + j, i * columns + right, up * columns + right, up * columns + j))
    assert sorted(map(tuple, quads.tolist())) == sorted(corners)


def test_a_tube_is_open_at_its_ends():
    angles, quads = tube_grid(np.array([-1.0, 0.5, 2.0]), 5)
    np.testing.assert_allclose(angles, [(z, 2 * np.pi * j / 5) for z in (-1.0, 0.5, 2.0) for j in range(5)])
    expected = [
        (i * 5 + j, i * 5 + (j + 1) % 5, i * 5 + 5 + (j + 1) % 5, i * 5 + 5 + j) for i in range(2) for j in range(5)
    ]
    assert sorted(map(tuple, quads.tolist())) == sorted(expected)


@pytest.mark.parametrize("resolution", [2, 4])
def test_the_disc_keeps_rays_and_distances_along_them(resolution):
    """Of the half of the sphere's grid around x, by the angle from x as a share of a right angle."""
    points, quads = disc_grid(resolution)
    directions, whole = sphere_grid(resolution)
    upper = directions[directions[:, 0] > -1e-9]
    angle = np.arccos(np.clip(upper[:, 0], -1, 1)) / (np.pi / 2)
    around = np.arctan2(upper[:, 2], upper[:, 1])
    expected = np.stack([angle * np.cos(around), angle * np.sin(around)], axis=1)
    np.testing.assert_allclose(points, expected, atol=1e-9)
    assert len(quads) == len(whole) // 2
    count = edges(quads)
    rim = {a for a, b in count if (b, a) not in count}
    np.testing.assert_allclose(np.linalg.norm(points[sorted(rim)], axis=1), 1, rtol=1e-12)
    a, b, c, d = (points[quads[:, k]] for k in range(4))
    u, v = c - a, d - b
    assert len(set(np.sign(u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0]))) == 1


@pytest.mark.parametrize("e", [(0.6, 1.4), (1.3, 0.8)])
def test_two_sheets_reach_to_the_cut_on_every_ray(e):
    """x^2 is the outer norm of (1 and z, y) there; a mesh ends exactly at the cut on both sides."""
    kind, exponents = KINDS["hyperboloid2"], np.array(e)
    disc = disc_grid(4)[0]
    reach = kinds._reach(kind, disc, exponents, 2.5)
    unit = disc / np.maximum(np.linalg.norm(disc, axis=1, keepdims=True), 1e-300)
    y, z = (unit * reach[:, None]).T
    on_ray = np.linalg.norm(disc, axis=1) > 0
    height = norm(norm(np.ones(len(z)), z, exponents[0]), y, exponents[1])
    np.testing.assert_allclose(height[on_ray], 2.5, rtol=1e-9)
    points, quads = kind.grid(4, exponents, 0.0, 2.5)
    np.testing.assert_allclose(kind.implicit(points, exponents, 0.0), 1, rtol=1e-9)
    half = len(points) // 2
    np.testing.assert_array_equal(points[half:], points[:half] * [-1, 1, 1])
    assert (points[:half, 0] > 0).all() and points[:half, 0].max() == pytest.approx(2.5)
    assert len(quads) == 6 * 4**2
    a, b, c, d = (points[quads[:, k]] for k in range(4))
    inward = np.cross(c - a, d - b)[:, 0] * points[quads[:, 0], 0]
    assert (inward < 0).all()  # outside of the body is between the sheets, or F > 1 beyond them: one winding
    share = disc * reach[:, None]
    np.testing.assert_allclose(points[:half, 1:], share, atol=1e-9)


def test_a_tube_has_even_heights_between_the_cuts():
    kind, exponents = KINDS["hyperboloid1"], np.array([0.6, 1.4])
    points, _ = kind.grid(3, exponents, 0.0, 1.5)
    np.testing.assert_allclose(np.unique(points[:, 2].round(9)), np.linspace(-1.5, 1.5, 7))
    np.testing.assert_allclose(kind.implicit(points, exponents, 0.0), 1, rtol=1e-12)
    angles = np.arctan2(points[:, 1], points[:, 0]) % (2 * np.pi)
    np.testing.assert_allclose(np.unique(angles.round(9)), 2 * np.pi * np.arange(12) / 12, atol=1e-9)


def test_a_torus_has_even_rays_of_both_superellipses():
    kind, exponents, hole = KINDS["toroid"], np.array([0.6, 1.4]), 2.5
    points, _ = kind.grid(3, exponents, hole, 0.0)
    np.testing.assert_allclose(kind.implicit(points, exponents, hole), 1, rtol=1e-12)
    around = np.arctan2(points[:, 1], points[:, 0]) % (2 * np.pi)
    np.testing.assert_allclose(np.unique(around.round(9)), 2 * np.pi * np.arange(12) / 12, atol=1e-9)
    ring = norm(points[:, 0], points[:, 1], exponents[1]) - hole
    tube = np.arctan2(points[:, 2], ring) % (2 * np.pi)
    np.testing.assert_allclose(np.unique(tube.round(9)), 2 * np.pi * np.arange(6) / 6, atol=1e-9)


@pytest.mark.parametrize("exponents", [(1.0, 1.0), (0.5, 1.5), (2.0, 2.0)])
def test_volumes_are_those_of_sampled_bodies(exponents):
    """By slices across z: the area of a superellipse of each height, with Gauss' rule."""
    e1, e2 = exponents
    nodes, weights = np.polynomial.legendre.leggauss(200)
    turn = np.linspace(0, 2 * np.pi, 4001)
    radius = 1 / norm(np.cos(turn), np.sin(turn), e2)
    area = np.trapezoid(radius**2 / 2, turn)
    ring = (1 - np.abs(nodes) ** (2 / e1)) ** (e1 / 2)
    ellipsoid = KINDS["ellipsoid"].volume(6.0, e1, e2, 0.0)
    assert ellipsoid == pytest.approx(6 * area * weights @ ring**2, rel=1e-3)
    hole = 3.0
    torus = KINDS["toroid"].volume(6.0, e1, e2, hole)
    assert torus == pytest.approx(6 * area * weights @ ((hole + ring) ** 2 - (hole - ring) ** 2), rel=1e-3)
