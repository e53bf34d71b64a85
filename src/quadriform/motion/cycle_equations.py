"""The whole cycle as one linear problem: control points that are splines over time, and motions of slices.

The displacement of each control point is a sum of K cardinal splines in time; the unknowns are their coefficients, the
displacements at the K knots. With d(x, t) the displacement field from the undeformed box, u time in units of the
period (without one, of the time that the knots cover) and N the sum of the weights of all data points, they minimise

    sum_i w_i (squared distances) + alpha N  mean over t of E(d)  +  gamma N  mean over t, x of |d2 g / d u2|^2.

E is an energy of displacements (`energies.py`): the bending energy of a single fit, or that of a population, which is
taken at the frames. g is d; with a period, d without its constant and its sine of one period, which are not penalised
in time (`TimeBasis.bending`). Of the two strengths, gamma has the largest marginal likelihood of the whole cycle
(REML), and alpha is given: it is chosen on single frames.

All is solved in the coordinates of the energy and in the eigenbasis of the regulariser in time, so that the data's part
on their null spaces is not lost in rounding. In these coordinates the energy is p' R p - 2 r' p + c, and the block of
one eigenvector in time, of eigenvalue tau, has the regulariser N (alpha R + gamma tau M).

Numbers are F of frames, K of knots, k of control points and m of further unknowns (the motions). Indices of arrays are
f of frames, a and b of knots or eigenvectors in time, j of control points, h of coordinates in space, i of axes and s
of further unknowns. With p_bhi the unknowns, V the eigenvectors in time and B the basis of the energy, the
displacements at the knots are D_aji = sum_bh V_ab B_jh p_bhi. With v_fa the splines at the frames, those in the
eigenbasis of time are W_fb = sum_a v_fa V_ab.
"""

from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass

import numpy as np
from scipy.linalg import cho_solve, eigh, solve_triangular
from scipy.optimize import minimize_scalar

from quadriform.fitting.least_squares.factorisation import cholesky_factor
from quadriform.fitting.least_squares.normal_equations import NormalEquations
from quadriform.fitting.least_squares.selection import SELECTION
from quadriform.motion.energies import ROUNDING, Energy
from quadriform.points import Array
from quadriform.shapes.splines import TimeBasis

LOG_SEARCH_RADIUS = np.log(1e3)
"""The logarithm of the strength in time is sought within this distance of the last one."""
LOG_TOLERANCE = 0.5
"""The logarithm of the strength in time is found to within this tolerance."""


@dataclass(frozen=True)
class CycleSolution:
    """Displacements of the control points under one pair of strengths.

    Attributes:
        displacement: (K, k, 3), from the undeformed box, at the knots: the coefficients of the K splines.
        motions: (m,), the further unknowns.
        motion_matrix: (m, m), their matrix after elimination of the control points (the Schur complement): the
            precision of the motions times the square of the noise.
        sigma: standard deviation of the data along the normal.
        criterion: minus twice the log marginal likelihood, up to a constant.
    """

    displacement: Array
    motions: Array
    motion_matrix: Array
    sigma: float
    criterion: float


@dataclass(frozen=True)
class CyclePosterior:
    """The posterior distribution of all unknowns, by samples and by a covariance.

    Attributes:
        deviations: (n, K, k, 3), samples of the displacements at the knots, minus their mean.
        covariance: (m, m), of the further unknowns.
    """

    deviations: Array
    covariance: Array


