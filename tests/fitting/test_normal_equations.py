"""Normal equations from moments are those of the dense matrix; the tables of Bernstein products are integrals."""

import numpy as np
import pytest

from quadriform.fitting.least_squares.normal_equations import normal_equations
from quadriform.shapes import bernstein

DEGREES = [(1, 1, 1), (2, 3, 1), (4, 4, 4), (6, 2, 5)]


def problem(n=700, seed=2):
    """Local coordinates, some just outside the box, symmetric metrics without any sign, and residuals."""
    rng = np.random.default_rng(seed)
    half = rng.normal(size=(n, 3, 3))
    return rng.uniform(-0.05, 1.05, (n, 3)), half + half.transpose(0, 2, 1), rng.normal(size=(n, 3))


def rows(local, degrees):
    """The dense matrix B, as often as there are coordinates: (n, 3, 3 k)."""
    b = bernstein.products([bernstein.basis(local[:, a], d) for a, d in enumerate(degrees)])
    return np.einsum("nk,ij->nikj", b, np.eye(3)).reshape(len(local), 3, -1)


def assert_close(found, expected, relative=1e-12):
    assert np.abs(found - expected).max() <= relative * np.abs(expected).max()


@pytest.mark.parametrize("degrees", DEGREES)
def test_sums_are_those_of_the_dense_matrix(degrees):
    local, metric, residual = problem()
    dense = rows(local, degrees)
    found = normal_equations(local, metric, residual, degrees)
    assert_close(found.matrix, np.einsum("nip,nij,njq->pq", dense, metric, dense, optimize=True))
    assert_close(found.right, np.einsum("nip,nij,nj->p", dense, metric, residual, optimize=True))
    assert found.constant == pytest.approx(np.einsum("ni,nij,nj->", residual, metric, residual), rel=1e-12)


def test_the_three_sums_are_one_quadratic_form(rng):
    """p' A p - 2 b' p + c is the weighted square of what p leaves, whatever p is."""
    degrees = (4, 3, 2)
    local, metric, residual = problem(300)
    found = normal_equations(local, metric, residual, degrees)
    for _ in range(3):
        p = rng.normal(size=len(found.right))
        left = residual - rows(local, degrees) @ p
        direct = np.einsum("ni,nij,nj->", left, metric, left)
        form = p @ found.matrix @ p - 2 * found.right @ p + found.constant
        assert form == pytest.approx(direct, rel=1e-11)


@pytest.mark.parametrize("chunk", [1, 64, 699, 700, 701])
def test_chunks_change_nothing(chunk, monkeypatch):
    local, metric, residual = problem()
    whole = normal_equations(local, metric, residual, (4, 4, 4))
    monkeypatch.setattr(bernstein, "CHUNK", chunk)
    parts = normal_equations(local, metric, residual, (4, 4, 4))
    assert_close(parts.matrix, whole.matrix)
    assert_close(parts.right, whole.right)
    assert parts.constant == pytest.approx(whole.constant, rel=1e-12)


def test_memory_does_not_grow_with_the_points():
    """200,000 points: the dense matrix alone would be 200 MB; the weights and residuals themselves are 30."""
    import tracemalloc

    local, metric, residual = problem(200_000)
    tracemalloc.start()
    try:
        normal_equations(local, metric, residual, (4, 4, 4))
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert peak < 60e6


def quadrature(count=20):
    """Nodes and weights on [0, 1], exact for polynomials up to degree 39."""
    nodes, weights = np.polynomial.legendre.leggauss(count)
    return (nodes + 1) / 2, weights / 2


@pytest.mark.parametrize("degree", [0, 1, 2, 4, 6, 12])
def test_gram_holds_the_inner_products(degree):
    s, w = quadrature()
    b = bernstein.basis(s, degree)
    np.testing.assert_allclose(bernstein.gram(degree), (w[:, None] * b).T @ b, rtol=1e-12)


@pytest.mark.parametrize("degree", [0, 1, 2, 4, 6, 12])
def test_product_factor_writes_products_in_the_doubled_degree(degree, rng):
    s = rng.uniform(-0.2, 1.2, 30)
    b, double = bernstein.basis(s, degree), bernstein.basis(s, 2 * degree)
    factor = bernstein.product_factor(degree)
    for i in range(degree + 1):
        for j in range(degree + 1):
            np.testing.assert_allclose(factor[i, j] * double[:, i + j], b[:, i] * b[:, j], rtol=1e-10)


@pytest.mark.parametrize("degree", [1, 2, 4, 6])
def test_derivative_matrix_takes_coefficients_to_those_of_the_derivative(degree, rng):
    """Against the integral: what the derivative adds up to from 0 to s is what the polynomial has gained."""
    coefficients = rng.normal(size=degree + 1)
    slope = bernstein.derivative_matrix(degree) @ coefficients
    t, w = quadrature()
    for s in (0.2, 0.7, 1.0):
        gained = s * (w @ (bernstein.basis(s * t, degree - 1) @ slope))
        ends = bernstein.basis(np.array([s, 0.0]), degree) @ coefficients
        assert gained == pytest.approx(ends[0] - ends[1], abs=1e-12)
