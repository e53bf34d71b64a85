"""Taubin's bounded distance of second order (paper 2.4; Taubin 1993), which needs no search.

With f = F^2 - 1, |f(x + y)| >= |f| - |grad f| d - |H| d^2 / 2 for every y of length d where f is quadratic, that is for
exponents of 1: no surface is then nearer than the positive root d of the right side. |H| is the root of the sum of the
squares of the second derivatives. For other exponents the inequality is true up to terms of third order in d.
"""

import numpy as np

from quadriform.points import Array

LEAST = 1e-60
"""Stands for a coordinate of zero: its powers stay finite."""


def bounded_distance(value: Array, gradient: Array, hessian: Array) -> Array:
    """Positive roots (n,) of |f| - |grad f| d - |H| d^2 / 2, of n values, gradients (n, 3) and Hessians (n, 3, 3)."""
    first, second = np.linalg.norm(gradient, axis=1), np.linalg.norm(hessian, axis=(1, 2))
    size = np.abs(value)
    return np.asarray(2 * size / np.maximum(first + np.sqrt(first**2 + 2 * second * size), 1e-300))  # section 2.4


def squared_implicit(scaled: Array, exponents: Array) -> tuple[Array, Array, Array]:
    """F^2 - 1 of a superellipsoid at scaled points (n, 3), its gradient (n, 3) and its Hessian (n, 3, 3) by these.

    Chain rule over the two norms of F = N_e1(N_e2(x, y), z).
    """
    x, y, z = np.where(scaled < 0, -1.0, 1.0).T * np.maximum(np.abs(scaled), LEAST).T
    s, by_s, within = _norm(x, y, exponents[1])
    f, by_f, outside = _norm(s, z, exponents[0])
    inner, zero = np.column_stack([by_s, np.zeros_like(s)]), np.zeros_like(s)
    along = np.column_stack([zero, zero, zero + 1])
    # with F = f(s, z), s = s(x, y): grad F = f_s grad s + f_z grad z
    gradient = by_f[:, :1] * inner + by_f[:, 1:] * along
    rows = np.stack([inner, along], axis=1)
    # and Hess F = J' (Hess f) J + f_s Hess s, J with rows grad s and grad z
    hessian = np.einsum("nai,nab,nbj->nij", rows, outside, rows)
    hessian[:, :2, :2] += by_f[:, :1, None] * within
    # Hess F^2 = 2 grad F grad F' + 2 F Hess F
    square = 2 * np.einsum("ni,nj->nij", gradient, gradient) + 2 * f[:, None, None] * hessian
    return f**2 - 1, 2 * f[:, None] * gradient, square


def _norm(u: Array, v: Array, exponent: float) -> tuple[Array, Array, Array]:
    """N of (u, v), none of them zero, its derivatives (n, 2) and its second derivatives (n, 2, 2)."""
    k = 2 / exponent
    log_u, log_v = np.log(np.abs(u)), np.log(np.abs(v))
    log_n = np.logaddexp(k * log_u, k * log_v) / k
    by = np.stack(
        [np.sign(w) * np.exp(k * (log_w - log_n) + log_n - log_w) for w, log_w in ((u, log_u), (v, log_v))], 1
    )
    across = (k - 1) * np.exp(k * (log_u + log_v - 2 * log_n) + log_n)  # N p q, of the fractions p and q
    relative = np.stack([1 / u, -1 / v], axis=1)
    return np.exp(log_n), by, across[:, None, None] * np.einsum("ni,nj->nij", relative, relative)
