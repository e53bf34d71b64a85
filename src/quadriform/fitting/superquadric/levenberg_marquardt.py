"""Levenberg-Marquardt descent of many superquadrics at once.

It maximises, within bounds, for each candidate

    sum_i w_i log p(d_i) - sum over both exponents of (e - 1)^2 / (2 s^2) - penalty on the size - penalty of empty space

over the parameters of the candidate. p is the density of a distance by the mixture (`fitting/mixture.py`), d_i the
distance of a point divided by its relative noise, and s the standard deviation of a weak prior on the exponents.
Parameters and mixture are changed in turn.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from quadriform.fitting.mixture import Mixture
from quadriform.fitting.superquadric.candidates import AXES, POWERS, ROTATION, Candidates, Extent, distances
from quadriform.fitting.superquadric.problem import SearchProblem
from quadriform.points import Array
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


DESCENT = DescentSettings()


class Descent:
    """The state of M candidates on the m points of a problem.

    Args:
        problem: the points, and the penalties and bounds of candidates.
        candidates: where they start.
        mixture: where it starts.
        weights: (m,) for all candidates, or (M, m); those of the problem unless given.
    """

    def __init__(
        self, problem: SearchProblem, candidates: Candidates, mixture: Mixture, weights: Array | None = None
    ) -> None:
        self.problem, self.candidates, self.mixture = problem, candidates, mixture
        self.points, self.fixed_mask = problem.points, problem.fixed_mask
        self.weights = problem.weights if weights is None else weights
        self.damping = np.full(len(candidates), DESCENT.damping)
        self.distances, self.derivatives = self._standardised(candidates)
        self.inliers, self.log_density = mixture.densities(self.distances, problem.log_odds)
        self.history: list[float] = []  # the least sigma after each step

    def _standardised(self, candidates: Candidates) -> tuple[Array, Array]:
        """Distances and their derivatives, divided by the relative noise of the points."""
        found, derivatives = distances(candidates, self.points)
        return found / self.problem.relative_noise, derivatives / self.problem.relative_noise

    def picked(self, index: NDArray[np.int64]) -> tuple[Candidates, Mixture]:
        """The chosen candidates and their mixtures."""
        return self.candidates.take(index), self.mixture.take(index)

    def scores(self) -> Array:
        """Log likelihood (M,) less the penalties, corrected for the p parameters that are estimated by p log sigma.

        The log likelihood of n inliers contains -n log sigma. With the correction the term is -(n - p) log sigma, for
        only n - p degrees of freedom are left after p parameters were fitted. The prior on the exponents, which the
        descent also maximises, is left out: it is to keep exponents where points do not determine them, not to prefer
        one candidate to another.
        """
        correction = self.problem.n_estimated * np.log(self.mixture.sigma)
        likelihood = (self.weights * self.log_density).sum(axis=1)
        return likelihood + correction - self._penalties(self.candidates, self.extent())

    def _penalties(self, candidates: Candidates, extent: "Extent") -> Array:
        """The penalties (M,) on the size and of empty space, at the mixture."""
        found, empty = extent.cost(candidates), self.problem.empty
        return found if empty is None else found + empty.penalty(candidates, self.mixture).cost

    def extent(self) -> "Extent":
        """The penalty on the size of the candidates, relative to their inliers."""
        return Extent.of(self.candidates.kind, self.points, self.problem.size * self.weights * self.inliers)

    def run(self, iterations: int, reestimate: Reestimate, tolerance: float = 0.0) -> bool:
        """Whether all candidates converged, after damped steps in place.

        The steps end when the change of all candidates is below the tolerance (`_change`), and at the latest after
        `iterations`; with a tolerance of zero all are made. A step that was rejected and is short by its damping is no
        convergence: the derivatives at foot points differ a little from those of the likelihood, so that shorter steps
        would be rejected too.
        """
        for _ in range(iterations):
            step = self._step()
            change = self._change(step)
            taken = self._try(step)
            self._set_mixture(reestimate(self))
            if (change < tolerance).all():
                return bool((taken | (self.damping < DESCENT.damped)).all())
        return False

    def converge(self, iterations: int, reestimate: Reestimate, tolerance: float) -> bool:
        """Whether undamped, accelerated steps of one candidate, in place, converged to the fixed point of their map.

        The map takes parameters and mixture to those after an undamped step and a re-estimation. With derivatives at
        foot points its fixed point is not quite the maximum of the likelihood of first-order distances. So the length
        of the steps is tested and not the likelihood. A position of the iteration is (p + 2,): the sum of the steps in
        the p parameters, each step in the frame that the candidate had before it, then the coordinates of the mixture
        relative to the first.

        They have converged when a step is below the tolerance. Otherwise the candidate and its mixture are again what
        they were before, but the damping is zero, so that `run` goes on from a Gauss-Newton step, and the history keeps
        the steps, with one entry more for the return.
        """
        before = self.candidates, self.mixture
        self.damping = np.zeros(len(self.candidates))
        positions, proposals = [np.zeros(self.fixed_mask.size + 2)], list[Array]()
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
        self.candidates = self.candidates.moved(motion[None, :-2], self.problem.longest)
        self.distances, self.derivatives = self._standardised(self.candidates)
        self._set_mixture(Mixture.at(self.mixture.coordinates() + motion[-2:]))

    def _set_mixture(self, mixture: Mixture) -> None:
        self.history.append(float(mixture.sigma.min()))
        self.mixture = mixture
        self.inliers, self.log_density = mixture.densities(self.distances, self.problem.log_odds)

    def _step(self) -> Array:
        """The damped Gauss-Newton step (M, n_parameters) of the weighted squares, the prior and both penalties."""
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
        if self.problem.empty is not None:
            terms = self.problem.empty.penalty(self.candidates, self.mixture)
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
        blocked = np.broadcast_to(self.fixed_mask, gradient.shape).copy()
        low, high = ((self.candidates.exponents <= EXPONENTS[0]), (self.candidates.exponents >= EXPONENTS[1]))
        blocked[:, POWERS] |= (low & (gradient[:, POWERS] > 0)) | (high & (gradient[:, POWERS] < 0))
        blocked[:, :3] |= (self.candidates.log_axes >= np.log(self.problem.longest)) & (gradient[:, :3] < 0)
        return blocked

    def _change(self, step: Array) -> Array:
        """The largest change (M,) of a parameter by the step, or the predicted one of the distances if that is less."""
        predicted = (step[:, None] @ self.derivatives)[:, 0]
        return np.minimum(
            np.abs(step).max(axis=1), np.abs(predicted).max(axis=1) / np.maximum(self.mixture.sigma, DESCENT.finest)
        )

    def _try(self, step: Array) -> Mask:
        """A mask (M,) of the candidates that took the step, as it does not decrease their penalised likelihood."""
        moved = self.candidates.moved(step, self.problem.longest)
        found, derivatives = self._standardised(moved)
        # at the same mixture: steps of candidates and of the mixture alternate
        inliers, log_density = self.mixture.densities(found, self.problem.log_odds)
        extent = self.extent()
        before, after = (
            (self.weights * density).sum(axis=1) + _log_prior(each) - self._penalties(each, extent)
            for density, each in ((self.log_density, self.candidates), (log_density, moved))
        )
        taken = after >= before
        self.candidates = moved.where(taken, self.candidates)
        self.distances = np.where(taken[:, None], found, self.distances)
        self.derivatives = np.where(taken[:, None, None], derivatives, self.derivatives)
        self.inliers = np.where(taken[:, None], inliers, self.inliers)
        self.damping = np.clip(np.where(taken, self.damping / 5, self.damping * 4), 1e-12, 1e8)
        return taken


def _log_prior(candidates: Candidates) -> Array:
    return -((candidates.exponents - 1) ** 2).sum(axis=1) / (2 * EXPONENT_SPREAD**2)


def accelerated(positions: list[Array], proposals: list[Array]) -> Array:
    """The step of Anderson acceleration.

    Were the map linear, its proposals g would be linear in the positions x. The combination of the last pairs (x, g)
    whose combined proposal is least, by least squares, is then nearest to the fixed point; the step leads from the
    latest position to x + g of this combination.

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
