"""How strongly to hold the box, and how noisy the data is: both from the evidence of the data itself (REML)."""

from copy import copy
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from scipy.linalg import cho_solve, cholesky, lapack, solve_triangular
from scipy.optimize import minimize_scalar

from quadriform.errors import OptionError
from quadriform.fitting.normal_equations import NormalEquations
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
NOISE_FLOOR = 1e-9
"""Of the cloud's RMS radius: no data is more exact than that."""


@dataclass(frozen=True)
class Solution:
    """Control points' displacement under one strength, and how sure it is; lengths in the frame of the data.

    Attributes:
        displacement: (k, 3).
        strength: alpha, per data point.
        noise: standard deviation of the data along the normal.
        criterion: minus twice the log evidence, up to a constant.
        factor: lower Cholesky factor of A + lambda K.
        share: how many independent points each point was taken for.
        bend: second derivative of the criterion by the logarithm of the strength, where it was sought.
    """

    displacement: Array
    strength: float
    noise: float
    criterion: float
    factor: Array
    share: float = 1.0
    bend: float = 0.0

    @property
    def independent_noise(self) -> float:
        """The noise that independent points, as many as there are, would have to tell no more than these do."""
        return float(self.noise / np.sqrt(self.share))

    @property
    def condition(self) -> float:
        """Of A + lambda K in the 1-norm: numbers that only the strength tells apart lose so much of their precision."""
        largest = np.abs(self.factor @ self.factor.T).sum(axis=0).max()
        reciprocal, _ = lapack.dpocon(self.factor, largest, uplo="L")
        return float(1 / max(reciprocal, np.finfo(float).tiny))

    def variance(self, rows: Array) -> Array:
        """Posterior variance of linear functions (n, 3 k) of the displacement."""
        return self.noise**2 * (solve_triangular(self.factor, rows.T, lower=True) ** 2).sum(axis=0)

    def covariance(self) -> Array:
        """Posterior covariance (3 k, 3 k) of the control points."""
        half = solve_triangular(self.factor, np.eye(len(self.factor)), lower=True)
        return self.noise**2 * half.T @ half


