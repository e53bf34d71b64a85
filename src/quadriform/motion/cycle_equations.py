"""The whole cycle as one linear problem: control points at the knots of a spline over time, and shifts of slices.

With d(x, t) the displacement field, u time in spans and N data points, minimised over the control points is

    sum_i w_i (squared distances) + alpha N  mean over t of E(d)  +  gamma N  mean over t, x of |d2 d / d u2|^2.

E is the bending energy of a single fit. gamma has the largest evidence (REML), alpha that of single frames. All is
solved in the eigenbases of both penalties, so that the data's part on their null spaces is not lost in rounding.
"""

from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass

import numpy as np
from scipy.linalg import cho_solve, eigh
from scipy.optimize import minimize_scalar

from quadriform.fitting.least_squares.marginal_likelihood import SELECTION, cholesky_factor, spectrum
from quadriform.fitting.least_squares.normal_equations import NormalEquations
from quadriform.points import Array
from quadriform.shapes.bernstein import gram, kronecker
from quadriform.shapes.splines import TimeBasis

NEARBY = np.log(1e3)
"""The strength in time is sought within this factor of the last one."""
CLOSE = 0.5
"""To within this difference of its logarithm."""
ROUNDING = 1e-9
"""Eigenvalues below this share of the largest are rounding of zero; those of the penalty in time also below this
number, for time is in spans, and of what is penalised none is below 100."""


@dataclass(frozen=True)
class CycleSolution:
    """Displacements of the control points under one pair of strengths.

    Attributes:
        displacement: (K, k, 3), from the undeformed box, at the knots.
        shifts: (m,), the further unknowns.
        noise: standard deviation of the data along the normal.
        criterion: minus twice the log evidence, up to a constant.
    """

    displacement: Array
    shifts: Array
    noise: float
    criterion: float


