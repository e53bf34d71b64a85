"""Step 2 of the paper's iteration: the step of the control points by SVD or with springs (paper 3.2.3, 4)."""

from collections.abc import Callable

import numpy as np
from scipy.linalg import qr, solve_triangular

from quadriform.errors import OptionError
from quadriform.fitting.least_squares.regularisers import Regulariser, regulariser_matrix
from quadriform.points import Array, check_number

SPRINGS_STRENGTH = 1e-7
"""Weight alpha of the springs, per row of B, when none is given; the paper states no value."""

Step = Callable[[Array, Array, Array], Array]
"""From target displacements (m, 3), control points (k, 3) and undeformed ones (k, 3) to the step (k, 3)."""


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
    kept = min(_requested(w, strength), int((w > max(b.shape) * np.finfo(np.float64).eps * w[0]).sum()))
    return (vt[:kept].T / w[:kept]) @ u[:, :kept].T, kept


def _requested(singular: Array, strength: float | None) -> int:
    """How many singular values a strength selects, at least one."""
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
    """The solver of P7 for the step by SVD (paper 3.2.3), the smallest dP with B dP nearest to dX, and its strength."""
    inverse, kept = truncated_svd(b, strength)
    return lambda target, control, rest: inverse @ target, float(kept)  # P6, P7; section 3.2.3


def svd_position_step(b: Array, strength: float | None) -> tuple[Step, float]:
    """The solver of P7 for P itself, and its strength: a variant that moves the box even without displacement."""
    inverse, kept = truncated_svd(b, strength)
    return lambda target, control, rest: inverse @ (b @ control + target) - control, float(kept)  # P7


def penalised_step(b: Array, penalty: Array, strength: float, on_displacement: bool) -> tuple[Step, float]:
    """The solver of P9 with any penalty matrix, and its strength: on P - P0 when `on_displacement`, else on P.

    Solved by QR of the stacked rows, not by normal equations.

    Raises:
        OptionError: the strength leaves the control points undetermined.
    """
    strength = check_number(strength, "strength", 0)
    values, vectors = np.linalg.eigh(penalty)
    # a square root of the penalty by its eigenvectors: it may be singular
    root = np.sqrt(np.maximum(values, 0))[:, None] * vectors.T * np.sqrt(strength * len(b))
    q, r = qr(np.vstack([b, root]), mode="economic")
    # a small pivot of R: neither data nor penalty determines a control point
    diagonal = np.abs(np.diag(r))
    if diagonal.min() < 1e-13 * diagonal.max():
        raise OptionError(f"strength={strength:g} leaves control points undetermined; expected a larger one")
    rows = len(b)

    def step(target: Array, control: Array, rest: Array) -> Array:
        """The next control points (k, 3)."""
        penalised = control - rest if on_displacement else control
        right = q[:rows].T @ target - q[rows:].T @ (root @ penalised)  # P9
        return solve_triangular(r, right)

    return step, strength


def step_for(
    b: Array, shape: tuple[int, int, int], regularity: str | Regulariser, strength: float | str
) -> tuple[Step, float]:
    """The solver of step 2 for a constant deformation matrix B (m, k), and the strength that it uses."""
    given = None if strength == "auto" else check_number(strength, "strength", 0)  # type: ignore[arg-type]
    if regularity == "svd":
        return svd_step(b, given)
    if regularity == "svd-position":
        return svd_position_step(b, given)
    alpha = SPRINGS_STRENGTH if given is None else given
    return penalised_step(
        b, regulariser_matrix(regularity, shape), alpha, on_displacement=regularity != "springs-paper"
    )
