"""Bending energy in closed form: Gauss quadrature, what costs nothing, what changes nothing; springs beside it."""

import numpy as np
import pytest

from quadriform.fitting.least_squares.regularisers import Bending, Springs, regulariser_matrix
from quadriform.shapes import bernstein

SHAPES = [(2, 2, 2), (3, 3, 3), (5, 5, 5), (3, 5, 4), (2, 4, 7)]
SECOND = [(2, 0, 0), (0, 2, 0), (0, 0, 2), (1, 1, 0), (1, 0, 1), (0, 1, 1)]


def derivative(s, degree, order):
    """Basis derivatives of an order at points s, by the recursion for single values, (n, degree + 1)."""
    if order == 0:
        return bernstein.basis(s, degree)
    if degree == 0:
        return np.zeros((len(s), 1))
    lower = np.pad(derivative(s, degree - 1, order - 1), ((0, 0), (1, 1)))
    return degree * (lower[:, :-1] - lower[:, 1:])


def integrated(control):
    """Sum over all nine second derivatives of their integrated squares, by Gauss points."""
    nodes, weights = np.polynomial.legendre.leggauss(12)
    nodes, weights = (nodes + 1) / 2, weights / 2
    total = 0.0
    for orders in SECOND:
        factors = [derivative(nodes, count - 1, order) for count, order in zip(control.shape, orders)]
        values = np.einsum("ai,bj,ck,ijkd->abcd", *factors, control, optimize=True)
        times = 1 if max(orders) == 2 else 2
        total += times * np.einsum("a,b,c,abcd->", weights, weights, weights, values**2)
    return total


def energy(matrix, control):
    flat = control.reshape(len(matrix), -1)
    return np.einsum("kd,kl,ld->", flat, matrix, flat)


@pytest.mark.parametrize("shape", SHAPES)
def test_bending_is_the_integral_of_squared_second_derivatives(shape, rng):
    control = rng.normal(size=(*shape, 3))
    assert energy(Bending().matrix(shape), control) == pytest.approx(integrated(control), rel=1e-11)


@pytest.mark.parametrize("shape", SHAPES)
def test_affine_displacements_cost_nothing(shape, rng):
    steps = np.stack(np.meshgrid(*(np.linspace(0, 1, n) for n in shape), indexing="ij"), axis=-1)
    affine = steps @ rng.normal(size=(3, 3)) + rng.normal(size=3)
    matrix = Bending().matrix(shape)
    assert abs(energy(matrix, affine)) < 1e-12 * np.abs(matrix).max() * (affine**2).sum()


@pytest.mark.parametrize(("low", "high"), [((3, 3, 3), (5, 5, 5)), ((2, 3, 4), (3, 3, 7)), ((5, 5, 5), (7, 7, 7))])
def test_raising_the_degree_changes_nothing(low, high, rng):
    control = rng.normal(size=(*low, 3))
    raised = control
    for axis in range(3):
        raised = bernstein.along(axis, bernstein.elevation(low[axis] - 1, high[axis] - 1), raised)
    found = energy(Bending().matrix(high), raised)
    assert found == pytest.approx(energy(Bending().matrix(low), control), rel=1e-10)


@pytest.mark.parametrize("shape", [shape for shape in SHAPES if min(shape) > 2])
def test_bending_is_symmetric_and_free_for_four_displacements_a_coordinate(shape):
    matrix = Bending().matrix(shape)
    np.testing.assert_allclose(matrix, matrix.T, rtol=1e-13, atol=1e-13 * np.abs(matrix).max())
    values = np.linalg.eigvalsh(matrix)
    assert np.abs(values[:4]).max() < 1e-12 * values[-1] < 1e-10 * values[-1] < values[4]


def test_one_direction_of_degree_one_still_bends_in_the_mixed_ways():
    """Over (2, 2, 2) only s t, s u, t u and s t u bend: the same four are free."""
    values = np.linalg.eigvalsh(Bending().matrix((2, 2, 2)))
    assert np.abs(values[:4]).max() < 1e-12 < 1e-3 < values[4]


@pytest.mark.parametrize("shape", SHAPES)
def test_springs_are_free_for_one_displacement_a_coordinate(shape):
    values = np.linalg.eigvalsh(Springs().matrix(shape))
    assert abs(values[0]) < 1e-12 * values[-1] < 1e-3 * values[-1] < values[1]


def test_the_names_mean_these(rng):
    np.testing.assert_array_equal(regulariser_matrix("bending", (3, 4, 3)), Bending().matrix((3, 4, 3)))
    np.testing.assert_array_equal(regulariser_matrix("springs", (3, 4, 3)), Springs().matrix((3, 4, 3)))
