"""The superellipse as a norm of the plane (P10), in the log domain: all four superquadrics are made of it."""

import numpy as np

from quadriform.points import Array

TINY = 1e-300
"""Stands for zero under a logarithm."""
EDGE = 1e-12
"""Fraction of the norm below which a coordinate is rounding of zero, which must not choose the side of an edge."""
quiet = np.errstate(under="ignore")
"""Underflow to zero is correct here, also for callers who let NumPy raise."""


def log_abs(u: Array) -> Array:
    """Logarithm of |u|, finite at zero."""
    return np.log(np.maximum(np.abs(u), TINY))


@quiet
def signed_power(u: Array, exponent: float) -> Array:
    """sign(u) |u|^exponent (paper A.1), finite for every finite u."""
    return np.sign(u) * np.exp(exponent * log_abs(u)) * (u != 0)  # section A.1


@quiet
def norm(u: Array, v: Array, exponent: float) -> Array:
    """Radius of (u, v) in units of the superellipse |u|^(2/e) + |v|^(2/e) = 1; of degree one in (u, v)."""
    k = 2 / exponent
    return np.exp(np.logaddexp(k * log_abs(u), k * log_abs(v)) / k)  # P10


@quiet
def norm_derivatives(u: Array, v: Array, exponent: float) -> tuple[Array, Array, Array, Array]:
    """The norm and its derivatives with respect to u, v and the exponent.

    With p and q the fractions of u and v in the sum, d log N / d log|u| = p and dN / de = N H / 2, H the entropy of
    these fractions.
    """
    k = 2 / exponent
    log_u, log_v = log_abs(u), log_abs(v)
    log_ratio = k * (log_u - log_v)
    ratio = np.exp(-np.abs(log_ratio))  # of the smaller term to the larger: one exponential gives both fractions
    excess = np.log1p(ratio)
    # In logarithms no power overflows, whatever the exponent.
    n = np.exp(np.maximum(log_u, log_v) + excess / k)
    large = 1 / (1 + ratio)
    small = ratio * large
    p, q = np.where(log_ratio > 0, large, small), np.where(log_ratio > 0, small, large)
    entropy = excess + np.abs(log_ratio) * small
    return n, _by_term(n, p, u), _by_term(n, q, v), n * entropy / 2


def _by_term(n: Array, fraction: Array, u: Array) -> Array:
    """Derivative of the norm by u, whose term is this fraction of its sum; zero at u = 0, where it may have an edge."""
    return np.divide(n * fraction, u, out=np.zeros_like(fraction), where=np.abs(u) > EDGE * n)
