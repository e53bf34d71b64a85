"""The strength of the regularisation and the noise of the data, by the marginal likelihood of the data.

It is also called the evidence; for a linear model its maximisation is REML. A fit solves one linear problem in each of
its rounds (iterations), with the foot points and weights of that round.

The model is r = J p + e, with e ~ N(0, s^2) and p ~ N(0, s^2 (lambda K)^+), an improper uniform prior on the null space
of K. Symbols are those of docs/equations.md:

    p       (3 k,), the displacements P - P0 of the k control points from their undeformed positions
    r, J    the vectors from the undeformed surface to the data, and the data's rows of the deformation matrix, both
            multiplied by the root of each point's weight
    K       the matrix of the regulariser for all coordinates, (3 k, 3 k): kron(K1, I) with K1 (k, k), which is
            `regulariser_matrix`, and I (3, 3)
    A, b, c J' J, J' r and r' r, the normal equations of the data (`normal_equations.py`)
    N       the sum of the weights (`total_weight`)
    f       the fraction of the points that count as independent (`effective_fraction`)
    rho, nu the rank of K and the dimension of its null space (`rank`, `null_dimension`)
    lambda  alpha N, where alpha is the `strength`, per data point; `lam` in the code
    h(p)    extra quadratic terms that are no data: priors on surfaces beyond a base, the Jacobian penalty; mostly zero

At a given strength p minimises R(p) = |J p - r|^2 + lambda p' K p + h(p). Below, A includes the matrix of h. With R the
least value and m = f N - nu,

    s_h^2 = max(R / (N - nu), s_0^2), the REML estimate; s_0 is the known noise (`least_sigma`)
    L = m log s_h^2 + m R / ((N - nu) s_h^2) + log|A + lambda K| - rho log lambda

and the best strength minimises the criterion L, minus twice the log marginal likelihood up to a constant. The second
term is the constant m unless s_h is at its lower bound. The noise that is returned as `Solution.sigma` is s, without
the extra terms: s_h with R - h(p) in place of R. N counts each point once, for its distance along the normal: the small
tangential terms and the attractions of model points are in A, b and R, but are not counted as observations.

Correlated residuals: where only f N of N are independent, A, lambda and N count f times. This does not change p, and
L, up to a constant, only in m. The REML estimate of s^2 would be f R / (f N - nu); R / (N - nu), which all residuals
give, is taken instead, so that s^2 does not depend on f: it is smaller, by a factor between 1 - nu / (f N) and 1. So
f matters for the strength, by m, and for the posterior covariance of p, which is s^2 / f (A + lambda K)^-1; the methods
`variance` and `covariance` return s^2 (A + lambda K)^-1, that of independent residuals, WITHOUT 1 / f.

How the best strength is found, in a = log alpha: `best` looks at every decade (`_best_decade`), then seeks the root of
dL/da by secant steps (`_by_secants`), or, where these fail, the minimum of L without derivatives
(`_without_derivatives`) and from there the root. `best_after` takes a Newton step from the strength of the round
before; if it is not short it is the first of secant steps, and where these fail `best` follows. All solve the problem
at the minimum they found (`_at_minimum`). `solve` is at a given strength, and `solve_or_best` chooses between them.

The unit of length is the RMS radius of the points. All is solved in the eigenbasis of K1, where lambda adds to the
diagonal alone: even for a very large one the data's part on the null space of K is not lost in rounding.
"""

from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
from scipy.linalg import cho_solve, lapack, solve_triangular
from scipy.optimize import minimize_scalar

from quadriform.errors import DegenerateError
from quadriform.fitting.least_squares.factorisation import cholesky_factor, condition_number, spectrum
from quadriform.fitting.least_squares.normal_equations import NormalEquations
from quadriform.fitting.least_squares.selection import SELECTION
from quadriform.points import Array


class Minimum(NamedTuple):
    """A minimum of the criterion.

    Attributes:
        log_strength: the logarithm of the strength.
        curvature: second derivative of the criterion by it; 0 where it is not known.
        is_flat: the criterion is flat there, and the strength that of the start of the search.
    """

    log_strength: float
    curvature: float = 0.0
    is_flat: bool = False


