"""The strength of the regularisation and the noise of the data, both by the evidence of the data itself (REML).

Everything is solved in the eigenvectors of the regulariser. There the strength adds to the diagonal alone, so that even
a very large one leaves the digits of the displacements that the regulariser does not penalise.
"""

from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache

import numpy as np
from scipy.linalg import LinAlgError, cho_solve, cholesky, lapack, solve_triangular
from scipy.optimize import minimize_scalar

from quadriform.errors import DegenerateError, OptionError
from quadriform.fitting.least_squares.normal_equations import NormalEquations
from quadriform.points import Array

WIDEST = (1e-13, 1e3)
"""Strengths per data point that a first search looks through, in steps of a decade."""
NEARBY = 30.0
"""A later search stays within this factor of the strength before it."""
NEAR = 0.1
"""Of the logarithm of the strength: how near a search by values comes. From there the slope's root is found, for a
search by values alone jumps by as much as it may when data differ by rounding."""
STEPS, ROUNDING = 8, 1e-6
"""At most so many secant steps to the root, until one is shorter than that; what is left then is its square."""
BESIDE = 0.03
"""From round to round a step that is shorter than this will do: the rounds that follow shorten it."""
FLAT = 0.02
"""A criterion that changes by less than this per unit of the logarithm does not distinguish strengths: the evidence of
data without any sign of bending grows with the regularisation, down to the rounding of the criterion."""
NOISE_FLOOR = 1e-9
"""Of the cloud's RMS radius: no data is more exact than that."""
NULL_SPACE_WEIGHT = 1e-12
"""Weight, relative to the data's largest, that keeps displacements free of cost at zero where no point determines
them."""


