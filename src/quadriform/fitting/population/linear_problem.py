"""The linear problem of one round of a fit with a prior, and the weights of the prior by the marginal likelihood.

Symbols are those of `coordinates.py` and of `least_squares/marginal_likelihood.py`, whose model this is with another
regulariser. In the coordinates y, with A, b, c the normal equations of the data, y minimises

    R(y) = c - 2 b' y + y' A y + lambda y' (I - U diag(w) U') y,      lambda = alpha N = s^2 / (f phi)

and the criterion, minus twice the log marginal likelihood up to a constant, is

    L = m log s_h^2 + m R / ((N - nu) s_h^2) + log|A + lambda (I - U diag(w) U')|
        - (3 k - nu) log lambda + sum_j log(1 + rho s_j^2)

with nu the number of rigid motions. It has two unknowns, lambda and rho. With the eigenvalues d and eigenvectors V of A
and Woodbury's identity a value of L takes products of the small matrix V' U alone:

    log|A + lambda (I - U diag(w) U')| = sum log(d + lambda) + log|S|,
    b' (A + ...)^-1 b = sum (V'b)^2 / (d + lambda) + lambda t' S^-1 t,
    S = I - diag(w) + diag(w)^(1/2) U' V diag(d / (d + lambda)) V' U diag(w)^(1/2),
    t = diag(w)^(1/2) U' V diag(1 / (d + lambda)) V' b.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.linalg import cho_solve
from scipy.optimize import minimize

from quadriform.errors import DegenerateError
from quadriform.fitting.least_squares.factorisation import cholesky_factor
from quadriform.fitting.least_squares.marginal_likelihood import Solution
from quadriform.fitting.least_squares.normal_equations import NormalEquations
from quadriform.fitting.least_squares.selection import SELECTION
from quadriform.fitting.population.coordinates import PriorCoordinates
from quadriform.points import Array


@dataclass(frozen=True)
class PriorSelection:
    """The constants of the search for the weights of a prior; steps and tolerances are in their logarithms."""

    widest: tuple[float, float] = (1e-13, 1e2)
    """Range of strengths; at the last one a displacement outside of the modes is a hundredth of what the data asks."""
    ratios: tuple[float, float] = (1e-3, 1e12)
    """Range of rho times the variance of the first mode: from no use of the modes to shapes of the modes alone."""
    step: float = 1.0
    """In decades, of the first search over both weights."""
    first_simplex: float = 0.5
    """Size of the simplex with which a search begins (method of Nelder and Mead)."""
    tolerance: float = 0.02
    """Of the logarithms; the criterion is flat at its minimum, and the next round continues from there."""
    criterion_tolerance: float = 1e-3


PRIOR_SELECTION = PriorSelection()


@dataclass(frozen=True)
class PriorSolution(Solution):
    """A solution with a prior.

    Attributes:
        ratio: rho, the variance of the modes relative to the freedom outside of them.
    """

    ratio: float = 1.0


@dataclass(frozen=True)
class PriorProblem:
    """The linear problem with a prior as a function of the strength alpha, and of the ratio rho.

    Attributes:
        data: normal equations of the data, in the displacements of the control points.
        prior: the prior in its coordinates.
        total_weight: N.
        effective_fraction: f.
        least_sigma: lower bound of s.
        ratio: rho, where it is not estimated.
        with_extra: the sum of `data` and extra terms that are no data; None where there are none.
    """

    data: NormalEquations
    prior: PriorCoordinates
    total_weight: float
    effective_fraction: float
    least_sigma: float
    ratio: float | None = None
    with_extra: NormalEquations | None = None

    def with_extra_terms(self, equations: NormalEquations) -> PriorProblem:
        """The problem with the normal equations of an extra term added."""
        return replace(self, with_extra=(self.data if self.with_extra is None else self.with_extra) + equations)

    def without_points(self, equations: NormalEquations, total_weight: float) -> PriorProblem:
        """The problem without the equations of some of the data points, whose weights sum up to `total_weight`."""
        with_extra = None if self.with_extra is None else self.with_extra - equations
        left = self.total_weight - total_weight
        return replace(self, data=self.data - equations, total_weight=left, with_extra=with_extra)

    @cached_property
    def _in_coordinates(self) -> NormalEquations:
        """The equations of data and extra terms in the coordinates y."""
        of = self.data if self.with_extra is None else self.with_extra
        return of.about(self.prior.mean).in_basis(self.prior.basis)

    @property
    def regulariser_matrix(self) -> Array:
        """The matrix B + G (k, k) of the freedom outside of the modes."""
        return np.asarray(self.prior.root @ self.prior.root.T, dtype=np.float64)

    @cached_property
    def criterion(self) -> Criterion:
        """The criterion as a function of the weights."""
        return Criterion.of(self._in_coordinates, self)

    def cost(self, displacement: Array, strength: float) -> float:
        """The sum of squares of the data, and of the prior at a strength, at displacements (k, 3)."""
        y, weights = self.prior.of_displacement(displacement), self.prior.weights(self._given_ratio)
        energy = float(y @ y - weights @ (self.prior.directions.T @ y) ** 2)
        return self.data.squares(displacement) + strength * self.total_weight * energy

    @property
    def _given_ratio(self) -> float:
        return 1.0 if self.ratio is None else self.ratio

    def solve(self, strength: float) -> PriorSolution | None:
        """The displacements at one strength and the given ratio; None where they are not determined."""
        lam, equations, prior = strength * self.total_weight, self._in_coordinates, self.prior
        scaled = prior.directions * np.sqrt(prior.weights(self._given_ratio))
        matrix = equations.matrix - lam * scaled @ scaled.T
        matrix[np.diag_indices(len(matrix))] += lam
        factor = cholesky_factor(np.asfortranarray((matrix + matrix.T) / 2))
        if factor is None:
            return None
        y = cho_solve((factor, True), equations.right)
        displacement = prior.displacement(y)
        # of the data alone: extra terms are no part of the noise
        least = equations.constant - float(equations.right @ y)
        least = least if self.with_extra is None else self.cost(displacement, strength)
        dof = max(self.total_weight - prior.n_rigid, 1.0)
        sigma = np.sqrt(max(least / dof, self.least_sigma**2, SELECTION.sigma_floor**2))
        determinant = 2 * float(np.log(np.diag(factor)).sum())
        value = self.criterion_of(equations.constant - float(equations.right @ y), determinant, lam, self._given_ratio)
        fraction = self.effective_fraction
        found = PriorSolution(displacement, strength, float(sigma), value, factor, prior.basis, fraction)
        return replace(found, ratio=self._given_ratio)

    def criterion_of(self, least: float, log_determinant: float, lam: float, ratio: float) -> float:
        """The criterion L from the minimum of R and the logarithm of the determinant of its matrix."""
        nu = self.prior.n_rigid
        dof, effective = (max(part * self.total_weight - nu, 1.0) for part in (1.0, self.effective_fraction))
        variance = max(least / dof, self.least_sigma**2, SELECTION.sigma_floor**2)
        of_prior = (self.prior.mean.size - nu) * np.log(lam) - np.log1p(ratio * self.prior.squares).sum()
        return float(effective * (np.log(variance) + least / dof / variance) + log_determinant - of_prior)

    def best(self, start: float | None = None) -> PriorSolution:
        """The solution at the weights of the largest marginal likelihood; at a given ratio at the strength of it.

        Args:
            start: a strength near which it is sought, with a given ratio; None for a search over all.

        Raises:
            DegenerateError: no weights determine the control points.
        """
        strength, ratio = self.criterion.minimum(self.ratio, start)
        found = replace(self, ratio=ratio).solve(strength)
        if found is None:
            raise DegenerateError(
                "points: those with a weight do not determine the pose of the prior; expected points around the body"
            )
        return found

    def solve_or_best(self, strength: float | None, previous: Solution | None) -> PriorSolution:
        """The solution at a given strength, or at the best weights, near those of an earlier problem.

        Raises:
            DegenerateError: no weights determine the control points.
        """
        given = None if strength is None else self.solve(strength)
        if given is not None:
            return given
        if not isinstance(previous, PriorSolution):
            return self.best()
        weights = self.criterion.refined(np.log(previous.strength), np.log(previous.ratio))
        found = replace(self, ratio=weights[1]).solve(weights[0])
        return self.best() if found is None else found


@dataclass(frozen=True)
class Criterion:
    """The criterion L as a function of the logarithms of alpha and rho.

    Attributes:
        values: (3 k,), the eigenvalues d of A.
        right: (3 k,), V' b.
        constant: c.
        along: (3 k, q), V' U.
        problem: of these equations.
    """

    values: Array
    right: Array
    constant: float
    along: Array
    problem: PriorProblem

    @classmethod
    def of(cls, equations: NormalEquations, problem: PriorProblem) -> Criterion:
        """From normal equations in the coordinates y."""
        values, vectors = np.linalg.eigh(equations.matrix)
        return cls(
            np.maximum(values, 0.0),
            vectors.T @ equations.right,
            equations.constant,
            vectors.T @ problem.prior.directions,
            problem,
        )

    def __call__(self, log_strength: float, log_ratio: float) -> float:
        """The criterion; infinite where the control points are not determined."""
        lam, ratio = float(np.exp(log_strength)) * self.problem.total_weight, float(np.exp(log_ratio))
        root = np.sqrt(self.problem.prior.weights(ratio))
        inverse = 1 / (self.values + lam)
        scaled = self.along * root
        small = np.diag(1 - root**2) + scaled.T @ ((self.values * inverse)[:, None] * scaled)
        factor = cholesky_factor(np.asfortranarray(small))
        if factor is None:
            return float(np.inf)
        t = scaled.T @ (inverse * self.right)
        explained = float(inverse @ self.right**2 + lam * t @ cho_solve((factor, True), t))
        determinant = -np.log(inverse).sum() + 2 * np.log(np.diag(factor)).sum()
        return self.problem.criterion_of(self.constant - explained, float(determinant), lam, ratio)

    def minimum(self, ratio: float | None, near: float | None = None) -> tuple[float, float]:
        """The strength and the ratio of the least criterion; of a given ratio the strength."""
        decades = np.log(10) * PRIOR_SELECTION.step
        low, high = np.log(PRIOR_SELECTION.widest)
        strengths = np.arange(low, high + decades / 2, decades) if near is None else [np.log(near)]
        least, most = (np.log(each / self.problem.prior.squares[0]) for each in PRIOR_SELECTION.ratios)
        ratios = np.arange(least, most + decades / 2, decades) if ratio is None else [np.log(ratio)]
        found = np.array([[self(a, r) for r in ratios] for a in strengths])
        first, second = np.unravel_index(int(found.argmin()), found.shape)
        return self.refined(float(strengths[first]), float(ratios[second]), fixed_ratio=ratio is not None)

    def refined(self, log_strength: float, log_ratio: float, fixed_ratio: bool = False) -> tuple[float, float]:
        """The strength and the ratio of the least criterion near given logarithms of both."""
        bounds = (
            np.log(PRIOR_SELECTION.widest),
            np.log(np.array(PRIOR_SELECTION.ratios) / self.problem.prior.squares[0]),
        )

        def value(weights: Array) -> float:
            """The criterion within the bounds."""
            ratio = log_ratio if fixed_ratio else np.clip(weights[-1], *bounds[1])
            return self(float(np.clip(weights[0], *bounds[0])), float(ratio))

        start = np.array([log_strength] if fixed_ratio else [log_strength, log_ratio])
        simplex = start + PRIOR_SELECTION.first_simplex * np.vstack([np.zeros(len(start)), np.eye(len(start))])
        tolerances = {"xatol": PRIOR_SELECTION.tolerance, "fatol": PRIOR_SELECTION.criterion_tolerance}
        found = minimize(value, start, method="Nelder-Mead", options={"initial_simplex": simplex, **tolerances}).x
        ratio = log_ratio if fixed_ratio else float(np.clip(found[-1], *bounds[1]))
        return float(np.exp(np.clip(found[0], *bounds[0]))), float(np.exp(ratio))