@dataclass(frozen=True)
class Solution:
    """The displacements of the control points at one strength, with their uncertainty.

    Attributes:
        displacement: (k, 3).
        strength: alpha.
        sigma: s, the standard deviation of the residuals of the data.
        criterion: L, minus twice the log marginal likelihood up to a constant.
        factor: lower Cholesky factor T (3 k, 3 k) of A + lambda K in the eigenbasis of K1.
        eigenvectors: (k, k), of K1, as columns.
        effective_fraction: number of independent residuals over that of all, in (0, 1]; below 1 where neighbours are
            correlated.
        criterion_curvature: second derivative of the criterion by the logarithm of the strength; 0 where it was not
            computed.
    """

    displacement: Array
    strength: float
    sigma: float
    criterion: float
    factor: Array
    eigenvectors: Array
    effective_fraction: float = 1.0
    criterion_curvature: float = 0.0

    @property
    def independent_sigma(self) -> float:
        """The noise at which n independent residuals would have the information of these: sigma / sqrt(fraction)."""
        return float(self.sigma / np.sqrt(self.effective_fraction))

    @property
    def condition(self) -> float:
        """LAPACK's estimate of the condition number of A + lambda K in the eigenbasis of K1, with unit diagonal."""
        return condition_number(self.factor)

    def variance(self, rows: Array) -> Array:
        """Posterior variance of linear functions (n, 3 k) of the displacement if all residuals are independent."""
        return self.sigma**2 * (self._halved(rows) ** 2).sum(axis=0)

    def covariance(self) -> Array:
        """Posterior covariance (3 k, 3 k) of the control points if all residuals are independent.

        It is s^2 (A + lambda K)^-1; with correlated residuals it would be divided by `effective_fraction`.
        """
        # by the factor, not by an inverse: the result stays symmetric and positive
        half = self._halved(np.eye(len(self.factor)))
        return self.sigma**2 * half.T @ half

    def _halved(self, rows: Array) -> Array:
        """T^-1 V' (3 k, n) of linear functions V (n, 3 k), T the factor; its columns squared sum up to variance / s^2.

        For V (T T')^-1 V' = (T^-1 V')' (T^-1 V').
        """
        rotated = np.einsum("nki,kj->jin", rows.reshape(len(rows), -1, 3), self.eigenvectors, optimize=True)
        halved: Array = solve_triangular(self.factor, rotated.reshape(len(self.factor), -1), lower=True)
        return halved