@dataclass(frozen=True)
class Solution:
    """Control points' displacement under one strength, and how sure it is; lengths in the frame of the data.

    Attributes:
        displacement: (k, 3).
        strength: alpha, per data point.
        noise: standard deviation of the data along the normal.
        criterion: minus twice the log evidence, up to a constant.
        factor: lower Cholesky factor (3 k, 3 k) of A + lambda K between the eigenvectors of K.
        vectors: (k, k), these eigenvectors as columns, for one coordinate.
        effective_fraction: how many independent points each point was taken for.
        curvature: second derivative of the criterion by the logarithm of the strength, where it was sought.
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
        """The noise at which as many independent points would determine no more than these do."""
        return float(self.noise / np.sqrt(self.effective_fraction))

    @property
    def condition(self) -> float:
        """Condition in the 1-norm of A + lambda K with its diagonal scaled to one: the precision that is lost."""
        # scaled to unit diagonal first: units of the control points are no ill-conditioning
        scaled = self.factor / np.sqrt((self.factor**2).sum(axis=1))[:, None]
        largest = np.abs(scaled @ scaled.T).sum(axis=0).max()
        reciprocal, _ = lapack.dpocon(scaled, largest, uplo="L")
        return float(1 / max(reciprocal, np.finfo(float).tiny))

    def variance(self, rows: Array) -> Array:
        """Posterior variance of linear functions (n, 3 k) of the displacement."""
        return self.noise**2 * (self._halved(rows) ** 2).sum(axis=0)

    def covariance(self) -> Array:
        """Posterior covariance (3 k, 3 k) of the control points."""
        # by the factor, not by an inverse: the result stays symmetric and positive
        half = self._halved(np.eye(len(self.factor)))
        return self.noise**2 * half.T @ half

    def _halved(self, rows: Array) -> Array:
        """Columns (3 k, n) whose squares sum up to the variances of linear functions for noise one."""
        rotated = np.einsum("nki,kj->jin", rows.reshape(len(rows), -1, 3), self.vectors, optimize=True)
        halved: Array = solve_triangular(self.factor, rotated.reshape(len(self.factor), -1), lower=True)
        return halved


@dataclass(frozen=True)
class Evidence:
    """The linearised problem seen as a function of the strength.

    Attributes:
        equations: of the data, and of penalties where there are any.
        penalty: (k, k), K of the regulariser for one coordinate.
        count: number of residual rows, the sum of the weights.
        effective_fraction: of them, as independent points.
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

    @cached_property
    def _data(self) -> tuple[Array, Array]:
        """The data's matrix (3 k, 3 k) and right side (3 k,) between the eigenvectors of the regulariser."""
        rotated = self.equations.between(self.vectors)
        null = np.flatnonzero(np.repeat(self.values == 0, 3))
        rotated.matrix[null, null] += NULL_SPACE_WEIGHT * np.abs(rotated.matrix.diagonal()).max()
        return rotated.matrix, rotated.right

    def cost(self, displacement: Array, strength: float) -> float:
        """The sum at a displacement: squares of the data's residuals, and the regulariser's part."""
        p, data = displacement.ravel(), self.data or self.equations
        squares = float(p @ (data.matrix @ p) - 2 * data.right @ p + data.constant)
        return squares + strength * self.count * self._energy(self.vectors.T @ p.reshape(-1, 3))

    def _energy(self, rotated: Array) -> float:
        """The regulariser's energy of displacements (k, 3) between its eigenvectors."""
        return float(self.values @ (rotated**2).sum(axis=1))

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
        rows = max(self.count - self.null_dimension, 1.0)
        # the minimum of the sum, without forming residuals; floored, for it cancels where the fit is exact
        displacement = self.vectors @ rotated.reshape(-1, 3)
        alone = self.data is None  # RSS + lambda p' K p, without what a penalty adds
        misfit = self.equations.constant - right @ rotated if alone else self.cost(displacement, strength)
        variance = max(float(misfit) / rows, NOISE_FLOOR**2)
        log_determinant = 2 * np.log(np.diag(factor)).sum()
        # only independent points count as evidence against the regulariser, all of them for the noise
        independent = max(self.effective_fraction * self.count - self.null_dimension, 1.0)
        # minus twice the log of the likelihood with the control points integrated out (REML)
        criterion = independent * np.log(variance) + log_determinant - self.rank * np.log(max(weight, 1e-300))
        noise = float(np.sqrt(variance))
        return Solution(displacement, strength, noise, float(criterion), factor, self.vectors, self.effective_fraction)

    def select(self, strength: float | None, before: Solution | float | None) -> Solution:
        """The solution at a given strength; without one, or where it leaves control points undetermined, at the best.

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
        """The displacement at the strength with the largest evidence.

        Args:
            near: the strength of an earlier, similar problem; without it, or where the criterion is flat there, the
                whole range is searched.

        Raises:
            DegenerateError: no strength determines the control points.
        """
        start = self._first() if near is None else near
        low, high = _nearby(start)
        x = float(np.clip(np.log(start), low, high))
        root = self._root(x, min(x + NEAR, high), (low, high), ROUNDING)
        if root == (x, 0.0) and near is not None:
            return self.best()
        if root is None:
            x, reach = self._by_values(low, high), 3 * NEAR
            root = self._root(x, x + NEAR, (x - reach, x + reach), ROUNDING) or (x, 0.0)
        return self._determined(*root)

    def after(self, before: Solution) -> Solution:
        """The same in the round after another: its bend leads beside the root, and later rounds go nearer.

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
        if abs(step - x) >= BESIDE:
            root = self._root(x, step, _nearby(before.strength), BESIDE, derivative)
        return self.best(before.strength) if root is None else self._determined(*root)

    def _determined(self, x: float, curvature: float) -> Solution:
        """The solution at the logarithm of a strength, or at the nearest larger one that determines it."""
        for factor_of_strength in (1.0, *np.geomspace(10, WIDEST[1] / WIDEST[0], 16)):
            found = self.solve(float(factor_of_strength * np.exp(x)))
            if found is not None:
                return replace(found, curvature=curvature if factor_of_strength == 1 else 0.0)
        raise DegenerateError(
            "points: those that count leave even shifts of the control points undetermined; expected a cloud with an "
            "extent in three dimensions that is not made of outliers alone"
        )

    def _first(self) -> float:
        """Where a first search begins: the least of the strengths, a decade apart, that are as good as the best."""
        # the criterion has flat ends, where a local search would stop: look at every decade first
        strengths = np.geomspace(*WIDEST, 17)
        criteria = np.array([self._criterion(float(strength)) for strength in strengths])
        return float(strengths[np.argmax(criteria <= criteria.min() + FLAT / 2)])

    def _by_values(self, low: float, high: float) -> float:
        """The logarithm of about the best strength between two."""
        with np.errstate(invalid="ignore"):  # a parabola through an infinite criterion: it halves instead
            found = minimize_scalar(
                lambda x: self._criterion(float(np.exp(x))),
                bounds=(low, high),
                method="bounded",
                options={"xatol": NEAR},
            )
        return float(found.x)

    def _root(
        self, one: float, other: float, within: tuple[float, float], enough: float, derivative: float | None = None
    ) -> tuple[float, float] | None:
        """Where the criterion is least, by secant steps on its slope until one is short enough, and its bend there.

        The first place with bend zero where the criterion is flat; None where the steps leave the range, climb, or
        come to where control points are undetermined. `slope` is the one at `one`, where it is known.
        """
        derivatives = self._derivative(one) if derivative is None else derivative, self._derivative(other)
        if all(each is not None and abs(each) < FLAT for each in derivatives):
            return one, 0.0
        for _ in range(STEPS):
            if derivatives[0] is None or derivatives[1] is None:
                return None
            if (derivatives[1] - derivatives[0]) * (other - one) <= 0:
                return None
            curvature = (derivatives[1] - derivatives[0]) / (other - one)
            step = other - derivatives[1] / curvature
            if not within[0] <= step <= within[1]:
                return None
            if abs(step - other) < enough:
                return step, curvature
            one, other, derivatives = other, step, (derivatives[1], self._derivative(step))
        return None

    def _derivative(self, x: float) -> float | None:
        """Derivative of the criterion by the logarithm of the strength."""
        solution = self.solve(float(np.exp(x)))
        if solution is None:
            return None
        weight = solution.strength * self.count
        misfit = max(self.count - self.null_dimension, 1.0) * solution.noise**2
        independent = max(self.effective_fraction * self.count - self.null_dimension, 1.0)
        energy = self._energy(self.vectors.T @ solution.displacement)
        # the null space comes first in the order of eigenvalues, and the strength does not act on it
        costly = solution.factor[self.null_dimension :, self.null_dimension :]
        inverse = solve_triangular(costly, np.eye(self.rank), lower=True)
        traced = np.repeat(self.values, 3)[self.null_dimension :] @ (inverse**2).sum(axis=0)
        return float(weight * (independent * energy / misfit + traced) - self.rank)

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
    low, high = np.log(np.clip([strength / NEARBY, strength * NEARBY], WIDEST[0], NEARBY * WIDEST[1]))
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
