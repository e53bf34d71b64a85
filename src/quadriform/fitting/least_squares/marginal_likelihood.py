"""The strength of the regularisation and the noise of the data, by the marginal likelihood of the data (REML).

The model is r = J p + e, with e ~ N(0, s^2) and p ~ N(0, s^2 (lambda K)^+), flat on the null space of K: p are the
displacements P - P0 of the control points, J the stacked rows of the data, each times the root of its weight, and K the
regulariser, the same for each coordinate. So p minimises |J p - r|^2 + lambda p' K p, with A = J' J and lambda = alpha
n; alpha is the `strength`, per data point, and n the `count`. With f n independent residuals of n (f the
`effective_fraction`), d the dimension of the null space and m = f n - d, the criterion that the best strength minimises
is C = m log s^2 + log|A + lambda K| - rank K log lambda. The REML estimate of the noise is s^2 = (|J p - r|^2 + lambda
p' K p) / (n - d). The unit of length is the RMS radius of the points. All is solved in the eigenbasis of K, where
lambda adds to the diagonal alone: even for a very large one the data's part on the null space of K is not lost in
rounding.
"""

from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache

import numpy as np
from scipy.linalg import LinAlgError, cho_solve, cholesky, lapack, solve_triangular
from scipy.optimize import minimize_scalar

from quadriform.errors import DegenerateError, OptionError
from quadriform.fitting.least_squares.normal_equations import NormalEquations
from quadriform.points import Array


@dataclass(frozen=True)
class Selection:
    """The constants of the search for the strength; steps and tolerances are in its logarithm."""

    widest: tuple[float, float] = (1e-13, 1e3)
    """Range of strengths of the first search, in steps of a decade: from no regularisation to an affine map."""
    nearby: float = 30.0
    """A later search stays within this factor of the strength before it."""
    near: float = 0.1
    """Tolerance of the derivative-free minimisation. The root of the derivative is found from there, for rounding of
    the data may change the result of the minimisation by this much."""
    most_steps: int = 8
    """Secant steps to the root; where they do not converge, the minimum is sought without derivatives."""
    tolerance: float = 1e-6
    """Length of the last secant step to the root; what is left is of higher order."""
    round_tolerance: float = 0.03
    """The same within the rounds of a fit, of which each continues where the one before stopped."""
    flat: float = 0.02
    """Strengths are equally good where the derivative of the criterion by their logarithm is below this: for data that
    the null space of K fits, the criterion decreases for ever with the strength, and its derivative tends to zero."""
    noise_floor: float = 1e-9
    """Least standard deviation: the logarithm of the variance stays finite where a fit is exact."""
    null_space_weight: float = 1e-12
    """Added on the null space of K, relative to the largest diagonal entry of A: what no point determines there is
    zero."""


SELECTION = Selection()


@dataclass(frozen=True)
class Solution:
    """The displacements of the control points at one strength, with their uncertainty.

    Attributes:
        displacement: (k, 3).
        strength: alpha.
        noise: standard deviation of the residuals, the REML estimate.
        criterion: minus twice the log evidence, up to a constant; a further penalty enters like squares of the data,
            without a count or a normaliser.
        factor: lower Cholesky factor (3 k, 3 k) of A + lambda K in the eigenbasis of K.
        vectors: (k, k), the eigenvectors as columns, for one coordinate.
        effective_fraction: number of independent residuals over that of all, in (0, 1]; below 1 where neighbours are
            correlated.
        curvature: second derivative of the criterion by the logarithm of the strength; 0 where it was not computed.
    """

    displacement: Array
    strength: float
    noise: float
    criterion: float
    factor: Array
    vectors: Array
    effective_fraction: float = 1.0
    curvature: float = 0.0

    @property
    def independent_noise(self) -> float:
        """The noise at which n independent residuals would have the information of these: noise / sqrt(fraction)."""
        return float(self.noise / np.sqrt(self.effective_fraction))

    @property
    def condition(self) -> float:
        """LAPACK's estimate of the condition number of A + lambda K in the eigenbasis of K, with unit diagonal."""
        # scaled to unit diagonal first: units of the control points are no ill-conditioning
        scaled = self.factor / np.sqrt((self.factor**2).sum(axis=1))[:, None]
        largest = np.abs(scaled @ scaled.T).sum(axis=0).max()
        reciprocal, _ = lapack.dpocon(scaled, largest, uplo="L")
        return float(1 / max(reciprocal, np.finfo(float).tiny))

    def variance(self, rows: Array) -> Array:
        """Posterior variance of linear functions (n, 3 k) of the displacement, for independent residuals."""
        return self.noise**2 * (self._halved(rows) ** 2).sum(axis=0)

    def covariance(self) -> Array:
        """Posterior covariance (3 k, 3 k) of the control points, for independent residuals."""
        # by the factor, not by an inverse: the result stays symmetric and positive
        half = self._halved(np.eye(len(self.factor)))
        return self.noise**2 * half.T @ half

    def _halved(self, rows: Array) -> Array:
        """L^-1 times linear functions (n, 3 k), L the factor: squares of its columns sum up to variances over s^2."""
        rotated = np.einsum("nki,kj->jin", rows.reshape(len(rows), -1, 3), self.vectors, optimize=True)
        halved: Array = solve_triangular(self.factor, rotated.reshape(len(self.factor), -1), lower=True)
        return halved


