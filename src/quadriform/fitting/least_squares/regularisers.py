"""Regularisers of the box: symmetric matrices over its control points (section 4 of the paper)."""

from functools import lru_cache
from typing import Protocol

import numpy as np

from quadriform.errors import OptionError
from quadriform.points import Array
from quadriform.shapes.bernstein import derivative_matrix, gram, kronecker


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


class Bending:
    """Integral over the unit box of the squared second derivatives of the displacement field, in closed form.

    Affine displacements cost nothing, and raising the degree of a box changes nothing.
    """

    @staticmethod
    @lru_cache(maxsize=8)  # asked for in every round of a fit
    def matrix(shape: tuple[int, int, int]) -> Array:
        """Read-only matrix (k, k): the sum over the six second derivatives, the mixed ones twice."""
        along = [Bending._one_axis(count - 1) for count in shape]
        result = np.zeros((int(np.prod(shape)),) * 2)
        for orders in ((2, 0, 0), (0, 2, 0), (0, 0, 2), (1, 1, 0), (1, 0, 1), (0, 1, 1)):
            # the integral of a product over the box is the product of integrals along its axes
            integrals = (along[axis][order] for axis, order in enumerate(orders))
            result += (1 if 2 in orders else 2) * kronecker(*integrals)
        result.setflags(write=False)
        return result

    @staticmethod
    def _one_axis(degree: int) -> list[Array]:
        """Inner products over [0, 1] of the basis, of its first and of its second derivatives."""
        result, operator = [gram(degree)], np.eye(degree + 1)
        for order in (1, 2):
            if order > degree:
                result.append(np.zeros((degree + 1, degree + 1)))
                continue
            # differences of coefficients: the derivative of a Bernstein polynomial
            operator = derivative_matrix(degree - order + 1) @ operator
            result.append(operator.T @ gram(degree - order) @ operator)
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
