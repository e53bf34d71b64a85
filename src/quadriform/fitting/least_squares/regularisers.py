"""Regularisers of the box: symmetric matrices over its control points (section 4 of the paper)."""

from typing import Protocol

import numpy as np

from quadriform.errors import OptionError
from quadriform.points import Array
from quadriform.shapes.bending import Bending
from quadriform.shapes.bernstein import kronecker


class Regulariser(Protocol):
    """Anything with one method can regularise the box."""

    def matrix(self, shape: tuple[int, int, int]) -> Array:
        """Symmetric positive semi-definite (k, k) over k control points, the last axis running fastest."""


class Springs:
    """Springs between neighbours along the three axes, whose energy is |P_a - P_b|^2; each pair counts twice, as in P9.

    P are the control points with "springs-paper", and their displacements with "springs".
    """

    def matrix(self, shape: tuple[int, int, int]) -> Array:
        """The matrix K1 (k, k) with sum_jh K1_jh P_j . P_h = sum_j sum_{h next to j} |P_j - P_h|^2."""
        units = [np.eye(count) for count in shape]
        result = np.zeros((int(np.prod(shape)),) * 2)
        for axis, unit in enumerate(units):
            difference, factors = np.diff(unit, axis=0), units.copy()
            factors[axis] = 2 * difference.T @ difference  # a pair counts twice: 2 |P_a - P_b|^2 over both
            result += kronecker(*factors)
        return result


def regulariser_matrix(regularity: str | Regulariser, shape: tuple[int, int, int]) -> Array:
    """The matrix (k, k) of "springs", "springs-paper", "bending" or of a user's own regulariser, checked.

    Raises:
        OptionError: no method `matrix`, or it is not a symmetric (k, k) array of finite numbers.
    """
    if isinstance(regularity, str):
        return Bending().matrix(shape) if regularity == "bending" else Springs().matrix(shape)
    if not callable(getattr(regularity, "matrix", None)):
        raise OptionError(f"regularity={regularity!r}: expected a name or an object with a method matrix(shape)")
    matrix = np.asarray(regularity.matrix(shape), dtype=np.float64)
    count = int(np.prod(shape))
    if matrix.shape != (count, count) or not np.isfinite(matrix).all() or not np.allclose(matrix, matrix.T):
        raise OptionError(
            f"regularity: matrix({shape}) must be symmetric of shape ({count}, {count}), found {matrix.shape}"
        )
    return matrix