@dataclass(frozen=True)
class Evidence:
    """The linear least-squares problem of one round, and its marginal likelihood as a function of the strength.

    Attributes:
        equations: of the data, and of penalties where there are any.
        penalty: (k, k), K of the regulariser for one coordinate.
        count: n, the sum of weight times inlier probability of the data points.
        effective_fraction: as in `Solution`.
        least_noise: lower bound of the standard deviation of the noise, as known from the measurement.
        data: the equations of the data alone; None where there is no penalty.
        values, vectors: of K.
        rank, null_dimension: of K for all coordinates.

    Raises:
        OptionError: K has negative eigenvalues.
    """

    equations: NormalEquations
    penalty: Array
    count: float
    effective_fraction: float = 1.0
    least_noise: float = 0.0
    data: NormalEquations | None = None
    values: Array = field(init=False)
    vectors: Array = field(init=False)
    rank: int = field(init=False)
    null_dimension: int = field(init=False)

    def __post_init__(self) -> None:
        values, vectors = spectrum(self.penalty.tobytes())
        rank = 3 * int(np.count_nonzero(values))
        found = dict(values=values, vectors=vectors, rank=rank, null_dimension=3 * len(values) - rank)
        for name, value in found.items():
            object.__setattr__(self, name, value)

    def plus(self, equations: NormalEquations) -> "Evidence":
        """The problem with the normal equations of a penalty added, which is no part of the noise."""
        return replace(self, equations=self.equations + equations, data=self.data or self.equations)

    def without(self, equations: NormalEquations, count: float) -> "Evidence":
        """The problem without some of the data, whose weights sum up to `count`."""
        data = None if self.data is None else self.data - equations
        return replace(self, equations=self.equations - equations, count=self.count - count, data=data)

    @cached_property
    def _whole(self) -> "Evidence":
        """The problem with penalties counted as data: its least value is what the displacement minimises.

        So the derivative of that value by the strength, through the displacement, is zero (envelope theorem).
        """
        return self if self.data is None else replace(self, data=None)

    @cached_property
    def _data(self) -> tuple[Array, Array]:
        """The data's matrix (3 k, 3 k) and right side (3 k,) in the eigenbasis of K."""
        rotated = self.equations.between(self.vectors)
        null = np.flatnonzero(np.repeat(self.values == 0, 3))
        rotated.matrix[null, null] += SELECTION.null_space_weight * np.abs(rotated.matrix.diagonal()).max()
        return rotated.matrix, rotated.right

    def cost(self, displacement: Array, strength: float) -> float:
        """The penalised sum of squares |J p - r|^2 + lambda p' K p at a displacement."""
        squares = (self.data or self.equations).squares(displacement)
        return squares + strength * self.count * self._energy(self.vectors.T @ displacement.reshape(-1, 3))

    def _energy(self, rotated: Array) -> float:
        """The regulariser's energy p' K p of displacements (k, 3) in the eigenbasis of K."""
        return float(self.values @ (rotated**2).sum(axis=1))

    @property
    def _freedom(self) -> tuple[float, float]:
        """Degrees of freedom of all residuals, and of the independent ones."""
        # REML with fewer degrees of freedom for correlated residuals; the noise is still estimated from all of them
        dof, effective = (max(part * self.count - self.null_dimension, 1.0) for part in (1.0, self.effective_fraction))
        return dof, effective

    def _variance(self, penalised_squares: float) -> float:
        """Variance of residuals with this sum of squares; with a lower bound, for the sum cancels in an exact fit."""
        return max(float(penalised_squares) / self._freedom[0], self.least_noise**2, SELECTION.noise_floor**2)

    def solve(self, strength: float) -> Solution | None:
        """The displacement at one strength; None where it leaves control points undetermined."""
        weight = strength * self.count
        matrix, right = self._data
        # in this basis the strength adds to the diagonal alone
        matrix = matrix + np.diag(weight * np.repeat(self.values, 3))
        factor = cholesky_factor(matrix)
        if factor is None:
            return None
        rotated = cho_solve((factor, True), right)
        displacement = self.vectors @ rotated.reshape(-1, 3)
        # what the displacement minimises, so with penalties; without forming residuals
        least = self.equations.constant - right @ rotated
        variance = self._variance(least)
        log_determinant = 2 * np.log(np.diag(factor)).sum()
        dof, effective_dof = self._freedom
        # minus twice the log of the likelihood with the control points integrated out (REML)
        squares = effective_dof * float(least) / dof / variance  # a constant unless the noise is at its lower bound
        criterion = (
            effective_dof * np.log(variance) + squares + log_determinant - self.rank * np.log(max(weight, 1e-300))
        )
        # the cost of a penalty is not part of the noise
        noise = float(np.sqrt(variance if self.data is None else self._variance(self.cost(displacement, strength))))
        return Solution(displacement, strength, noise, float(criterion), factor, self.vectors, self.effective_fraction)

    def select(self, strength: float | None, before: Solution | float | None) -> Solution:
        """The solution at a given strength; without one, or where it is undetermined, at that of largest evidence.

        Args:
            strength: alpha per data point, or None.
            before: the solution, or only the strength, of an earlier, similar problem, where there is one.

        Raises:
            DegenerateError: no strength determines the control points.
        """
        given = None if strength is None else self.solve(strength)
        if given is not None:
            return given
        return self.after(before) if isinstance(before, Solution) else self.best(before)

    def best(self, near: float | None = None) -> Solution:
        """The solution at the strength of the largest marginal likelihood.

        Args:
            near: the strength of an earlier, similar problem; without it, or where the criterion is flat there, the
                whole range is searched.

        Raises:
            DegenerateError: no strength determines the control points.
        """
        start = self._first() if near is None else near
        low, high = _nearby(start)
        x = float(np.clip(np.log(start), low, high))
        root = self._root(x, min(x + SELECTION.near, high), (low, high), SELECTION.tolerance)
        if root == (x, 0.0) and near is not None:
            return self.best()
        if root is None:
            x, reach = self._by_values(low, high), 3 * SELECTION.near
            root = self._root(x, x + SELECTION.near, (x - reach, x + reach), SELECTION.tolerance) or (x, 0.0)
        return self._determined(*root)

    def after(self, before: Solution) -> Solution:
        """The solution near the best strength, by one Newton step from the strength and curvature of the round before.

        The strength is found to within about `round_tolerance`; later rounds refine it.

        Raises:
            DegenerateError: no strength determines the control points.
        """
        x = float(np.log(before.strength))
        derivative = self._derivative(x)
        if before.curvature <= 0 or derivative is None:
            return self.best(before.strength)
        # one Newton step with the curvature of the round before: rounds differ little
        step = x - derivative / before.curvature
        root: tuple[float, float] | None = (step, before.curvature)
        if abs(step - x) >= SELECTION.round_tolerance:
            root = self._root(x, step, _nearby(before.strength), SELECTION.round_tolerance, derivative)
        return self.best(before.strength) if root is None else self._determined(*root)

    def _determined(self, x: float, curvature: float) -> Solution:
        """The solution at the logarithm of a strength, or at the nearest larger one that determines it."""
        for factor_of_strength in (1.0, *np.geomspace(10, SELECTION.widest[1] / SELECTION.widest[0], 16)):
            found = self.solve(float(factor_of_strength * np.exp(x)))
            if found is not None:
                return replace(found, curvature=curvature if factor_of_strength == 1 else 0.0)
        raise DegenerateError(
            "points: those with a weight do not determine the control points at any strength; expected a cloud with an "
            "extent in three dimensions that is not made of outliers alone"
        )

    def _first(self) -> float:
        """Where a first search begins: the least of the strengths, a decade apart, that are as good as the best."""
        # the criterion has flat ends, where a local search would stop: look at every decade first
        strengths = np.geomspace(*SELECTION.widest, 17)
        criteria = np.array([self._criterion(float(strength)) for strength in strengths])
        return float(strengths[np.argmax(criteria <= criteria.min() + SELECTION.flat / 2)])

    def _by_values(self, low: float, high: float) -> float:
        """The logarithm of the best strength between two logarithms, to within `near`."""
        with np.errstate(invalid="ignore"):  # a parabola through an infinite criterion: it halves instead
            found = minimize_scalar(
                lambda x: self._criterion(float(np.exp(x))),
                bounds=(low, high),
                method="bounded",
                options={"xatol": SELECTION.near},
            )
        return float(found.x)

    def _root(
        self, x0: float, x1: float, bounds: tuple[float, float], tolerance: float, derivative: float | None = None
    ) -> tuple[float, float] | None:
        """The minimum of the criterion by secant steps on its derivative, and the curvature there.

        (x0, 0.0) where the criterion is flat at both first points. None where a step leaves the bounds, the curvature
        is not positive, a strength leaves control points undetermined, or the steps do not converge.

        Args:
            x0, x1: first two logarithms of the strength.
            bounds: of the steps.
            tolerance: length of the last step.
            derivative: at x0, where it was computed already.
        """
        derivatives = self._derivative(x0) if derivative is None else derivative, self._derivative(x1)
        if all(each is not None and abs(each) < SELECTION.flat for each in derivatives):
            return x0, 0.0
        for _ in range(SELECTION.most_steps):
            if derivatives[0] is None or derivatives[1] is None:
                return None
            if (derivatives[1] - derivatives[0]) * (x1 - x0) <= 0:
                return None
            curvature = (derivatives[1] - derivatives[0]) / (x1 - x0)
            step = x1 - derivatives[1] / curvature
            if not bounds[0] <= step <= bounds[1]:
                return None
            if abs(step - x1) < tolerance:
                return step, curvature
            x0, x1, derivatives = x1, step, (derivatives[1], self._derivative(step))
        return None

    def _derivative(self, x: float) -> float | None:
        """Derivative of the criterion by the logarithm of the strength."""
        solution = self._whole.solve(float(np.exp(x)))
        if solution is None:
            return None
        weight = solution.strength * self.count
        dof, effective_dof = self._freedom
        penalised_squares = dof * solution.noise**2
        energy = self._energy(self.vectors.T @ solution.displacement)
        # d criterion / d log(lambda) = lambda (m p'Kp / penalised squares + tr K (A + lambda K)^-1) - rank K, m the
        # effective degrees of freedom; by the envelope theorem the derivative through p vanishes; the null space comes
        # first in the order of eigenvalues, and the strength does not act on it
        penalised = solution.factor[self.null_dimension :, self.null_dimension :]
        # with A + lambda K = L L' the diagonal of the inverse is the sum of squares of the columns of L^-1
        inverse = solve_triangular(penalised, np.eye(self.rank), lower=True)
        traced = np.repeat(self.values, 3)[self.null_dimension :] @ (inverse**2).sum(axis=0)
        return float(weight * (effective_dof * energy / penalised_squares + traced) - self.rank)

    def _criterion(self, strength: float) -> float:
        solution = self.solve(strength)
        return np.inf if solution is None else solution.criterion


