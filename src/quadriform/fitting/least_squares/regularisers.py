"""Step 2 of the iteration: the control points that the displacements ask for, kept regular (paper 3.2.3, 4)."""

from collections.abc import Callable
from functools import lru_cache
from typing import Protocol

import numpy as np
from scipy.linalg import qr, solve_triangular

from quadriform.errors import OptionError
from quadriform.points import Array, check_number
from quadriform.shapes.bernstein import derivative_matrix, gram

SPRINGS_STRENGTH = 1e-7
"""Weight alpha of the springs, per row of B, when none is given; the paper states no value."""

Step = Callable[[Array, Array, Array], Array]
"""From the wanted displacements (m, 3), the control points (k, 3) and the resting ones, the step of the former."""


class Regulariser(Protocol):
    """Anything with one method can hold the box."""

    def matrix(self, shape: tuple[int, int, int]) -> Array:
        """Symmetric positive semi-definite (k, k) over k control points, the last axis running fastest."""


class Springs:
    """Springs of no length between neighbours along the three axes; each pair counts twice, as P9 prints it."""

    def matrix(self, shape: tuple[int, int, int]) -> Array:
        """D^T D with |D P|^2 = sum_j sum_{j' next to j} |P_j - P_j'|^2."""
        index = np.arange(np.prod(shape)).reshape(shape)
        result = np.zeros((index.size, index.size))
        for axis in range(3):
            moved = np.moveaxis(index, axis, 0)
            one, other = moved[:-1].ravel(), moved[1:].ravel()
            for a, b in ((one, other), (other, one)):
                np.add.at(result, (a, a), 2.0)  # a pair counts twice: 2 |P_a - P_b|^2 over both
                np.add.at(result, (a, b), -2.0)
        return result


class Bending:
    """Integral over the unit box of the squared second derivatives of the displacement field, in closed form.

    Affine displacements cost nothing, and raising the degree of a box changes nothing.
    """

    @staticmethod
    @lru_cache(maxsize=8)  # asked for in every round of a fit
    def matrix(shape: tuple[int, int, int]) -> Array:
        """Sum over the six second derivatives, the mixed ones twice; not to be written to."""
        along = [Bending._one_axis(count - 1) for count in shape]
        result = np.zeros((int(np.prod(shape)),) * 2)
        for orders, times in (
            ((2, 0, 0), 1),
            ((0, 2, 0), 1),
            ((0, 0, 2), 1),
            ((1, 1, 0), 2),
            ((1, 0, 1), 2),
            ((0, 1, 1), 2),
        ):
            first, second, third = (along[axis][order] for axis, order in enumerate(orders))
            result += times * np.kron(np.kron(first, second), third)
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
            operator = derivative_matrix(degree - order + 1) @ operator
            result.append(operator.T @ gram(degree - order) @ operator)
        return result


def truncated_svd(b: Array, strength: float | None) -> tuple[Array, int]:
    """Pseudo-inverse (k, m) of B from its largest singular values (P8), and how many of them were used.

    Singular values up to max(m, k) eps s1 are rounding of zero and are never used.

    Args:
        b: (m, k).
        strength: a whole number uses that many; a number below 1 uses those above that fraction of the largest; None
            uses all above rounding.

    Raises:
        OptionError: more singular values than B has, a fraction of one, or not a number.
    """
    u, w, vt = np.linalg.svd(b, full_matrices=False)  # P8
    kept = min(_asked(w, strength), int((w > max(b.shape) * np.finfo(np.float64).eps * w[0]).sum()))
    return (vt[:kept].T / w[:kept]) @ u[:, :kept].T, kept


def _asked(singular: Array, strength: float | None) -> int:
    """How many of the singular values a strength asks for, at least one."""
    if strength is None:
        return len(singular)
    number = check_number(strength, "strength", 0, len(singular))
    if number < 1:
        return max(1, int((singular > number * singular[0]).sum()))
    if number != int(number):
        raise OptionError(
            f"option strength={number:g} is out of range; expected a whole number of singular values, or a fraction of "
            "the largest below 1"
        )
    return int(number)


def svd_step(b: Array, strength: float | None) -> tuple[Step, float]:
    """P7 solved for the step by SVD (paper 3.2.3): the smallest dP with B dP nearest to dX."""
    inverse, kept = truncated_svd(b, strength)
    return lambda wanted, control, rest: inverse @ wanted, float(kept)  # P6, P7; section 3.2.3


def svd_position_step(b: Array, strength: float | None) -> tuple[Step, float]:
    """The named variant that solves for P itself: it moves the box even without displacement."""
    inverse, kept = truncated_svd(b, strength)
    return lambda wanted, control, rest: inverse @ (b @ control + wanted) - control, float(kept)  # P7


def held_step(b: Array, penalty: Array, strength: float, on_displacement: bool) -> tuple[Step, float]:
    """P9 with any penalty matrix: on P - P0 when `on_displacement`, else on P.

    Solved by QR of the stacked rows, not by normal equations.

    Raises:
        OptionError: the strength leaves the control points undetermined.
    """
    strength = check_number(strength, "strength", 0)
    values, vectors = np.linalg.eigh(penalty)
    root = np.sqrt(np.maximum(values, 0))[:, None] * vectors.T * np.sqrt(strength * len(b))
    q, r = qr(np.vstack([b, root]), mode="economic")
    diagonal = np.abs(np.diag(r))
    if diagonal.min() < 1e-13 * diagonal.max():
        raise OptionError(f"strength={strength:g} leaves control points undetermined; expected a larger one")
    rows = len(b)

    def step(wanted: Array, control: Array, rest: Array) -> Array:
        held = control - rest if on_displacement else control
        right = q[:rows].T @ wanted - q[rows:].T @ (root @ held)  # P9
        return solve_triangular(r, right)

    return step, strength


def step_for(
    b: Array, shape: tuple[int, int, int], regularity: str | Regulariser, strength: float | str
) -> tuple[Step, float]:
    """The solver of step 2 for a deformation matrix that stays the same, and the strength it works with."""
    given = None if strength == "auto" else check_number(strength, "strength", 0)  # type: ignore[arg-type]
    if regularity == "svd":
        return svd_step(b, given)
    if regularity == "svd-position":
        return svd_position_step(b, given)
    held = SPRINGS_STRENGTH if given is None else given
    return held_step(b, penalty(regularity, shape), held, on_displacement=regularity != "springs-paper")


def penalty(regularity: str | Regulariser, shape: tuple[int, int, int]) -> Array:
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


REGULARITIES = ("svd", "svd-position", "springs", "springs-paper")
