"""The whole cycle as one linear problem: control points at the knots of a spline over time, and shifts of slices.

With d(x, t) the displacement field, u time in spans and N data points, minimised over the control points is

    sum_i w_i (squared distances) + alpha N  mean over t of E(d)  +  gamma N  mean over t, x of |d2 d / d u2|^2.

E is the bending energy of a single fit. gamma has the largest evidence (REML), alpha that of single frames.
"""

from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass

import numpy as np
from scipy.linalg import LinAlgError, cho_solve, cholesky, eigh
from scipy.optimize import minimize_scalar

from quadriform.errors import OptionError
from quadriform.fitting.normal_equations import NormalEquations
from quadriform.points import Array
from quadriform.shapes.bernstein import gram
from quadriform.shapes.splines import TimeBasis

NEARBY = np.log(1e3)
"""The strength in time is sought within this factor of the last one."""
NOISE_FLOOR = 1e-9
"""Of the cloud's RMS radius: no data is more exact than that."""


@dataclass(frozen=True)
class CycleSolution:
    """Displacements of the control points under one pair of strengths.

    Attributes:
        displacement: (K, k, 3), from rest, at the knots.
        shifts: (m,), what else was solved for.
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
        border: for each of m further unknowns its coupling to the control points of each frame, (m, F, 3 k); their
            own matrix (m, m) and right side (m,).
    """

    def __init__(
        self,
        equations: Sequence[NormalEquations],
        values: Array,
        basis: TimeBasis,
        penalty: Array,
        shape: tuple[int, int, int],
        count: float,
        border: tuple[Array, Array, Array] | None = None,
    ) -> None:
        self.count, self.knots, self.size = count, values.shape[1], 3 * len(penalty)
        self.values = values
        self.matrix, self.right, self.constant = self._sums(equations)
        if border is not None:
            self._add_border(*border)
        mass = np.kron(np.kron(gram(shape[0] - 1), gram(shape[1] - 1)), gram(shape[2] - 1))
        self._time = basis.mass(), basis.bending()
        self._space = np.kron(penalty, np.eye(3)), np.kron(mass, np.eye(3))
        kappa = np.maximum(eigh(penalty, mass, eigvals_only=True), 0)
        tau = np.maximum(eigh(self._time[1], self._time[0], eigvals_only=True), 0)
        self._values = kappa * (kappa > 1e-9 * kappa.max()), tau * (tau > 1e-9 * tau.max())

    def _sums(self, equations: Sequence[NormalEquations]) -> tuple[Array, Array, float]:
        matrix = _in_time(self.values, np.stack([equation.matrix for equation in equations]))
        right = (self.values.T @ np.stack([equation.right for equation in equations])).ravel()
        return matrix, right, sum(equation.constant for equation in equations)

    def _add_border(self, coupling: Array, own: Array, right: Array) -> None:
        across = np.einsum("fa,mfi->aim", self.values, coupling).reshape(len(self.matrix), -1)
        self.matrix = np.block([[self.matrix, across], [across.T, own]])
        self.right = np.concatenate([self.right, right])

    def plus(self, equations: Sequence[NormalEquations]) -> "CycleEvidence":
        """The same with something else to be met in each frame."""
        matrix, right, constant = self._sums(equations)
        other, size = copy(self), len(right)
        other.matrix, other.right = self.matrix.copy(), self.right.copy()
        other.matrix[:size, :size] += matrix
        other.right[:size] += right
        other.constant = self.constant + constant
        return other

    def cost(self, displacement: Array, shifts: Array, alpha: float, gamma: float) -> float:
        """The sum at displacements (K, k, 3) and shifts (m,)."""
        p = displacement.reshape(self.knots, -1)
        (mass_t, bending_t), (bending_x, mass_x) = self._time, self._space
        held = alpha * np.sum((mass_t @ p) * (p @ bending_x)) + gamma * np.sum((bending_t @ p) * (p @ mass_x))
        q = np.concatenate([p.ravel(), shifts])
        return float(q @ (self.matrix @ q) - 2 * self.right @ q + self.constant + self.count * held)

    def solve(self, alpha: float, gamma: float) -> CycleSolution:
        """The displacement at one pair of strengths.

        Raises:
            OptionError: they leave control points undetermined.
        """
        try:
            factor = cholesky(self._held(alpha, gamma), lower=True, overwrite_a=True, check_finite=False)
        except LinAlgError as error:
            text = (
                f"strengths {alpha:g} in space and {gamma:g} in time leave control points undetermined; try larger ones"
            )
            raise OptionError(text) from error
        found = cho_solve((factor, True), self.right, check_finite=False)
        held = self.count * (alpha * self._values[0][:, None] + gamma * self._values[1])
        ranked = held[held > 0]
        rows = max(self.count - 3 * float((held <= 0).sum()), 1.0)
        variance = max((self.constant - float(self.right @ found)) / rows, NOISE_FLOOR**2)
        criterion = rows * np.log(variance) + 2 * np.log(np.diag(factor)).sum() - 3 * np.log(ranked).sum()
        size = self.knots * self.size
        displacement = found[:size].reshape(self.knots, -1, 3)
        return CycleSolution(displacement, found[size:], float(np.sqrt(variance)), float(criterion))

    def _held(self, alpha: float, gamma: float) -> Array:
        """The matrix with both penalties added, block by block."""
        (mass_t, bending_t), (bending_x, mass_x) = self._time, self._space
        held = self.matrix.copy()
        for a in range(self.knots):
            for b in range(self.knots):
                block = np.s_[a * self.size : (a + 1) * self.size, b * self.size : (b + 1) * self.size]
                held[block] += self.count * (alpha * mass_t[a, b] * bending_x + gamma * bending_t[a, b] * mass_x)
        return held

    def best_in_time(self, alpha: float, gamma: float) -> float:
        """The strength in time with the largest evidence, near a given one.

        The strength in space stays that of single frames: over a whole cycle smoothness in time could take its place
        on the surface, but nothing would then hold the space inside.
        """

        def criterion(log: float) -> float:
            try:
                return self.solve(alpha, float(np.exp(log))).criterion
            except OptionError:
                return np.inf

        middle = np.log(gamma)
        found = minimize_scalar(
            criterion, bounds=(middle - NEARBY, middle + NEARBY), method="bounded", options={"xatol": 0.5}
        )
        return float(np.exp(found.x))


def _in_time(values: Array, matrices: Array) -> Array:
    """sum_f (v_f v_f') kron A_f, of frames' matrices (F, n, n): (K n, K n)."""
    frames, knots = values.shape
    n = matrices.shape[1]
    pairs = (values[:, :, None] * values[:, None, :]).reshape(frames, -1)
    blocks = (pairs.T @ matrices.reshape(frames, -1)).reshape(knots, knots, n, n)
    return blocks.transpose(0, 2, 1, 3).reshape(knots * n, knots * n)
