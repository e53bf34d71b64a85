"""Bernstein polynomials: what defines them, and that raising the degree changes nothing."""

from math import comb

import numpy as np
import pytest
from kernel_oracle import combined

from quadriform.shapes import bernstein

DEGREES = [1, 2, 4, 7]


@pytest.mark.parametrize("degree", [0, *DEGREES])
def test_basis_is_bernsteins_and_sums_to_one(degree, rng):
    s = rng.uniform(-0.3, 1.3, 40)  # also where the deformation is extrapolated
    found = bernstein.basis(s, degree)
    wanted = [[comb(degree, i) * (1 - x) ** (degree - i) * x**i for i in range(degree + 1)] for x in s]
    np.testing.assert_allclose(found, wanted, rtol=1e-12, atol=1e-15)
    np.testing.assert_allclose(found.sum(axis=1), 1, rtol=1e-12)
    np.testing.assert_allclose(found @ (np.arange(degree + 1) / max(degree, 1)), s if degree else 0 * s, atol=1e-12)


@pytest.mark.parametrize("degree", DEGREES)
def test_ends_and_range(degree):
    found = bernstein.basis(np.array([0.0, 1.0, 0.3]), degree)
    np.testing.assert_array_equal(found[:2], np.eye(degree + 1)[[0, degree]])
    assert (found >= 0).all()


@pytest.mark.parametrize("degree", [0, *DEGREES])
def test_derivative(degree):
    s, h = np.linspace(-0.1, 1.1, 25), 1e-6
    wanted = (bernstein.basis(s + h, degree) - bernstein.basis(s - h, degree)) / (2 * h)
    np.testing.assert_allclose(bernstein.basis_derivative(s, degree), wanted, atol=1e-8)


@pytest.mark.parametrize(("low", "high"), [(1, 1), (1, 4), (2, 5), (4, 9)])
def test_elevation_is_exact(low, high, rng):
    s = np.linspace(0, 1, 30)
    matrix = bernstein.elevation(low, high)
    np.testing.assert_allclose(bernstein.basis(s, high) @ matrix, bernstein.basis(s, low), atol=1e-14)
    np.testing.assert_allclose(matrix.sum(axis=1), 1, rtol=1e-14)


def test_combine_and_products_are_the_triple_sum(rng):
    factors = [rng.normal(size=(6, k)) for k in (2, 4, 3)]
    coefficients = rng.normal(size=(2, 4, 3, 5))
    wanted = np.einsum("ni,nj,nk,ijkd->nd", *factors, coefficients)
    np.testing.assert_allclose(combined(factors, coefficients), wanted, rtol=1e-12, atol=1e-13)
    np.testing.assert_allclose(bernstein.products(factors) @ coefficients.reshape(-1, 5), wanted, atol=1e-13)


@pytest.mark.parametrize("degree", [1, 2, 5])
def test_products_and_their_integrals(degree):
    """B_i B_j by the basis of twice the degree; integrals by Gauss' rule, which is exact for these polynomials."""
    nodes, weights = np.polynomial.legendre.leggauss(degree + 1)
    s, weights = (nodes + 1) / 2, weights / 2
    values, double = bernstein.basis(s, degree), bernstein.basis(s, 2 * degree)
    factor, gram = bernstein.product_factor(degree), bernstein.gram(degree)
    for i in range(degree + 1):
        for j in range(degree + 1):
            np.testing.assert_allclose(values[:, i] * values[:, j], factor[i, j] * double[:, i + j], rtol=1e-12)
            np.testing.assert_allclose(gram[i, j], (weights * values[:, i] * values[:, j]).sum(), rtol=1e-12)


@pytest.mark.parametrize("degree", [1, 2, 5])
def test_the_derivative_has_degree_one_less(degree, rng):
    coefficients, s = rng.normal(size=degree + 1), rng.uniform(0, 1, 9)
    found = bernstein.basis(s, degree - 1) @ bernstein.derivative_matrix(degree) @ coefficients
    np.testing.assert_allclose(found, bernstein.basis_derivative(s, degree) @ coefficients, rtol=1e-12, atol=1e-12)


def test_halves_are_exact_and_a_matrix_along_an_axis_is_the_sum_over_it(rng):
    np.testing.assert_array_equal(bernstein.restriction(2, 0, 0.5), [[1, 0, 0], [0.5, 0.5, 0], [0.25, 0.5, 0.25]])
    coefficients, matrix = rng.normal(size=(2, 4, 3, 5)), rng.normal(size=(6, 3))
    found = bernstein.along(2, matrix, coefficients)
    np.testing.assert_allclose(found, np.einsum("ai,xyiz->xyaz", matrix, coefficients), rtol=1e-12)
    a, b, c = rng.normal(size=(2, 3)), rng.normal(size=(1, 2)), rng.normal(size=(3, 2))
    expected = np.einsum("ai,bj,ck->abcijk", a, b, c).reshape(6, 12)
    np.testing.assert_allclose(bernstein.kronecker(a, b, c), expected, rtol=1e-12)