class Evidence:
    """The linearised problem seen as a function of the strength.

    Args:
        equations: of the data.
        penalty: (k, k), K of the regulariser for one coordinate.
        count: number of residual rows, the sum of the weights.
        share: of them that are independent.
    """

    def __init__(self, equations: NormalEquations, penalty: Array, count: float, share: float = 1.0) -> None:
        self.equations = equations
        self.penalty, self.root = _of_three(penalty.tobytes())
        self.count, self.share = count, share
        self.rank = self.root.shape[1]
        self.free = len(self.penalty) - self.rank

    def plus(self, equations: NormalEquations) -> "Evidence":
        """The same with something else to be met."""
        other = copy(self)
        other.equations = self.equations + equations
        return other

    def cost(self, displacement: Array, strength: float) -> float:
        """The sum at a displacement: squares of residuals, and the regulariser's part."""
        p, equations = displacement.ravel(), self.equations
        held = strength * self.count * self.penalty
        return float(p @ ((equations.matrix + held) @ p) - 2 * equations.right @ p + equations.constant)

    def solve(self, strength: float) -> Solution:
        """The displacement at one strength.

        Raises:
            OptionError: the strength leaves control points undetermined.
        """
        held = strength * self.count
        try:
            factor = cholesky(self.equations.matrix + held * self.penalty, lower=True)
        except np.linalg.LinAlgError as error:
            raise OptionError(f"strength={strength:g} leaves control points undetermined; try a larger one") from error
        displacement = cho_solve((factor, True), self.equations.right)
        rows = max(self.count - self.free, 1.0)
        misfit = self.equations.constant - self.equations.right @ displacement  # RSS + lambda p' K p
        variance = max(float(misfit) / rows, NOISE_FLOOR**2)
        log_determinant = 2 * np.log(np.diag(factor)).sum()
        independent = max(self.share * self.count - self.free, 1.0)
        criterion = independent * np.log(variance) + log_determinant - self.rank * np.log(max(held, 1e-300))
        noise = float(np.sqrt(variance))
        return Solution(displacement.reshape(-1, 3), strength, noise, float(criterion), factor, self.share)

    def best(self, near: float | None = None) -> Solution:
        """The displacement at the strength with the largest evidence.

        Args:
            near: the strength of an earlier, similar problem; without it the whole range is searched.
        """
        if near is None:
            near = float(min(np.geomspace(*WIDEST, 17), key=self._criterion))
        low, high = _nearby(near)
        x = float(np.clip(np.log(near), low, high))
        root = self._root(x, min(x + NEAR, high), (low, high), ROUNDING)
        if root is None:
            with np.errstate(invalid="ignore"):  # a parabola through an infinite criterion: it halves instead
                found = minimize_scalar(
                    lambda x: self._criterion(float(np.exp(x))),
                    bounds=(low, high),
                    method="bounded",
                    options={"xatol": NEAR},
                )
            x, reach = float(found.x), 3 * NEAR
            root = self._root(x, x + NEAR, (x - reach, x + reach), ROUNDING) or (x, 0.0)
        return replace(self.solve(float(np.exp(root[0]))), bend=root[1])

    def after(self, before: Solution) -> Solution:
        """The same in the round after another: its bend leads beside the root, and later rounds go nearer."""
        x = float(np.log(before.strength))
        if before.bend <= 0:
            return self.best(before.strength)
        slope = self._slope(x)
        step = x - slope / before.bend
        root: tuple[float, float] | None = (step, before.bend)
        if abs(step - x) >= BESIDE:
            root = self._root(x, step, _nearby(before.strength), BESIDE, slope)
        if root is None:
            return self.best(before.strength)
        return replace(self.solve(float(np.exp(root[0]))), bend=root[1])

    def _root(
        self, one: float, other: float, within: tuple[float, float], enough: float, slope: float | None = None
    ) -> tuple[float, float] | None:
        """Where the criterion is least, by secant steps on its slope until one is short enough, and its bend there.

        None where the steps leave the range or climb. `slope` is the one at `one`, where it is known.
        """
        try:
            first = self._slope(one) if slope is None else slope
            return self._secant((one, other), (first, self._slope(other)), within, enough)
        except OptionError:  # a step to where control points are undetermined
            return None

    def _secant(
        self, places: tuple[float, float], slopes: tuple[float, float], within: tuple[float, float], enough: float
    ) -> tuple[float, float] | None:
        one, other = places
        for _ in range(STEPS):
            if (slopes[1] - slopes[0]) * (other - one) <= 0:
                return None
            bend = (slopes[1] - slopes[0]) / (other - one)
            step = other - slopes[1] / bend
            if not within[0] <= step <= within[1]:
                return None
            if abs(step - other) < enough:
                return step, bend
            one, other, slopes = other, step, (slopes[1], self._slope(step))
        return None

    def _slope(self, x: float) -> float:
        """Derivative of the criterion by the logarithm of the strength."""
        solution = self.solve(float(np.exp(x)))
        held = solution.strength * self.count
        p = solution.displacement.ravel()
        misfit = max(self.count - self.free, 1.0) * solution.noise**2
        independent = max(self.share * self.count - self.free, 1.0)
        traced = (solve_triangular(solution.factor, self.root, lower=True) ** 2).sum()
        return float(held * (independent * (p @ self.penalty @ p) / misfit + traced) - self.rank)

    def _criterion(self, strength: float) -> float:
        try:
            return self.solve(strength).criterion
        except OptionError:
            return np.inf


def _nearby(strength: float) -> tuple[float, float]:
    """The range of a later search, in logarithms."""
    low, high = np.log(np.clip([strength / NEARBY, strength * NEARBY], WIDEST[0], NEARBY * WIDEST[1]))
    return float(low), float(high)


@lru_cache(maxsize=4)
def _of_three(penalty: bytes) -> tuple[Array, Array]:
    """The penalty (k, k) for all three coordinates, and a root of it: root root' is the penalty."""
    flat = np.frombuffer(penalty, dtype=np.float64)
    one = flat.reshape(int(np.sqrt(len(flat))), -1)
    values, vectors = np.linalg.eigh(one)
    held = values > 1e-10 * values[-1]
    root: Array = vectors[:, held] * np.sqrt(values[held])
    return np.asarray(np.kron(one, np.eye(3))), np.asarray(np.kron(root, np.eye(3)))