class LinearCycleProblem:
    """The linear problem of one round as a function of its strengths, which are arguments of its methods.

    Args:
        equations: of the data, one for each frame.
        splines_at_frames: (F, K), values of the splines.
        basis: the splines.
        energy: of displacements.
        total_weight: N, the sum of the weights of the data points of all frames.
        bordered_block: for each further unknown its coupling to the control points of each frame, (m, F, 3 k);
            their own matrix (m, m) and right side (m,).
        effective_fraction: number of independent residuals over that of all.
        least_sigma: lower bound of the noise.
    """

    def __init__(
        self,
        equations: Sequence[NormalEquations],
        splines_at_frames: Array,
        basis: TimeBasis,
        energy: Energy,
        total_weight: float,
        bordered_block: tuple[Array, Array, Array] | None = None,
        effective_fraction: float = 1.0,
        least_sigma: float = 0.0,
    ) -> None:
        self.effective_fraction, self.least_sigma = effective_fraction, least_sigma
        self.total_weight = total_weight
        self.n_splines, self.size = splines_at_frames.shape[1], len(energy.mass)
        self.energy = energy
        # generalised eigenvectors V of the regulariser in time, which couples no two of them: V' T V = 1, T its mass
        self._time_mass = energy.time_mass(basis, splines_at_frames)
        tau, self._time_vectors = eigh(basis.bending(), self._time_mass)
        # eigenvalues that are rounding of zero are zero, so that the null space is exact. Where no motion is penalised,
        # all of them are rounding; those of motions that are penalised are above 100, with time in units of the period
        # or of the time that the knots cover
        self._tau = tau * (tau > ROUNDING * max(tau.max(), 1.0))
        self._rotated_splines = splines_at_frames @ self._time_vectors  # W
        self._of_energy = energy.right(self._rotated_splines)  # r
        self.matrix, self.right, self.constant = self._sums(equations)
        self._without_extra_terms: LinearCycleProblem | None = None  # None where there are none
        if bordered_block is not None:
            self._add_bordered_block(*bordered_block)

    def _sums(self, equations: Sequence[NormalEquations]) -> tuple[Array, Array, float]:
        """Matrix (K 3 k, K 3 k), right side and constant of all frames, in the coordinates of space and time."""
        # space first: each frame has the same basis
        rotated = [equation.in_basis(self.energy.basis) for equation in equations]
        matrix = _sum_over_frames(self._rotated_splines, np.stack([equation.matrix for equation in rotated]))
        right = (self._rotated_splines.T @ np.stack([equation.right for equation in rotated])).ravel()
        return matrix, right, sum(equation.constant for equation in equations)

    def _add_bordered_block(self, coupling: Array, own: Array, right: Array) -> None:
        """Append the further unknowns to matrix and right side."""
        # the coupling of unknown s with the control points: sum over f, j of W_fb B_jh C_sfji
        by_point = coupling.reshape(*coupling.shape[:2], self.size // 3, 3)
        rotated = np.einsum("sfji,jh->sfhi", by_point, self.energy.basis)
        across = np.einsum("fb,sfhi->bhis", self._rotated_splines, rotated).reshape(len(self.matrix), -1)
        self.matrix = np.block([[self.matrix, across], [across.T, own]])
        self.right = np.concatenate([self.right, right])

    def with_extra_terms(self, equations: Sequence[NormalEquations]) -> "LinearCycleProblem":
        """The problem with the equations of extra terms added to each frame, which are no part of the noise."""
        matrix, right, constant = self._sums(equations)
        other, size = copy(self), len(right)
        other._without_extra_terms = self._without_extra_terms or self
        other.matrix, other.right = self.matrix.copy(), self.right.copy()
        other.matrix[:size, :size] += matrix
        other.right[:size] += right
        other.constant = self.constant + constant
        return other

    def cost(self, displacement: Array, motions: Array, alpha: float, gamma: float) -> float:
        """The regularised sum of squares, with extra terms, at displacements (K, k, 3) and motions (m,)."""
        by_axis = np.einsum("hj,aji->ahi", self.energy.inverse, displacement.reshape(self.n_splines, -1, 3))
        # V' T is the inverse of V
        p = self._time_vectors.T @ self._time_mass @ by_axis.reshape(self.n_splines, -1)
        in_time = self._tau @ np.sum((p @ self.energy.mass) * p, axis=1)
        energy = alpha * self.energy.value(p, self._rotated_splines) + gamma * in_time
        q = np.concatenate([p.ravel(), motions])
        return float(q @ (self.matrix @ q) - 2 * self.right @ q + self.constant + self.total_weight * energy)

    def solve(self, alpha: float, gamma: float) -> CycleSolution | None:
        """The displacements and motions at one pair of strengths; None where they leave control points undetermined."""
        factor = cholesky_factor(self._regularised(alpha, gamma))
        if factor is None:
            return None
        right, constant = self._with_energy(alpha)
        found = cho_solve((factor, True), right, check_finite=False)
        size = self.n_splines * self.size
        displacement = self._displacements(self._time_vectors @ found[:size].reshape(self.n_splines, -1))
        null_dimension, determinant = self._prior_determinant(alpha, gamma)
        # the regularised sum of squares of the data over the residual degrees of freedom
        least, data = constant - float(right @ found), self._without_extra_terms
        least = data.cost(displacement, found[size:], alpha, gamma) if data else least
        estimate = least / max(self.total_weight - null_dimension, 1.0)
        variance = max(estimate, self.least_sigma**2, SELECTION.sigma_floor**2)
        effective_dof = max(self.effective_fraction * self.total_weight - null_dimension, 1.0)
        # minus twice the log marginal likelihood (REML). Its variance is that of the data without extra terms, while in
        # a single fit they count as data, for the search there needs the derivative. No strength depends on that: the
        # search in time (`best_in_time`) is made on a problem without extra terms
        criterion = (
            effective_dof * (np.log(variance) + estimate / variance) + 2 * np.log(np.diag(factor)).sum() - determinant
        )
        last = factor[size:, size:]  # the last block of a Cholesky factor is that of the Schur complement
        return CycleSolution(displacement, found[size:], last @ last.T, float(np.sqrt(variance)), float(criterion))

    def posterior(self, alpha: float, gamma: float, sigma: float, normal: Array) -> CyclePosterior | None:
        """The posterior of all unknowns at one pair of strengths; None where they leave control points undetermined.

        Its covariance is s^2 / f (T T')^-1, with f the effective fraction and T the Cholesky factor of the regularised
        matrix of all unknowns, extra terms included. A sample is s / sqrt(f) T^-T z with z ~ N(0, I); its part of the
        control points has the distribution in which the further unknowns are integrated out.

        Args:
            alpha, gamma: the strengths.
            sigma: s, of the data.
            normal: (n, 3 k K + m), a row of independent standard normal numbers for each sample.
        """
        factor = cholesky_factor(self._regularised(alpha, gamma))
        if factor is None:
            return None
        independent_sigma = sigma / np.sqrt(self.effective_fraction)
        size = self.n_splines * self.size
        samples = solve_triangular(factor, independent_sigma * normal.T, lower=True, trans=1, check_finite=False)
        found = samples[:size].reshape(self.n_splines, -1, len(normal))
        in_time = np.tensordot(self._time_vectors, found, 1)
        deviations = self._displacements(in_time.transpose(2, 0, 1))
        # the further unknowns are the last ones: the last block of T is the factor of their Schur complement
        half = solve_triangular(factor[size:, size:], np.eye(len(factor) - size), lower=True)
        return CyclePosterior(np.ascontiguousarray(deviations), independent_sigma**2 * half.T @ half)

    def _regularised(self, alpha: float, gamma: float) -> Array:
        """The matrix plus N (alpha R + gamma tau M) for each eigenvector in time, of eigenvalue tau."""
        matrix = self.matrix.copy()
        self.energy.add(matrix, self.total_weight * alpha, self._rotated_splines)
        for index, tau in enumerate(self._tau):
            block = slice(index * self.size, (index + 1) * self.size)
            matrix[block, block] += self.total_weight * gamma * tau * self.energy.mass
        return matrix

    def _with_energy(self, alpha: float) -> tuple[Array, float]:
        """Right side and constant with those of the energy."""
        right, factor = self.right.copy(), self.total_weight * alpha
        right[: len(self._of_energy)] += factor * self._of_energy
        return right, self.constant + factor * self.energy.constant

    def _displacements(self, coordinates: Array) -> Array:
        """The displacements (..., k, 3) of coordinates (..., 3 k) in space."""
        by_axis = coordinates.reshape(*coordinates.shape[:-1], -1, 3)
        return np.asarray(self.energy.basis @ by_axis, dtype=np.float64)

    def _prior_determinant(self, alpha: float, gamma: float) -> tuple[int, float]:
        """The dimension of what the regularisers leave undetermined, and the log determinant on all else."""
        count = self.total_weight
        found = sum(self.energy.log_determinant(count * alpha, count * gamma * tau) for tau in self._tau)
        null = sum(self._null_dimension(alpha, gamma * tau) for tau in self._tau)
        return null, found

    def _null_dimension(self, alpha: float, in_time: float) -> int:
        if in_time > 0:
            return 0
        return self.energy.null_dimension if alpha > 0 else self.size

    def best_in_time(self, alpha: float, gamma: float) -> float:
        """The strength in time with the largest marginal likelihood, near a given one.

        The strength in space stays that of single frames: over a whole cycle smoothness in time could replace it on the
        surface, but would not regularise the space inside.
        """

        def criterion(log_gamma: float) -> float:
            """The criterion at a strength in time; infinite where that determines nothing."""
            solution = self.solve(alpha, float(np.exp(log_gamma)))
            return np.inf if solution is None else solution.criterion

        if not self._tau.any():
            return gamma  # so few splines that no motion is penalised
        middle = np.log(gamma)
        bounds = middle - LOG_SEARCH_RADIUS, middle + LOG_SEARCH_RADIUS
        found = minimize_scalar(criterion, bounds=bounds, method="bounded", options={"xatol": LOG_TOLERANCE})
        return float(np.exp(found.x))


def _sum_over_frames(splines_at_frames: Array, matrices: Array) -> Array:
    """The sum over frames of (v_f v_f') kron A_f, (K n, K n), with splines v (F, K) and matrices A (F, n, n)."""
    frames, n_splines = splines_at_frames.shape
    n = matrices.shape[1]
    # frames enter by products of two splines, so the sum over frames is one product of matrices
    pairs = (splines_at_frames[:, :, None] * splines_at_frames[:, None, :]).reshape(frames, -1)
    blocks = (pairs.T @ matrices.reshape(frames, -1)).reshape(n_splines, n_splines, n, n)
    return blocks.transpose(0, 2, 1, 3).reshape(n_splines * n, n_splines * n)
