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
