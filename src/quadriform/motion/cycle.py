"""One moving box fitted to the points of all frames of a periodic motion, such as a heartbeat.

A round (`Cycle.step`) updates the foot points of every frame, the nearest points on its current surface, and solves one
linear problem for the control points at all knots of the splines in time and, on request, the rigid motions of
slices. `cycle_rounds.fit_cycle` makes the rounds. Below are F frames, K knots, k control points and S slices.
Coordinates are relative to the centroid of the points and divided by their RMS radius; noise and shifts have that unit.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from quadriform.fitting.least_squares.normal_equations import NormalEquations
from quadriform.fitting.noise import KnownNoise
from quadriform.fitting.refinement.base_prior import base_priors
from quadriform.fitting.refinement.point_to_plane import Rows, data_rows, step_length
from quadriform.fitting.refinement.stage import MAD_TO_SIGMA, Penalty, independent_fraction
from quadriform.fitting.refinement.surface_data import SurfaceData, with_excess
from quadriform.fitting.refinement.unfolding import JacobianPenalty
from quadriform.fitting.result import HalfSpace
from quadriform.motion.cycle_equations import CyclePosterior, LinearCycleProblem
from quadriform.motion.energies import InSpace
from quadriform.motion.slice_motions import SliceNumbers, SlicePlanes
from quadriform.motion.slice_prior import SliceState
from quadriform.points import Array
from quadriform.shapes.control_box import ControlBox
from quadriform.shapes.posterior import SAMPLES, SEED
from quadriform.shapes.splines import TimeBasis
from quadriform.shapes.superquadric import Superquadric

TANGENTIAL_STEPS = 3
"""Gauss-Newton steps of each foot point in a round; the next round continues from there."""
LEAST_INLIERS = 0.5
"""A surface with a smaller mean inlier probability in a frame is still far from its points: their inlier probabilities
are then those at a sigma that is estimated from this surface and frame alone."""


def named(frame: int, surface: str) -> str:
    """The name of the points of a surface in a frame, for what is known of their noise."""
    return f"frame {frame}: {surface}"


@dataclass(frozen=True)
class CycleFit:
    """The fitted cycle.

    Attributes:
        control_points: (K, l, m, n, 3), at the knots, of boxes with l x m x n control points.
        datasets: for each frame the surfaces with their points, moved with their slices, and inlier probabilities.
        sigma: standard deviation of the inliers' point-to-plane residuals.
        least_sigma: what is known of it, or zero.
        strengths: alpha in space, gamma in time, both per data point.
        slices: the motions of the slices; of none without slice numbers.
        verified: whether each frame is verified to be free of folds.
        sigma_before: sigma of the fit with folds, where these could not be removed at its strengths and within the
            accepted noise; else None, also where folds were removed in that way.
        posterior: of the displacements at the knots and of the motions of slices.
        prior_distances: of the frames to the population of a prior; empty without one.
    """

    control_points: Array
    datasets: tuple[dict[str, SurfaceData], ...]
    sigma: float
    least_sigma: float
    strengths: tuple[float, float]
    slices: SliceState
    verified: tuple[bool, ...]
    sigma_before: float | None = None
    posterior: CyclePosterior | None = None
    prior_distances: tuple[float, ...] = ()

    @property
    def motion_covariance(self) -> Array:
        """The posterior covariance (6 S, 6 S) of the motions of slices; infinite variances without a posterior."""
        if self.posterior is None:
            return np.diag(np.full(self.slices.motions.size, np.inf))
        return self.posterior.covariance


@dataclass(frozen=True)
class CycleState:
    """The state between two rounds.

    Attributes:
        displacement: (K, k, 3), of the control points from the undeformed box, at the knots in time.
        slices: their motions.
        boxes: the deformed box of each frame, by the splines.
        datasets: for each frame one for each surface.
        sigma: standard deviation of the inliers' point-to-plane residuals.
        fold_penalties: for each frame.
        fraction: independent points over all points, in (0, 1]; see `Cycle.effective_fraction`.
    """

    displacement: Array
    slices: SliceState
    boxes: list[ControlBox]
    datasets: list[list[SurfaceData]]
    sigma: float
    fold_penalties: list[JacobianPenalty]
    fraction: float = 1.0

    def with_estimated_prior(self) -> "CycleState":
        """The state with the prior of the motions of slices that the last round estimated."""
        return replace(self, slices=self.slices.with_estimate(self.independent_sigma))

    @property
    def independent_sigma(self) -> float:
        """Sigma at which independent points would have the information of all."""
        return float(self.sigma / np.sqrt(self.fraction))

    def nearest(self) -> "CycleState":
        """The state with the nearest foot points."""
        datasets = [
            [data.with_nearest_foot_points(box) for data in each] for box, each in zip(self.boxes, self.datasets)
        ]
        return replace(self, datasets=datasets)


@dataclass(frozen=True)
class Cycle:
    """A cycle to be fitted.

    Attributes:
        surfaces: name -> superquadric.
        box: undeformed, around the outermost surface.
        frames: name -> points, for each frame.
        splines_at_frames: (F, K), values of the splines.
        basis: the splines.
        in_space: what is known of the shape at any one time.
        robust: whether outliers are down-weighted.
        planes: of the slices whose motions are sought, with the slice number of each point; or None.
        known_noise: of the points of each frame and surface, under the name that `named` gives.
        bases: where the data of each frame ends on purpose, or None.
    """

    surfaces: Mapping[str, Superquadric]
    box: ControlBox
    frames: Sequence[Mapping[str, Array]]
    splines_at_frames: Array
    basis: TimeBasis
    in_space: InSpace
    robust: bool
    planes: tuple[SlicePlanes, SliceNumbers] | None
    known_noise: KnownNoise
    bases: Sequence[HalfSpace | None]

    @property
    def shape(self) -> tuple[int, int, int]:
        """Control points along each axis."""
        l, m, n, _ = self.box.control_points.shape
        return l, m, n

    def init(self) -> CycleState:
        """The undeformed box in all frames, with the nearest foot points."""
        datasets = [
            [self._data(number, name, points) for name, points in frame.items()]
            for number, frame in enumerate(self.frames)
        ]
        distances = np.concatenate([data.standardised_distances(self.box) for frame in datasets for data in frame])
        sigma = MAD_TO_SIGMA * float(np.median(distances))
        # a penalty is weighed against the points of its frame: the other frames have about as many as the first
        count, frames = sum(len(cloud) for cloud in self.frames[0].values()), len(self.frames)
        penalty = JacobianPenalty.of(self.box, self.surfaces, count, sigma)
        displacement = np.zeros((self.splines_at_frames.shape[1], self.box.rest.size // 3, 3))
        slices = SliceState.first(None if self.planes is None else self.planes[0], sigma)
        return CycleState(displacement, slices, [self.box] * frames, datasets, sigma, [penalty] * frames)

    def _data(self, frame: int, name: str, points: Array) -> SurfaceData:
        covariances, least = self.known_noise.relative.get(named(frame, name)), self.known_noise.least_sigma
        surface, ones = self.surfaces[name], np.ones(len(points))
        found = SurfaceData.of(surface, points, ones, self.bases[frame], None, covariances, least)
        return found.with_nearest_foot_points(self.box)

    def extremes(self, state: CycleState) -> tuple[int, int]:
        """The frames of the least and of the largest sum of squared distances to the surfaces of a state.

        The sum is over all points of a frame: of equally near frames the one with more points counts as farther.
        """
        squares = [
            sum((data.distances(box) ** 2).sum() for data in each) for box, each in zip(state.boxes, state.datasets)
        ]
        order = np.argsort(squares, kind="stable")
        return int(order[0]), int(order[-1])

    def strength_in_space(
        self, state: CycleState, frames: Sequence[int], near: float | None, before_rounds: bool = False
    ) -> float:
        """The smallest of the best strengths in space of some frames, each alone, as in a single fit.

        A larger one would over-smooth one of them. Maximising the marginal likelihood over the whole cycle could give
        a strength in space near zero, since smoothness in time regularises the surface, but not the space inside.

        Args:
            state: after a round.
            frames: their indices.
            near: an earlier strength, or None.
            before_rounds: whether there was no round yet; then only as many points count as there are unknowns (see
                `independent_fraction`).
        """
        unknowns, least_sigma, found = float(self.box.rest.size), self.known_noise.least_sigma, []
        for frame in frames:
            box, datasets = state.boxes[frame], state.datasets[frame]
            fraction = independent_fraction(tuple(datasets), None if before_rounds else box, unknowns)
            found.append(self.in_space.best_strength(datasets, box, fraction, least_sigma, near))
        return min(found)

    def effective_fraction(self, state: CycleState, before_rounds: bool = False) -> float:
        """Number of independent points over that of all points, of all frames together.

        Points whose errors are correlated count by an effective number (`independent_fraction`), which is never taken
        smaller than the number of unknowns that they determine. For one frame of a cycle that is its part of all
        unknowns, 3 k K / F: at most the 3 k of a single fit.
        """
        least, every = state.displacement.size / len(self.frames), zip(state.boxes, state.datasets)
        found = [independent_fraction(tuple(each), None if before_rounds else box, least) for box, each in every]
        counts = [sum(float((data.weights * data.inliers).sum()) for data in each) for each in state.datasets]
        return float(np.average(found, weights=counts))

    def result(
        self,
        state: CycleState,
        strengths: tuple[float, float],
        verified: tuple[bool, ...],
        sigma_before: float | None = None,
    ) -> CycleFit:
        """The fit with the results of a state."""
        control = state.displacement.reshape(-1, *self.shape, 3) + self.box.rest
        datasets = tuple(dict(zip(frame, each)) for frame, each in zip(self.frames, state.datasets))
        least, slices = self.known_noise.least_sigma, state.slices
        posterior = self.posterior(state, strengths)
        return CycleFit(control, datasets, state.sigma, least, strengths, slices, verified, sigma_before, posterior)

    def posterior(self, state: CycleState, strengths: tuple[float, float]) -> CyclePosterior | None:
        """The posterior of displacements and motions, at the foot points and inlier probabilities of a state."""
        equations = [_sum(each, box) for each, box in zip(_penalties(state), state.boxes)]
        linear = self.linear_problem(state).with_extra_terms(equations)
        normal = np.random.default_rng(SEED).normal(size=(SAMPLES, len(linear.right)))
        return linear.posterior(*strengths, state.sigma, normal)

    def step(self, state: CycleState, strengths: tuple[float, float], widening: float = 1.0) -> CycleState | None:
        """The state after a round: foot points, inlier probabilities, and a step to the solution of the linear problem.

        The step is shortened until `total` decreases. None where the linear problem is singular.

        Args:
            state: before the round.
            strengths: in space and in time.
            widening: factor on sigma where outliers are sought.
        """
        state = replace(state, datasets=self._updated(state, widening))
        linear, penalties = self.linear_problem(state), _penalties(state)
        equations = [_sum(each, box) for each, box in zip(penalties, state.boxes)]
        solution = linear.with_extra_terms(equations).solve(*strengths)
        if solution is None:
            return None
        displacement_step = solution.displacement - state.displacement
        motions = state.slices.motions.ravel()
        motion_step = solution.motions - motions

        def at(length: float) -> tuple[Array, Array]:
            """Displacements and motions of slices at a fraction of the step."""
            return state.displacement + length * displacement_step, motions + length * motion_step

        def total_at(length: float) -> float:
            """The whole cost at a fraction of the step."""
            return self.total(state, linear, penalties, *at(length), strengths)

        displacement, found = at(step_length(total_at))
        slices = state.slices.after(found, solution, solution.sigma / float(np.sqrt(state.fraction)))
        return replace(
            state,
            displacement=displacement,
            slices=slices,
            boxes=self._boxes(displacement),
            datasets=self._moved(state.datasets, slices.motions),
            sigma=solution.sigma,
        )

    def total(
        self,
        state: CycleState,
        linear: LinearCycleProblem,
        penalties: Sequence[Sequence[Penalty]],
        displacement: Array,
        motions: Array,
        strengths: tuple[float, float],
    ) -> float:
        """The sum that a round lowers: squared distances, regularisation, and the penalties of each frame."""
        costs = [each.cost(box) for of, box in zip(penalties, self._boxes(displacement)) for each in of]
        return linear.cost(displacement, motions, *strengths) + sum(costs)

    def _boxes(self, displacement: Array) -> list[ControlBox]:
        rest = self.box.rest
        # control points at the knots, times the splines at the frames
        in_time = np.einsum("fa,akc->fkc", self.splines_at_frames, displacement).reshape(-1, *rest.shape)
        return [self.box.with_control_points(rest + each) for each in in_time]

    def _updated(self, state: CycleState, widening: float) -> list[list[SurfaceData]]:
        """Data with new foot points, errors beyond the known ones, and inlier probabilities."""
        every = [(data, box) for box, datasets in zip(state.boxes, state.datasets) for data in datasets]
        moved = [data.with_tangential_steps(box, TANGENTIAL_STEPS) for data, box in every]
        boxes = [box for _, box in every]
        updated = with_excess(moved, boxes)
        if self.robust:
            updated = tuple(_weighted(data, box, widening * state.sigma) for data, box in zip(updated, boxes))
        of_frames = iter(updated)
        return [[next(of_frames) for _ in datasets] for datasets in state.datasets]

    def _moved(self, datasets: list[list[SurfaceData]], motions: Array) -> list[list[SurfaceData]]:
        """Data whose points move with their slices."""
        if self.planes is None:
            return datasets
        planes, slices = self.planes
        result = []
        for frame, each, numbers in zip(self.frames, datasets, slices):
            clouds = [planes.moved(motions, numbers[name], points) for name, points in frame.items()]
            result.append([replace(data, points=points) for data, points in zip(each, clouds)])
        return result

    def linear_problem(self, state: CycleState) -> LinearCycleProblem:
        """The linear problem of a round as a function of the strengths."""
        equations, rows, count = [], [], 0.0
        for frame, (box, datasets) in enumerate(zip(state.boxes, state.datasets)):
            found = self._rows(state, frame)
            parts = [row.equations(box) for row in found]
            equations.append(sum(parts[1:], parts[0]))
            count += sum(float((data.weights * data.inliers).sum()) for data in datasets)
            if self.planes:
                rows.append(list(zip(found, self.planes[1][frame].values(), self.frames[frame].values())))
        bordered = None  # the rows and columns of the motions beside the matrix of the control points
        if self.planes:
            coupling, own, right = self.planes[0].bordered_block(rows, state.boxes, state.slices.motions)
            bordered = coupling, own + state.slices.penalty, right
        return LinearCycleProblem(
            equations,
            self.splines_at_frames,
            self.basis,
            self.in_space.energy(state.boxes),
            count,
            bordered,
            state.fraction,
            self.known_noise.least_sigma,
        )

    def _rows(self, state: CycleState, frame: int) -> list[Rows]:
        """The terms of each surface in a frame; with slices their targets are those where all motions are zero."""
        found = [data_rows(data, state.boxes[frame]) for data in state.datasets[frame]]
        if self.planes is None:
            return found
        (planes, slices), motions = self.planes, state.slices.motions
        parts = zip(found, slices[frame].values(), self.frames[frame].values())
        return [replace(rows, targets=planes.targets(motions, numbers, points)) for rows, numbers, points in parts]

    def with_checked_folds(self, state: CycleState) -> tuple[tuple[bool, ...], CycleState]:
        """Which frames are verified to be free of folds, and the state with stronger penalties on the others."""
        found = [penalty.check(box, self.surfaces) for penalty, box in zip(state.fold_penalties, state.boxes)]
        penalties = [penalty if verified else penalty.stronger() for verified, penalty in found]
        return tuple(verified for verified, _ in found), replace(state, fold_penalties=penalties)


def _penalties(state: CycleState) -> list[list[Penalty]]:
    """The penalties of each frame: that on folds, and the priors on the surfaces beyond its base."""
    every = zip(state.fold_penalties, state.datasets, state.boxes)
    return [[folds, *base_priors(datasets, box)] for folds, datasets, box in every]


def _sum(penalties: Sequence[Penalty], box: ControlBox) -> NormalEquations:
    parts = [penalty.equations(box) for penalty in penalties]
    return sum(parts[1:], parts[0])


def _weighted(data: SurfaceData, box: ControlBox, sigma: float) -> SurfaceData:
    """The data with inlier probabilities at the noise of the cycle, or at its own while most points are far."""
    found = data.with_inliers(box, sigma)
    if np.average(found.inliers, weights=data.weights) >= LEAST_INLIERS:
        return found
    return data.with_inliers(box, MAD_TO_SIGMA * float(np.median(data.standardised_distances(box))))
