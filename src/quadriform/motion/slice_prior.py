"""The prior of the motions of slices, whose spread is estimated from the slices.

The components of a motion are independent a priori, with mean zero and one standard deviation, the spread, for each
kind: shift in the plane, shift along the normal, rotation about axes in the plane (tilt), rotation about the normal.

A motion of all slices that the model can follow, a gauge field g of `SlicePlanes.gauge_fields`, is not determined by
the data. What the posterior mean q has of it is what the prior allows: g' L q = 0, with the precisions L of the prior,
a diagonal matrix. So the mean motion is zero where each slice counts by its precision. In a mean that is weighted by
points, the few slices along the axis, which move along it in their planes, would shift the many across it, which
hardly move along their normals. A penalty fixes these means at zero, so that the standard deviations are those of
motions relative to all slices together.

The spread maximises the marginal likelihood of the motions, after elimination of the control points, by the steps of
Fellner and Schall (S. N. Wood and M. Fasiolo, A generalized Fellner-Schall method for smoothing parameter optimization,
Biometrics 73, 2017): the next variance is the present one times the sum of q^2 over the sum of how much the data
reduces the variances of q. They converge fast also where slices did not move. The likelihood is multiplied by the
spread, so that it has no maximum at zero where the data says little (Y. Chung and others, A nondegenerate penalized
likelihood estimator for variance parameters in multilevel models, Psychometrika 78, 2013): the variance itself is added
to the sum of q^2.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve

from quadriform.motion.cycle_equations import CycleSolution
from quadriform.motion.slice_motions import UNKNOWNS, SlicePlanes
from quadriform.points import Array

KINDS = np.array([0, 0, 1, 2, 2, 3])
"""The kind of each unknown of a slice: shift in the plane, along the normal, tilt, rotation about the normal."""


@dataclass(frozen=True)
class SpreadRules:
    """The constants of the prior of motions."""

    first: float = 0.05
    """The spread before any estimate, and where the data determines none: in RMS radii of the cloud, two or three
    millimetres of a heart; for rotations in radians, by which points at the RMS radius move as far."""
    least: float = 0.001
    """Smallest spread, a twentieth of a millimetre of a heart: below that slices did not move."""
    largest: float = 0.2
    """Largest spread, eight millimetres or eleven degrees: more than breathing moves slices in the same position."""
    least_ratio: float = 0.5
    """Smallest ratio of the spread along the normal to that in the plane, and of that of rotations about the normal to
    that of tilts: breathing does not know the planes of slices. Only where slices cross are shifts along normals
    observed, and the slices that are crossed least would else be fixed in this direction by the others."""
    fewest: float = 2.0
    """The spread is estimated from at least this effective number of determined unknowns."""
    steps: int = 30
    """Most steps of its estimation in a round."""
    tolerance: float = 0.01
    """The steps end where the spread changes by less than this fraction."""
    gauge_factor: float = 1e6
    """Precision of the means that are fixed at zero, relative to that of the prior."""


SPREAD = SpreadRules()


@dataclass(frozen=True)
class SlicePrior:
    """The prior of the motions of S slices.

    Attributes:
        spread: (4,), for each of `KINDS`.
        gauge: (6 S, m), the gauge fields.
        is_planar: whether slices only shift in their planes, as those of a stack that no slice crosses: what is smooth
            along the stack of the other motions cannot be distinguished from the form of the body, and the rest is too
            badly determined to improve the surface.
    """

    spread: Array
    gauge: Array
    is_planar: bool

    @classmethod
    def first(cls, gauge: Array, is_planar: bool) -> "SlicePrior":
        """Before any estimate."""
        out_of_plane = SPREAD.least if is_planar else SPREAD.first
        return cls(np.array([SPREAD.first, *[out_of_plane] * 3]), gauge, is_planar)

    @property
    def kinds(self) -> NDArray[np.int64]:
        """The kind of each unknown, (6 S,)."""
        return np.tile(KINDS, len(self.gauge) // UNKNOWNS)

    def precision(self) -> Array:
        """The precision (6 S, 6 S), with that of the means."""
        fixed, deviations = self._fixed(), self.spread[self.kinds]
        return (np.eye(len(fixed)) + SPREAD.gauge_factor * fixed @ fixed.T) / np.outer(deviations, deviations)

    def variances(self) -> Array:
        """The variances (6 S,) where the means are zero."""
        found: Array = self.spread[self.kinds] ** 2 * (1 - (self._fixed() ** 2).sum(axis=1))
        return found

    def _fixed(self) -> Array:
        """An orthonormal basis (6 S, r) of the gauge fields, in units of the spread."""
        scaled = self.gauge / self.spread[self.kinds][:, None]
        vectors, values, _ = np.linalg.svd(scaled / np.linalg.norm(scaled, axis=0), full_matrices=False)
        return vectors[:, values > 1e-9 * values.max(initial=0)]

    def of_data(self, data: Array, right: Array) -> "SlicePrior":
        """The prior of the largest penalised marginal likelihood.

        Args:
            data: (6 S, 6 S), precision of the motions by the data alone, whatever the control points.
            right: (6 S,), its product with the motions of the largest likelihood.
        """
        prior = SlicePrior.first(self.gauge, self.is_planar)
        estimated = prior._reduced(data) > SPREAD.fewest * prior.spread**2
        for _ in range(SPREAD.steps):
            after = prior._step(data, right, estimated)
            change = np.abs(np.log(after.spread / prior.spread)).max()
            prior = after
            if change < SPREAD.tolerance:
                break
        return prior

    def _reduced(self, data: Array) -> Array:
        """By how much the data reduces the variances of each kind, (4,), summed over the slices."""
        posterior = np.diag(cho_solve(cho_factor(data + self.precision()), np.eye(len(data))))
        return self._by_kind(np.maximum(self.variances() - posterior, 0))

    def _by_kind(self, values: Array) -> Array:
        """Sums (4,) of values (6 S,) over the unknowns of each kind."""
        return np.array([values[self.kinds == kind].sum() for kind in range(4)])

    def _step(self, data: Array, right: Array, estimated: NDArray[np.bool_]) -> "SlicePrior":
        """The prior after a step of Fellner and Schall for the kinds (4,) whose spread is estimated."""
        motions = cho_solve(cho_factor(data + self.precision()), right)
        squares = self._by_kind(motions**2) + self.spread**2
        ratios = np.sqrt(squares / np.maximum(self._reduced(data), np.finfo(float).tiny))
        spread = np.where(estimated, self.spread * ratios, self.spread).clip(SPREAD.least, SPREAD.largest)
        if self.is_planar:
            spread[1:] = SPREAD.least
        else:
            spread[[1, 3]] = np.maximum(spread[[1, 3]], SPREAD.least_ratio * spread[[0, 2]])
        return SlicePrior(spread, self.gauge, self.is_planar)


@dataclass(frozen=True)
class SliceState:
    """Motions of S slices between two rounds.

    Attributes:
        motions: (S, 6), shift and rotation vector of each along its axes.
        prior: of the linear problem.
        noise: the standard deviation of independent residuals, by which the prior is weighed against the data.
        estimate: the prior of the largest penalised marginal likelihood by the last round.
    """

    motions: Array
    prior: SlicePrior
    noise: float
    estimate: SlicePrior

    @property
    def penalty(self) -> Array:
        """The part (6 S, 6 S) of the prior in the matrix of the linear problem."""
        return self.noise**2 * self.prior.precision()

    @classmethod
    def first(cls, planes: SlicePlanes | None, noise: float) -> "SliceState":
        """Before the first round; of no slices without planes."""
        gauge = np.empty((0, 0)) if planes is None else planes.gauge_fields()
        prior = SlicePrior.first(gauge, planes is not None and planes.are_parallel)
        return cls(np.zeros((len(gauge) // UNKNOWNS, UNKNOWNS)), prior, noise, prior)

    def after(self, motions: Array, solution: CycleSolution, noise: float) -> "SliceState":
        """The state after a round, with an estimate of the prior.

        Args:
            motions: (6 S,), at the end of the step.
            solution: of the linear problem.
            noise: by the solution, of independent residuals.
        """
        if not len(motions):
            return self
        data = (solution.motion_matrix - self.penalty) / noise**2
        estimate = self.prior.of_data(data, solution.motion_matrix @ solution.motions / noise**2)
        return replace(self, motions=motions.reshape(-1, UNKNOWNS), estimate=estimate)

    def with_estimate(self, noise: float) -> "SliceState":
        """The state with its estimate as the prior of the next round, at a noise of independent residuals."""
        return replace(self, prior=self.estimate, noise=noise)

    def with_prior_of(self, other: "SliceState") -> "SliceState":
        """The state with the prior of another one, and its noise."""
        return replace(self, prior=other.prior, noise=other.noise)

    def deviations(self, covariance: Array) -> Array:
        """Standard deviations (S, 6) by a posterior covariance (6 S, 6 S).

        Motions that are not sought have the spread before any estimate.
        """
        found = np.sqrt(np.diag(covariance)).reshape(-1, UNKNOWNS)
        return np.where(KINDS > 0, SPREAD.first, found) if self.prior.is_planar else found
