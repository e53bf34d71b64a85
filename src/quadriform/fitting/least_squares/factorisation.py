"""Factors of symmetric matrices: Cholesky, with a test for lost digits, its condition, and eigenvectors."""

from functools import lru_cache

import numpy as np
from scipy.linalg import LinAlgError, cholesky, lapack

from quadriform.errors import OptionError
from quadriform.points import Array


def cholesky_factor(matrix: Array) -> Array | None:
    """The lower Cholesky factor of a matrix, which is overwritten; None where a pivot is lost in rounding."""
    diagonal = matrix.diagonal().copy()
    try:
        factor: Array = cholesky(matrix, lower=True, overwrite_a=True, check_finite=False)
    except LinAlgError:
        return None
    return factor if (factor.diagonal() ** 2 > len(matrix) * np.finfo(float).eps * diagonal).all() else None


def condition_number(factor: Array) -> float:
    """LAPACK's estimate of the condition number of the matrix of a lower Cholesky factor, scaled to unit diagonal.

    Without the scaling, diagonal entries of very different size, as those of a regulariser in its eigenbasis, would
    count as ill-conditioning. The rounding of a solution by Cholesky's method does not depend on them.
    """
    scaled = factor / np.sqrt((factor**2).sum(axis=1))[:, None]
    largest = np.abs(scaled @ scaled.T).sum(axis=0).max()
    reciprocal, _ = lapack.dpocon(scaled, largest, uplo="L")
    return float(1 / max(reciprocal, np.finfo(float).tiny))


@lru_cache(maxsize=4)
def spectrum(matrix: bytes) -> tuple[Array, Array]:
    """Eigenvalues (k,), those of the null space exactly zero, and eigenvectors (k, k) of a regulariser's matrix (k, k).

    The matrix is given by its bytes, for an array cannot be a key of the cache.

    Raises:
        OptionError: an eigenvalue is negative.
    """
    entries = np.frombuffer(matrix, dtype=np.float64)
    values, vectors = np.linalg.eigh(entries.reshape(int(np.sqrt(len(entries))), -1))
    least = 1e-10 * np.abs(values).max()
    if values[0] < -least:
        text = f"the smallest eigenvalue is {values[0] / values[-1]:.2g} of the largest"
        raise OptionError(f"regularity: its matrix must be positive semi-definite; {text}")
    return np.where(values > least, values, 0.0), vectors
