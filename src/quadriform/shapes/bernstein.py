"""Bernstein polynomials (paper, appendix B) and the tensor product of three of them."""

from math import comb

import numpy as np

from quadriform.points import Array

CHUNK = 8192
"""Points handled at once: what they need stays in the cache, so memory does not grow with the cloud."""


def basis(s: Array, degree: int) -> Array:
    """B_i(s) = C(l, i) (1 - s)^(l - i) s^i for i = 0 .. l, shape (n, l + 1)."""
    i = np.arange(degree + 1)
    binomials = np.array([comb(degree, k) for k in i], dtype=np.float64)
    return binomials * np.power(1 - s[:, None], degree - i) * np.power(s[:, None], i)  # P19


def basis_derivative(s: Array, degree: int) -> Array:
    """d B_i / ds = l (B_{i-1} - B_i) of degree l - 1, shape (n, l + 1)."""
    if degree == 0:
        return np.zeros((len(s), 1))
    lower = np.pad(basis(s, degree - 1), ((0, 0), (1, 1)))
    return degree * (lower[:, :-1] - lower[:, 1:])


def combine(factors: list[Array], coefficients: Array) -> Array:
    """sum_ijk a_i b_j c_k C_ijk for each point, one factor after the other.

    Args:
        factors: three arrays, (n, l + 1), (n, m + 1) and (n, n + 1).
        coefficients: (l + 1, m + 1, n + 1, d).

    Returns:
        (n, d).
    """
    along_s, along_t, along_u = factors
    n = len(along_s)
    _, m, k, d = coefficients.shape
    first = along_s @ coefficients.reshape(len(coefficients), -1)
    second = np.matmul(along_t[:, None, :], first.reshape(n, m, k * d))
    return np.matmul(along_u[:, None, :], second.reshape(n, k, d))[:, 0]


def products(factors: list[Array]) -> Array:
    """All products a_i b_j c_k of three factors, (n, (l + 1)(m + 1)(n + 1)), the last index running fastest."""
    along_s, along_t, along_u = factors
    pairs = (along_s[:, :, None] * along_t[:, None, :]).reshape(len(along_s), -1)
    return (pairs[:, :, None] * along_u[:, None, :]).reshape(len(along_s), -1)


def elevation(low: int, high: int) -> Array:
    """Matrix (high + 1, low + 1) that writes a polynomial of degree `low` in the basis of degree `high`, exactly."""
    matrix = np.zeros((high + 1, low + 1))
    for j in range(high + 1):
        for i in range(max(0, j - high + low), min(low, j) + 1):
            matrix[j, i] = comb(low, i) * comb(high - low, j - i) / comb(high, j)
    return matrix
