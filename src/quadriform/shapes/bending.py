"""Bending energy of a displacement field in a control box, as a matrix over its control points."""

from functools import lru_cache

import numpy as np

from quadriform.points import Array
from quadriform.shapes.bernstein import derivative_matrix, gram, kronecker


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
