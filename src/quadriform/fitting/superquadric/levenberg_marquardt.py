"""Levenberg-Marquardt descent of many superquadrics at once, and their distances to the points.

The distance is the first-order one of P4, d = (F - 1) / |grad F|: exact for planes and for spheres, since F is of
degree one. Its derivatives are taken at the foot point x - d n instead of at x: there they are those of the Euclidean
distance itself, to first order in d, without second derivatives of F. The descent maximises the mixture's likelihood,
with a weak prior on the exponents, within bounds.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from quadriform.fitting.mixture import Mixture
from quadriform.fitting.superquadric.candidates import AXES, POWERS, ROTATION, Candidates
from quadriform.fitting.superquadric.penalty import Penalty
from quadriform.points import Array
from quadriform.shapes import _kernel
from quadriform.shapes.kinds import KINDS
from quadriform.shapes.superquadric import EXPONENTS

EXPONENT_SPREAD = (EXPONENTS[1] - EXPONENTS[0]) / np.sqrt(12)
"""Standard deviation of an exponent that may be anything in its range: the weak prior around 1."""
Mask = NDArray[np.bool_]
Reestimate = Callable[["Descent"], Mixture]
"""Returns the mixture of the next step."""


@dataclass(frozen=True)
class DescentSettings:
    """The constants of the descent; lengths in RMS radii."""

    damping: float = 1e-2
    """Initial damping relative to the diagonal of the normal matrix: nearly a Gauss-Newton step."""
    damped: float = 1.0
    """Damping above which the damping, not the Gauss-Newton step, determines the length of a step."""
    largest_step: float = 0.5
    """Largest step of a parameter: beyond, a semi-axis changes by more than half, and distances are nonlinear."""
    finest: float = 1e-3
    """The predicted change of the distances is in units of sigma, or of this where sigma is less."""
    idle: float = 1e-20
    """A rotation whose squared effect on the distances is below this fraction of the largest of other parameters is
    not made: its gain would be rounding, as about the axes of a sphere."""
    memory: int = 6
    """Steps that the acceleration combines: half as many as there are parameters."""
    worse: float = 2.0
    """The acceleration restarts after a step this many times larger than the last."""
    size: float = 0.03
    """Decrease of an inlier's log likelihood as the area of the surface grows by a factor e. It would be one for points
    spread evenly over a whole surface, with a density of one over its area. How much of the surface was sampled is not
    known, so it is a weak prior beside the distances."""


DESCENT = DescentSettings()


def distances(candidates: Candidates, points: Array) -> tuple[Array, Array]:
    """Signed distances (M, m) of points (m, 3) to each candidate and their derivatives (M, n_parameters, m)."""
    count, each = len(candidates), len(points)
    result, derivatives = np.empty((count, each)), np.empty((count, candidates.n_parameters, each))
    kind = KINDS[candidates.kind]
    axes, holes = np.exp(candidates.log_axes), kind.has_hole * (1 + np.exp(candidates.log_holes))
    given = (axes, candidates.exponents, candidates.rotations, candidates.translations, holes, points)
    a, e, r, t, h, x = (np.ascontiguousarray(array) for array in given)
    _kernel.distances(kind.codes, a, e, r, t, h, x, result, derivatives)  # P4
    return result, derivatives


@dataclass(frozen=True)
class Extent:
    """A penalty on the size of M surfaces: where there is no data the smallest is preferred.

    It is weights * log(1 + area / area of the data): a surface gains little by shrinking below the data. The areas are
    those of boxes up to a factor.

    Attributes:
        weights: (M,) of the penalty.
        areas: (M,) of a sphere with the inliers' RMS radius.
    """

    weights: Array
    areas: Array

    @classmethod
    def of(cls, kind: str, points: Array, inliers: Array) -> "Extent":
        """The penalty for points (m, 3) with inlier weights (M, m).

        It is zero where the semi-axes do not give the size: of surfaces with a hole, or cut where the points end.
        """
        total = inliers.sum(axis=1)
        fraction = inliers / np.maximum(total, 1e-300)[:, None]
        spread = fraction @ (points**2).sum(axis=1) - ((fraction @ points) ** 2).sum(axis=1)
        return cls(KINDS[kind].is_radial * DESCENT.size * total, 3 * np.maximum(spread, 1e-300))

    def cost(self, candidates: Candidates) -> Array:
        """The value of the penalty (M,)."""
        return self.weights * np.log1p(_box_areas(candidates).sum(axis=1) / 2 / self.areas)

    def derivatives(self, candidates: Candidates) -> Array:
        """Its derivatives (M, 3) by the logarithms of the semi-axes."""
        areas = _box_areas(candidates)
        return self.weights[:, None] * areas / (areas.sum(axis=1) / 2 + self.areas)[:, None]


def _box_areas(candidates: Candidates) -> Array:
    """Eighths (M, 3) of the area of the box's four sides along each axis, a1 (a2 + a3) and so on."""
    axes = np.exp(candidates.log_axes)
    return axes * (axes.sum(axis=1, keepdims=True) - axes)