def cholesky_factor(matrix: Array) -> Array | None:
    """The lower Cholesky factor of a matrix, which is overwritten; None where a pivot is lost in rounding."""
    diagonal = matrix.diagonal().copy()
    try:
        factor: Array = cholesky(matrix, lower=True, overwrite_a=True, check_finite=False)
    except LinAlgError:
        return None
    return factor if (factor.diagonal() ** 2 > len(matrix) * np.finfo(float).eps * diagonal).all() else None


def _nearby(strength: float) -> tuple[float, float]:
    """The range of a later search, in logarithms."""
    factor, (least, most) = SELECTION.nearby, SELECTION.widest
    low, high = np.log(np.clip([strength / factor, strength * factor], least, factor * most))
    return float(low), float(high)


@lru_cache(maxsize=4)
def spectrum(penalty: bytes) -> tuple[Array, Array]:
    """Eigenvalues (k,), those of what costs nothing exactly zero, and eigenvectors (k, k) of a penalty (k, k).

    Raises:
        OptionError: an eigenvalue is negative.
    """
    flat = np.frombuffer(penalty, dtype=np.float64)
    values, vectors = np.linalg.eigh(flat.reshape(int(np.sqrt(len(flat))), -1))
    least = 1e-10 * np.abs(values).max()
    if values[0] < -least:
        text = f"the smallest eigenvalue is {values[0] / values[-1]:.2g} of the largest"
        raise OptionError(f"regularity: its matrix must be positive semi-definite; {text}")
    return np.where(values > least, values, 0.0), vectors