@dataclass(frozen=True)
class LinearProblem:
    """The linear least-squares problem of one round as a function of the strength, and its marginal likelihood.

    Attributes:
        data: normal equations of the data.
        regulariser_matrix: K1 (k, k).
        total_weight: N, the sum of weight times inlier probability of the data points; the weights of a cloud have mean
            one, so it is a number of points.
        effective_fraction: f, as in `Solution`.
        least_sigma: s_0, the standard deviation of the noise that is known from the measurement, a lower bound of s.
        with_extra: the sum of `data` and of the extra terms h(p); None where there are none.
        eigenvalues, eigenvectors: of K1.
        rank, null_dimension: rho and nu, of K: three times those of K1.

    Raises:
        OptionError: K1 has negative eigenvalues.
    """

    data: NormalEquations
    regulariser_matrix: Array
    total_weight: float
    effective_fraction: float = 1.0
    least_sigma: float = 0.0
    with_extra: NormalEquations | None = None
    eigenvalues: Array = field(init=False)
    eigenvectors: Array = field(init=False)
    rank: int = field(init=False)
    null_dimension: int = field(init=False)

    def __post_init__(self) -> None:
        values, vectors = spectrum(self.regulariser_matrix.tobytes())
        rank = 3 * int(np.count_nonzero(values))
        found = dict(eigenvalues=values, eigenvectors=vectors, rank=rank, null_dimension=3 * len(values) - rank)
        for name, value in found.items():
            object.__setattr__(self, name, value)

    @property
    def equations(self) -> NormalEquations:
        """The normal equations of all terms but the regulariser: of data and extra terms."""
        return self.data if self.with_extra is None else self.with_extra

    def with_extra_terms(self, equations: NormalEquations) -> "LinearProblem":
        """The problem with the normal equations of an extra term added."""
        return replace(self, with_extra=self.equations + equations)

    def without_points(self, equations: NormalEquations, total_weight: float) -> "LinearProblem":
        """The problem without the equations of some of the data points, whose weights sum up to `total_weight`."""
        with_extra = None if self.with_extra is None else self.with_extra - equations
        left = self.total_weight - total_weight
        return replace(self, data=self.data - equations, total_weight=left, with_extra=with_extra)

    @cached_property
    def _all_as_data(self) -> "LinearProblem":
        """The problem in which the extra terms count as data, so that its sigma is the s_h of the criterion."""
        return self if self.with_extra is None else replace(self, data=self.with_extra, with_extra=None)

    @cached_property
    def _in_eigenbasis(self) -> tuple[Array, Array]:
        """Matrix (3 k, 3 k), in the order of LAPACK, and right side (3 k,) of `equations` in the eigenbasis of K1."""
        rotated = self.equations.in_basis(self.eigenvectors)
        null = np.flatnonzero(np.repeat(self.eigenvalues == 0, 3))
        rotated.matrix[null, null] += SELECTION.null_space_weight * np.abs(rotated.matrix.diagonal()).max()
        return np.asfortranarray(rotated.matrix), rotated.right

    def cost(self, displacement: Array, strength: float) -> float:
        """The regularised sum of squares of the data, |J p - r|^2 + lambda p' K p, at a displacement."""
        energy = self._energy(self.eigenvectors.T @ displacement.reshape(-1, 3))
        return self.data.squares(displacement) + strength * self.total_weight * energy

    def _energy(self, rotated: Array) -> float:
        """The regulariser's energy p' K p of displacements (k, 3) in the eigenbasis of K1."""
        return float(self.eigenvalues @ (rotated**2).sum(axis=1))

    @property
    def _freedom(self) -> tuple[float, float]:
        """Degrees of freedom of all residuals, N - nu, and m = f N - nu, each at least one."""
        total, nu = self.total_weight, self.null_dimension
        return max(total - nu, 1.0), max(self.effective_fraction * total - nu, 1.0)

    def _variance(self, cost: float) -> float:
        """Variance of residuals with this regularised sum of squares; bounded, for it cancels in an exact fit."""
        return max(float(cost) / self._freedom[0], self.least_sigma**2, SELECTION.sigma_floor**2)

    def solve(self, strength: float) -> Solution | None:
        """The displacement at one strength; None where it leaves control points undetermined."""
        lam = strength * self.total_weight
        matrix, right = self._in_eigenbasis
        matrix, diagonal = matrix.copy(order="F"), np.arange(len(matrix))
        # in this basis the strength adds to the diagonal alone
        matrix[diagonal, diagonal] += lam * np.repeat(self.eigenvalues, 3)
        factor = cholesky_factor(matrix)
        if factor is None:
            return None
        rotated = cho_solve((factor, True), right)
        displacement = self.eigenvectors @ rotated.reshape(-1, 3)
        # R = c - b' p at its minimum, without forming residuals
        least = self.equations.constant - right @ rotated
        variance = self._variance(least)
        log_determinant = 2 * np.log(np.diag(factor)).sum()
        dof, effective_dof = self._freedom
        exponent = effective_dof * float(least) / dof / variance
        criterion = effective_dof * np.log(variance) + exponent + log_determinant - self.rank * np.log(max(lam, 1e-300))
        if self.with_extra is not None:
            variance = self._variance(self.cost(displacement, strength))
        sigma, vectors = float(np.sqrt(variance)), self.eigenvectors
        return Solution(displacement, strength, sigma, float(criterion), factor, vectors, self.effective_fraction)

    def solve_or_best(self, strength: float | None, previous: Solution | None) -> Solution:
        """The solution at a given strength, or at the best one where none is given or it leaves points undetermined.

        The strength of the solution shows which of them it is: it is exactly the given one, or another.

        Args:
            strength: alpha per data point, or None.
            previous: the solution of an earlier, similar problem, where there is one.

        Raises:
            DegenerateError: no strength determines the control points.
        """
        given = None if strength is None else self.solve(strength)
        if given is not None:
            return given
        return self.best() if previous is None else self.best_after(previous)

    def best(self, start: float | None = None) -> Solution:
        """The solution at the strength of the largest marginal likelihood.

        Args:
            start: the strength of an earlier, similar problem; without it, or where the criterion is flat there, the
                whole range is searched.

        Raises:
            DegenerateError: no strength determines the control points.
        """
        first = self._best_decade() if start is None else start
        low, high = _search_range(first)
        a = float(np.clip(np.log(first), low, high))
        coarse = SELECTION.coarse_tolerance
        found = self._by_secants(a, min(a + coarse, high), (low, high), SELECTION.tolerance)
        if found is not None and found.is_flat and start is not None:
            return self.best()
        if found is None:
            a = self._without_derivatives(low, high)
            bounds = a - 3 * coarse, a + 3 * coarse
            found = self._by_secants(a, a + coarse, bounds, SELECTION.tolerance) or Minimum(a)
        return self._at_minimum(found)

    def best_after(self, previous: Solution) -> Solution:
        """The solution near the best strength, by a Newton step from the strength of the round before.

        A step above `iteration_tolerance` is followed by secant steps until one is below it; later rounds refine the
        strength. Where it is not found in this manner, `best` searches for it.

        Raises:
            DegenerateError: no strength determines the control points.
        """
        a = float(np.log(previous.strength))
        derivative = self._derivative(a)
        if previous.criterion_curvature <= 0 or derivative is None:
            return self.best(previous.strength)
        # the second derivative is that of the round before: rounds differ little
        a_after = a - derivative / previous.criterion_curvature
        found: Minimum | None = Minimum(a_after, previous.criterion_curvature)
        if abs(a_after - a) >= SELECTION.iteration_tolerance:
            bounds = _search_range(previous.strength)
            found = self._by_secants(a, a_after, bounds, SELECTION.iteration_tolerance, derivative)
        return self.best(previous.strength) if found is None else self._at_minimum(found)

    def _at_minimum(self, minimum: Minimum) -> Solution:
        """The solution at a minimum, or at the nearest larger strength that determines the control points."""
        for factor in (1.0, *np.geomspace(10, SELECTION.widest[1] / SELECTION.widest[0], 16)):
            found = self.solve(float(factor * np.exp(minimum.log_strength)))
            if found is not None:
                return replace(found, criterion_curvature=minimum.curvature if factor == 1 else 0.0)
        raise DegenerateError(
            "points: those with a weight do not determine the control points at any strength; expected a cloud with an "
            "extent in three dimensions that is not made of outliers alone"
        )

    def _best_decade(self) -> float:
        """Where a first search begins: the least of the strengths, a decade apart, that are as good as the best."""
        # the criterion has flat ends, where a local search would stop: look at every decade first
        strengths = np.geomspace(*SELECTION.widest, 17)
        criteria = np.array([self._criterion(float(strength)) for strength in strengths])
        return float(strengths[np.argmax(criteria <= criteria.min() + SELECTION.equal_criteria)])

    def _without_derivatives(self, low: float, high: float) -> float:
        """The logarithm of the best strength between two logarithms, to within `coarse_tolerance`."""
        with np.errstate(invalid="ignore"):  # a parabola through an infinite criterion: it halves instead
            found = minimize_scalar(
                lambda a: self._criterion(float(np.exp(a))),
                bounds=(low, high),
                method="bounded",
                options={"xatol": SELECTION.coarse_tolerance},
            )
        return float(found.x)

    def _by_secants(
        self, a0: float, a1: float, bounds: tuple[float, float], tolerance: float, derivative: float | None = None
    ) -> Minimum | None:
        """The minimum of the criterion by secant steps to the root of its derivative.

        Where the criterion is flat at a0 and at a1, the minimum is a0, marked as flat. None where a step leaves the
        bounds, the curvature is not positive, a strength leaves control points undetermined, or the steps do not
        converge.

        Args:
            a0, a1: first two logarithms of the strength.
            bounds: of the logarithms that the steps reach.
            tolerance: length of the last step.
            derivative: at a0, where it was computed already.
        """
        derivatives = self._derivative(a0) if derivative is None else derivative, self._derivative(a1)
        if all(each is not None and abs(each) < SELECTION.flat_derivative for each in derivatives):
            return Minimum(a0, is_flat=True)
        for _ in range(SELECTION.most_steps):
            if derivatives[0] is None or derivatives[1] is None:
                return None
            if (derivatives[1] - derivatives[0]) * (a1 - a0) <= 0:
                return None
            curvature = (derivatives[1] - derivatives[0]) / (a1 - a0)
            a_after = a1 - derivatives[1] / curvature
            if not bounds[0] <= a_after <= bounds[1]:
                return None
            if abs(a_after - a1) < tolerance:
                return Minimum(a_after, curvature)
            a0, a1, derivatives = a1, a_after, (derivatives[1], self._derivative(a_after))
        return None

    def _derivative(self, a: float) -> float | None:
        """dL/da, the derivative of the criterion by the logarithm of the strength; None where undetermined.

        dL/da = lambda (m p' K p / ((N - nu) s_h^2) + tr K (A + lambda K)^-1) - rho. The derivative through p is zero,
        since p minimises R (envelope theorem).
        """
        solution = self._all_as_data.solve(float(np.exp(a)))
        if solution is None:
            return None
        lam = solution.strength * self.total_weight
        dof, effective_dof = self._freedom
        bounded_cost = dof * solution.sigma**2  # (N - nu) s_h^2, which is R unless s_h is at its bound
        energy = self._energy(self.eigenvectors.T @ solution.displacement)
        # the null space comes first in the order of eigenvalues, and the strength does not act on it
        regularised = solution.factor[self.null_dimension :, self.null_dimension :]
        # with A + lambda K = T T' the diagonal of the inverse is the sum of squares of the columns of T^-1
        inverse, _ = lapack.dtrtri(regularised, lower=1)
        traced = np.repeat(self.eigenvalues, 3)[self.null_dimension :] @ (inverse**2).sum(axis=0)
        return float(lam * (effective_dof * energy / bounded_cost + traced) - self.rank)

    def _criterion(self, strength: float) -> float:
        solution = self.solve(strength)
        return np.inf if solution is None else solution.criterion


def _search_range(start: float) -> tuple[float, float]:
    """The range of a search from a strength, in logarithms."""
    factor, (least, most) = SELECTION.search_factor, SELECTION.widest
    low, high = np.log(np.clip([start / factor, start * factor], least, factor * most))
    return float(low), float(high)
