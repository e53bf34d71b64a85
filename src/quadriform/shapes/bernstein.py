"""Bernstein polynomials (paper, appendix B) and the tensor product of three of them."""

from functools import lru_cache
from math import comb

import numpy as np

from quadriform.points import Array

CHUNK = 2048
"""Points handled at once: their matrices stay in the cache, and memory does not grow with the cloud."""


def basis(s: Array, degree: int) -> Array:
    """B_i(s) = C(l, i) (1 - s)^(l - i) s^i for i = 0 .. l, (n, l + 1): a factor of P18 and P19."""
    result, complement = np.ones((degree + 1, len(s))), 1 - s
    for k in range(degree):
        # Powers of s upwards and of 1 - s downwards: no power function, no loss near 0 and 1.
        np.multiply(result[k], s, out=result[k + 1])
    result *= _choices(degree)[:, None]
    power = complement.copy()
    for k in range(degree - 1, -1, -1):
        result[k] *= power
        power *= complement
    return result.T  # P18, P19


@lru_cache(maxsize=32)  # asked for in every round of a fit
def _choices(degree: int) -> Array:
    """C(l, i) for i = 0 .. l; not to be written to."""
    result = np.array([comb(degree, i) for i in range(degree + 1)], dtype=np.float64)
    result.setflags(write=False)
    return result


def basis_derivative(s: Array, degree: int) -> Array:
    """d B_i / ds = l (B_{i-1} - B_i) of degree l - 1, shape (n, l + 1)."""
    if degree == 0:
        return np.zeros((len(s), 1))
    lower = np.pad(basis(s, degree - 1), ((0, 0), (1, 1)))
    return degree * (lower[:, :-1] - lower[:, 1:])


def products(factors: list[Array]) -> Array:
    """All products a_i b_j c_k of three factors, (n, (l + 1)(m + 1)(n + 1)), the last index running fastest."""
    along_s, along_t, along_u = factors
    # Two outer products in turn: the first is small.
    pairs = (along_s[:, :, None] * along_t[:, None, :]).reshape(len(along_s), -1)
    return (pairs[:, :, None] * along_u[:, None, :]).reshape(len(along_s), -1)


def kronecker(first: Array, second: Array, third: Array) -> Array:
    """The matrix over all control points that is a product of matrices along the three axes."""
    return np.kron(np.kron(first, second), third)


def elevation(low: int, high: int) -> Array:
    """Matrix (high + 1, low + 1) that writes a polynomial of degree `low` in the basis of degree `high`, exactly."""
    matrix = np.zeros((high + 1, low + 1))
    for j in range(high + 1):
        for i in range(max(0, j - high + low), min(low, j) + 1):
            matrix[j, i] = comb(low, i) * comb(high - low, j - i) / comb(high, j)
    return matrix


def restriction(degree: int, start: float, stop: float) -> Array:
    """Matrix (degree + 1, degree + 1) to the coefficients over [start, stop] instead of [0, 1] (de Casteljau).

    Row i holds the blossom at `degree - i` times start and i times stop; for halves every entry is exact.
    """
    matrix = np.empty((degree + 1, degree + 1))
    for i in range(degree + 1):
        row = np.ones(1)
        for s in [start] * (degree - i) + [stop] * i:
            row = np.convolve(row, [1 - s, s])
        matrix[i] = row
    return matrix


def along(axis: int, matrix: Array, coefficients: Array) -> Array:
    """The coefficients after a matrix is applied along one axis of their array."""
    return np.moveaxis(np.tensordot(matrix, coefficients, (1, axis)), 0, axis)


def product(one: Array, other: Array) -> Array:
    """Coefficients of the product of two trivariate polynomials; the degrees add, nothing is sampled.

    With each coefficient times its binomials the product is a convolution, and laid out in rows of the result's
    length a convolution in three variables is one in a single variable (Kronecker's substitution).
    """
    shape = tuple(a + b - 1 for a, b in zip(one.shape, other.shape))
    flat = np.convolve(_laid_out(one, shape), _laid_out(other, shape))[: shape[0] * shape[1] * shape[2]]
    return flat.reshape(shape) / _binomials(shape)


def _laid_out(coefficients: Array, shape: tuple[int, ...]) -> Array:
    """Coefficients times binomials in one row, as long as an array of `shape` keeps their places."""
    scaled = coefficients * _binomials(coefficients.shape)
    padding = [(0, 0), *((0, full - count) for full, count in zip(shape[1:], scaled.shape[1:]))]
    return np.pad(scaled, padding).ravel()


def _binomials(shape: tuple[int, ...]) -> Array:
    """C(l, i) C(m, j) C(n, k) for an array of that shape."""
    s, t, u = (_choices(count - 1) for count in shape)
    return s[:, None, None] * t[:, None] * u


def product_factor(degree: int) -> Array:
    """B_i B_j is this factor, (l + 1, l + 1), times the basis polynomial i + j of twice the degree."""
    single = np.array([comb(degree, k) for k in range(degree + 1)], dtype=np.float64)
    double = np.array([comb(2 * degree, k) for k in range(2 * degree + 1)], dtype=np.float64)
    i = np.arange(degree + 1)
    return np.outer(single, single) / double[i[:, None] + i]


def gram(degree: int) -> Array:
    """Inner products of the basis over [0, 1], (l + 1, l + 1)."""
    return product_factor(degree) / (2 * degree + 1)


def derivative_matrix(degree: int) -> Array:
    """Matrix (l, l + 1) from coefficients of degree l to those of the derivative, of degree l - 1."""
    rows = np.arange(degree)
    matrix = np.zeros((degree, degree + 1))
    matrix[rows, rows], matrix[rows, rows + 1] = -degree, degree
    return matrix