class CycleEvidence:
    """The linear problem of one round as a function of its strengths.

    Args:
        equations: one for each frame.
        values: (F, K), the splines at the frames.
        basis: the splines.
        penalty: (k, k), the regulariser in space.
        shape: control points along each axis.
        count: number of residual rows, the sum of the weights of all frames.
        bordered_block: for each of m further unknowns its coupling to the control points of each frame, (m, F, 3 k);
            their own matrix (m, m) and right side (m,).
        effective_fraction: number of independent rows over that of all rows.
        least_noise: lower bound of the noise.
    """

    def __init__(
        self,
        equations: Sequence[NormalEquations],
        values: Array,
        basis: TimeBasis,
        penalty: Array,
        shape: tuple[int, int, int],
        count: float,
        bordered_block: tuple[Array, Array, Array] | None = None,
        effective_fraction: float = 1.0,
        least_noise: float = 0.0,
    ) -> None:
        self.effective_fraction, self.least_noise = effective_fraction, least_noise
        self.count, self.knots, self.size = count, values.shape[1], 3 * len(penalty)
        mass = kronecker(gram(shape[0] - 1), gram(shape[1] - 1), gram(shape[2] - 1))
        energies, self._in_space = spectrum(penalty.tobytes())
        # generalised eigenvectors V of the penalty in time, V' M V = 1: it couples no two of them
        eigenvalues, self._in_time = eigh(basis.bending(), basis.mass())
        self._mass_time = basis.mass()
        # eigenvalues that are rounding of zero are zero, so that the null space is exact
        tau = eigenvalues * (eigenvalues > ROUNDING * max(eigenvalues.max(), 1.0))
        self._costs = np.repeat(energies, 3), tau
        self._mass = np.kron(self._in_space.T @ mass @ self._in_space, np.eye(3))
        kappa = np.maximum(eigh(penalty, mass, eigvals_only=True), 0)
        self._values = kappa * (kappa > ROUNDING * kappa.max()), tau
        self.values = values @ self._in_time
        self.matrix, self.right, self.constant = self._sums(equations)
        self.measured: CycleEvidence | None = None  # the data alone, where there are penalties
        if bordered_block is not None:
            self._add_bordered_block(*bordered_block)

    def _sums(self, equations: Sequence[NormalEquations]) -> tuple[Array, Array, float]:
        """Matrix (K 3 k, K 3 k), right side and constant of all frames in both eigenbases."""
        # space first: each frame has the same basis
        rotated = [equation.between(self._in_space) for equation in equations]
        matrix = _in_time(self.values, np.stack([equation.matrix for equation in rotated]))
        right = (self.values.T @ np.stack([equation.right for equation in rotated])).ravel()
        return matrix, right, sum(equation.constant for equation in equations)

    def _add_bordered_block(self, coupling: Array, own: Array, right: Array) -> None:
        """Append the further unknowns to matrix and right side."""
        by_point = coupling.reshape(*coupling.shape[:2], len(self._in_space), 3)
        rotated = np.einsum("mfki,kj->mfji", by_point, self._in_space)
        # coupling of the shifts with the control points, in the same two bases
        across = np.einsum("fa,mfji->ajim", self.values, rotated).reshape(len(self.matrix), -1)
        self.matrix = np.block([[self.matrix, across], [across.T, own]])
        self.right = np.concatenate([self.right, right])

    def plus(self, equations: Sequence[NormalEquations]) -> "CycleEvidence":
        """The problem with further normal equations in each frame, of penalties that are no part of the noise."""
        matrix, right, constant = self._sums(equations)
        other, size = copy(self), len(right)
        other.measured = self.measured or self
        other.matrix, other.right = self.matrix.copy(), self.right.copy()
        other.matrix[:size, :size] += matrix
        other.right[:size] += right
        other.constant = self.constant + constant
        return other

    def cost(self, displacement: Array, shifts: Array, alpha: float, gamma: float) -> float:
        """The penalised sum of squares at displacements (K, k, 3) and shifts (m,)."""
        rotated = np.einsum("jk,aki->aji", self._in_space.T, displacement.reshape(self.knots, -1, 3))
        # coefficients in both eigenbases; V' M is the inverse of V
        p = self._in_time.T @ self._mass_time @ rotated.reshape(self.knots, -1)
        energies, tau = self._costs
        penalties = alpha * np.sum(p**2 @ energies) + gamma * tau @ np.sum((p @ self._mass) * p, axis=1)
        q = np.concatenate([p.ravel(), shifts])
        return float(q @ (self.matrix @ q) - 2 * self.right @ q + self.constant + self.count * penalties)

    def solve(self, alpha: float, gamma: float) -> CycleSolution | None:
        """The displacement at one pair of strengths; None where they leave control points undetermined."""
        factor = cholesky_factor(self._penalised(alpha, gamma))
        if factor is None:
            return None
        found = cho_solve((factor, True), self.right, check_finite=False)
        penalties = self.count * (alpha * self._values[0][:, None] + gamma * self._values[1])
        ranked = penalties[penalties > 0]
        null_dimension = 3 * float((penalties <= 0).sum())
        rows = max(self.count - null_dimension, 1.0)
        size = self.knots * self.size
        rotated = self._in_time @ found[:size].reshape(self.knots, -1)
        displacement = np.einsum("kj,aji->aki", self._in_space, rotated.reshape(self.knots, -1, 3))
        # the minimum of the sum over the degrees of freedom, without what penalties add
        least = self.constant - float(self.right @ found)
        misfit = (self.measured.cost(displacement, found[size:], alpha, gamma) if self.measured else least) / rows
        variance = max(misfit, self.least_noise**2, SELECTION.noise_floor**2)
        independent = max(self.effective_fraction * self.count - null_dimension, 1.0)
        # minus twice the log evidence (REML): the penalties enter by the sum of logarithms of their eigenvalues
        criterion = (
            independent * (np.log(variance) + misfit / variance)
            + 2 * np.log(np.diag(factor)).sum()
            - 3 * np.log(ranked).sum()
        )
        return CycleSolution(displacement, found[size:], float(np.sqrt(variance)), float(criterion))

    def _penalised(self, alpha: float, gamma: float) -> Array:
        """The matrix plus N (alpha E + gamma tau mass) for each eigenvector in time, of eigenvalue tau."""
        penalties = self.matrix.copy()
        for knot, tau in enumerate(self._costs[1]):
            block = slice(knot * self.size, (knot + 1) * self.size)
            penalties[block, block] += self.count * (alpha * np.diag(self._costs[0]) + gamma * tau * self._mass)
        return penalties

    def best_in_time(self, alpha: float, gamma: float) -> float:
        """The strength in time with the largest evidence, near a given one.

        The strength in space stays that of single frames: over a whole cycle smoothness in time could replace it on the
        surface, but would not regularise the space inside.
        """

        def criterion(log: float) -> float:
            solution = self.solve(alpha, float(np.exp(log)))
            return np.inf if solution is None else solution.criterion

        if not self._costs[1].any():
            return gamma  # so few splines that no motion is penalised
        middle = np.log(gamma)
        found = minimize_scalar(
            criterion, bounds=(middle - NEARBY, middle + NEARBY), method="bounded", options={"xatol": CLOSE}
        )
        return float(np.exp(found.x))


def _in_time(values: Array, matrices: Array) -> Array:
    """sum_f (v_f v_f') kron A_f, of frames' matrices (F, n, n): (K n, K n)."""
    frames, knots = values.shape
    n = matrices.shape[1]
    # frames enter by products of two splines, so the sum over frames is one product of matrices
    pairs = (values[:, :, None] * values[:, None, :]).reshape(frames, -1)
    blocks = (pairs.T @ matrices.reshape(frames, -1)).reshape(knots, knots, n, n)
    return blocks.transpose(0, 2, 1, 3).reshape(knots * n, knots * n)
