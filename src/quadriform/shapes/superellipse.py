"""The superellipse as a norm of the plane (P10), in the log domain: all four superquadrics are made of it."""

import numpy as np

from quadriform.points import Array

TINY = 1e-300
"""Stands for zero under a logarithm."""
quiet = np.errstate(under="ignore")
"""A share that vanishes is right as zero, also for callers who let NumPy raise."""


def log_abs(u: Array) -> Array:
    """Logarithm of |u|, finite at zero."""
    return np.log(np.maximum(np.abs(u), TINY))


@quiet
def signed_power(u: Array, exponent: float) -> Array:
    """sign(u) |u|^exponent (paper A.1), finite for every finite u."""
    return np.sign(u) * np.exp(exponent * log_abs(u)) * (u != 0)


@quiet
def norm(u: Array, v: Array, exponent: float) -> Array:
    """Radius of (u, v) in units of the superellipse |u|^(2/e) + |v|^(2/e) = 1; of degree one in (u, v)."""
    k = 2 / exponent
    return np.exp(np.logaddexp(k * log_abs(u), k * log_abs(v)) / k)  # P10


@quiet
def norm_derivatives(u: Array, v: Array, exponent: float) -> tuple[Array, Array, Array, Array]:
    """The norm and its derivatives with respect to u, v and the exponent.

    With p and q the shares of u and v in the sum, d log N / d log|u| = p and dN / de = N H / 2, H the entropy of
    the shares.
    """
    k = 2 / exponent
    log_u, log_v = log_abs(u), log_abs(v)
    total = np.logaddexp(k * log_u, k * log_v)
    log_n, log_p, log_q = total / k, k * log_u - total, k * log_v - total
    d_u = np.sign(u) * np.exp(log_n + log_p - log_u)
    d_v = np.sign(v) * np.exp(log_n + log_q - log_v)
    entropy = -np.exp(log_p) * log_p - np.exp(log_q) * log_q
    n = np.exp(log_n)
    return n, d_u, d_v, n * entropy / 2