class Descent:
    """The state of M candidates on m points.

    Args:
        candidates: where they start.
        points: (m, 3), centred and scaled.
        weights: (m,) for all, or (M, m).
        mixture: where it starts.
        longest: no semi-axis grows above it.
        fixed: (n_parameters,) true for parameters that stay.
        log_odds: (m,), of the points to be inliers, besides their distances; 0 is even.
        noise: (m,) standard deviations of the points relative to sigma, by which distances are divided.
        least_sigma: lower bound of sigma.
        size: weight of the penalty on the size.
        penalty: another one, or None.
    """

    def __init__(
        self,
        candidates: Candidates,
        points: Array,
        weights: Array,
        mixture: Mixture,
        longest: float,
        fixed: Mask,
        log_odds: Array,
        noise: Array,
        least_sigma: float = 0.0,
        size: float = 1.0,
        penalty: Penalty | None = None,
    ) -> None:
        self.candidates, self.points, self.weights, self.mixture = candidates, points, weights, mixture
        self.longest, self.fixed, self.log_odds = longest, fixed, log_odds
        self.noise, self.least_sigma, self.size, self.penalty = noise, least_sigma, size, penalty
        self.damping = np.full(len(candidates), DESCENT.damping)
        self.distances, self.derivatives = self._standardised(candidates)
        self.inliers, self.log_density = mixture.densities(self.distances, self.log_odds)
        self.history: list[float] = []  # the least sigma after each step

    def _standardised(self, candidates: Candidates) -> tuple[Array, Array]:
        """Distances and their derivatives, divided by the relative standard deviations of the points."""
        found, derivatives = distances(candidates, self.points)
        return found / self.noise, derivatives / self.noise

    def picked(self, index: NDArray[np.int64]) -> tuple[Candidates, Mixture]:
        """The chosen candidates and their mixtures."""
        return self.candidates.take(index), self.mixture.take(index)

    def scores(self) -> Array:
        """Log likelihood (M,) with a correction for the parameters, which lower sigma, less the penalty on the size."""
        gain = self.candidates.n_parameters * np.log(self.mixture.sigma)
        return (self.weights * self.log_density).sum(axis=1) + gain - self._penalties(self.candidates, self.extent())

    def _penalties(self, candidates: Candidates, extent: "Extent") -> Array:
        """The penalty (M,) on the size and the other one, at the mixture."""
        found = extent.cost(candidates)
        return found if self.penalty is None else found + self.penalty(candidates, self.mixture).cost

    def extent(self) -> "Extent":
        """The penalty on the size of the candidates, relative to their inliers."""
        return Extent.of(self.candidates.kind, self.points, self.size * self.weights * self.inliers)

    def run(self, iterations: int, tolerance: float, reestimate: Reestimate) -> bool:
        """Whether the candidates converged: steps are made until the change is below `tolerance` for all of them.

        A short step that was rejected, and is short by its damping, is no convergence: derivatives at foot points
        differ a little from those of the likelihood, so shorter ones would be rejected too.
        """
        for _ in range(iterations):
            step = self._step()
            change = self._change(step)
            accepted = self._try(step)
            self._set_mixture(reestimate(self))
            if (change < tolerance).all():
                return bool((accepted | (self.damping < DESCENT.damped)).all())
        return False

    def converge(self, iterations: int, tolerance: float, reestimate: Reestimate) -> bool:
        """Whether undamped, accelerated steps of one candidate reached the fixed point; else it stays as it was.

        Derivatives at foot points are those of the Euclidean distance: their fixed point is not quite where the
        likelihood of first-order distances is largest, so the length of the steps is tested, not the likelihood.
        """
        before = self.candidates, self.mixture
        self.damping = np.zeros(len(self.candidates))
        positions, proposals = [np.zeros(self.fixed.size + 2)], list[Array]()
        for _ in range(iterations):
            step = self._step()
            mixture = reestimate(self)
            proposals.append(np.concatenate([step[0], mixture.coordinates() - self.mixture.coordinates()]))
            converged = self._change(step)[0] < tolerance
            if len(proposals) > 1 and np.abs(proposals[-1]).max() > DESCENT.worse * np.abs(proposals[-2]).max():
                positions, proposals = positions[-1:], proposals[-1:]
            motion = accelerated(positions[-DESCENT.memory :], proposals[-DESCENT.memory :])
            motion *= min(1, DESCENT.largest_step / max(np.abs(motion).max(), 1e-300))
            self._move(motion)
            positions.append(positions[-1] + motion)
            if converged:
                return True
        self.candidates, self.mixture = before
        self._move(np.zeros_like(motion))
        return False

    def _move(self, motion: Array) -> None:
        """Move one candidate and its mixture, whatever the likelihood."""
        self.candidates = self.candidates.moved(motion[None, :-2], self.longest)
        self.distances, self.derivatives = self._standardised(self.candidates)
        self._set_mixture(Mixture.at(self.mixture.coordinates() + motion[-2:]))

    def _set_mixture(self, mixture: Mixture) -> None:
        self.history.append(float(mixture.sigma.min()))
        self.mixture = mixture
        self.inliers, self.log_density = mixture.densities(self.distances, self.log_odds)

    def _step(self) -> Array:
        """The damped Gauss-Newton step (M, n_parameters) of the weighted squares and the prior."""
        weighted = self.derivatives * (self.weights * self.inliers)[:, None]
        normal = weighted @ np.swapaxes(self.derivatives, 1, 2)
        gradient = (weighted @ self.distances[:, :, None])[..., 0]
        # a Gaussian prior on the exponents, in the units of the weighted squares
        prior = (self.mixture.sigma / EXPONENT_SPREAD) ** 2
        gradient[:, POWERS] += prior[:, None] * (self.candidates.exponents - 1)
        diagonal = np.einsum("mii->mi", normal)  # a view: what is written to it is in the matrix that is solved
        diagonal[:, POWERS] += prior[:, None]
        # the penalty on the size likewise, with an upper bound of its curvature: d^2 / dx^2 log(1 + e^x) <= d / dx
        size = self.mixture.sigma[:, None] ** 2 * self.extent().derivatives(self.candidates)
        gradient[:, AXES] += size
        diagonal[:, AXES] += size
        if self.penalty is not None:
            terms = self.penalty(self.candidates, self.mixture)
            gradient += terms.gradient
            normal += terms.matrix
        largest = diagonal.max(axis=1, keepdims=True)
        unblocked = ~self._blocked(gradient)
        unblocked[:, ROTATION] &= diagonal[:, ROTATION] > DESCENT.idle * largest
        gradient *= unblocked
        normal *= unblocked[:, :, None] & unblocked[:, None]
        largest = diagonal.max(axis=1, keepdims=True)
        diagonal += self.damping[:, None] * diagonal + 1e-13 * largest + 1e-300 + largest * ~unblocked
        # blocked parameters have a diagonal of their own and no gradient, so they stay
        step = -np.linalg.solve(normal, gradient[:, :, None])[..., 0]
        return step * np.minimum(1, DESCENT.largest_step / np.maximum(np.abs(step).max(axis=1), 1e-300))[:, None]

    def _blocked(self, gradient: Array) -> Mask:
        """Parameters (M, n_parameters) that are fixed, or at a bound and would pass it."""
        blocked = np.broadcast_to(self.fixed, gradient.shape).copy()
        low, high = ((self.candidates.exponents <= EXPONENTS[0]), (self.candidates.exponents >= EXPONENTS[1]))
        blocked[:, POWERS] |= (low & (gradient[:, POWERS] > 0)) | (high & (gradient[:, POWERS] < 0))
        blocked[:, :3] |= (self.candidates.log_axes >= np.log(self.longest)) & (gradient[:, :3] < 0)
        return blocked

    def _change(self, step: Array) -> Array:
        """The largest change (M,) of a parameter by the step, or the predicted one of the distances if that is less."""
        predicted = (step[:, None] @ self.derivatives)[:, 0]
        return np.minimum(
            np.abs(step).max(axis=1), np.abs(predicted).max(axis=1) / np.maximum(self.mixture.sigma, DESCENT.finest)
        )

    def _try(self, step: Array) -> Mask:
        """A mask (M,) of the candidates that took the step, as it does not decrease their penalised likelihood."""
        moved = self.candidates.moved(step, self.longest)
        found, derivatives = self._standardised(moved)
        # at the same mixture: steps of candidates and of the mixture alternate
        inliers, log_density = self.mixture.densities(found, self.log_odds)
        extent = self.extent()
        before, after = (
            (self.weights * density).sum(axis=1) + _log_prior(each) - self._penalties(each, extent)
            for density, each in ((self.log_density, self.candidates), (log_density, moved))
        )
        accepted = after >= before
        self.candidates = moved.where(accepted, self.candidates)
        self.distances = np.where(accepted[:, None], found, self.distances)
        self.derivatives = np.where(accepted[:, None, None], derivatives, self.derivatives)
        self.inliers = np.where(accepted[:, None], inliers, self.inliers)
        self.damping = np.clip(np.where(accepted, self.damping / 5, self.damping * 4), 1e-12, 1e8)
        return accepted


def _log_prior(candidates: Candidates) -> Array:
    return -((candidates.exponents - 1) ** 2).sum(axis=1) / (2 * EXPONENT_SPREAD**2)


def accelerated(positions: list[Array], proposals: list[Array]) -> Array:
    """The step of Anderson acceleration: the combination of the last proposals that is the fixed point of a linear map.

    Args:
        positions: where the iteration was, (k,) each, the latest last.
        proposals: the step that the map proposed there.
    """
    latest = proposals[-1]
    if len(proposals) == 1:
        return latest
    moved, changed = np.diff(positions, axis=0), np.diff(proposals, axis=0)
    if not np.isfinite(changed).all():
        return latest
    # least squares, for the last proposals may be nearly dependent
    combination = np.linalg.lstsq(changed.T, latest, rcond=None)[0]
    return latest - (moved + changed).T @ combination
