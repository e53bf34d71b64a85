"""Cycles of a member of a population: its energy in each frame, where the rounds begin, and how folds are removed.

The pose of the population is that of each frame, by the rigid motion from the mean shape to the shape of the frame.
Between them the beating of a heart rotates it by several degrees, and the modes with it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from quadriform.fitting.population.coordinates import PriorCoordinates
from quadriform.fitting.population.fit import without_folds
from quadriform.fitting.population.linear_problem import PriorProblem
from quadriform.fitting.population.poses import Similarity, best_pose
from quadriform.fitting.refinement.point_to_plane import data_rows
from quadriform.fitting.refinement.surface_data import SurfaceData
from quadriform.fitting.refinement.unfolding import certified
from quadriform.motion.cycle import Cycle, CycleFit, CycleState
from quadriform.motion.cycle_rounds import Report, Strengths, first_state
from quadriform.motion.energies import Energy, box_mass
from quadriform.points import Array
from quadriform.shapes.control_box import ControlBox
from quadriform.shapes.prior import ShapePrior
from quadriform.shapes.splines import TimeBasis


@dataclass(frozen=True)
class Population:
    """A member of a population in each frame, in a pose of its own.

    Attributes:
        prior: of the population, in the pose of one frame.
        ratio: rho, the variance of its modes relative to the freedom outside of them.
        first_factor: each frame begins as a member that is near its points.
    """

    prior: ShapePrior
    ratio: float
    first_factor: float = 1.0

    @cached_property
    def _coordinates(self) -> PriorCoordinates:
        return PriorCoordinates.of(self.prior)

    def at(self, box: ControlBox) -> PriorCoordinates:
        """The coordinates of the prior in the pose of a deformed box, about the undeformed box of the prior."""
        motion, rest = Similarity.between(self.prior, box), self.prior.box.control_points.reshape(-1, 3)
        mean = motion.size * (rest + self.prior.mean) @ motion.rotation.T + motion.shift - rest
        directions = self._coordinates.directions
        by_axis = directions.reshape(len(rest), 3, -1)
        rotated = np.einsum("ij,hjq->hiq", motion.rotation, by_axis).reshape(directions.shape)
        return replace(self._coordinates, mean=mean, directions=rotated)

    def energy(self, boxes: Sequence[ControlBox]) -> Energy:
        """The energy with the poses of the boxes of all frames."""
        return PopulationEnergy.of([self.at(box) for box in boxes], self.ratio, self.prior.box)

    def best_strength(
        self, datasets: Sequence[SurfaceData], box: ControlBox, fraction: float, least_sigma: float, near: float | None
    ) -> float:
        """The best strength alpha for the data of one frame, near an earlier one."""
        parts = [data_rows(data, box).equations(box) for data in datasets]
        total, equations = sum(data.total_weight for data in datasets), sum(parts[1:], parts[0])
        return PriorProblem(equations, self.at(box), total, fraction, least_sigma, self.ratio).best(near).strength


@dataclass(frozen=True)
class PopulationEnergy:
    """The mean over the frames of (u - m)' Q (u - m), where rigid motions of the mean shape cost nothing.

    Attributes:
        basis, inverse, mass: as of `Energy`.
        means: (F, 3 k), of the frames, in coordinates.
        directions: (F, 3 k, q), U of each frame.
        weights: (q,), w of these; one minus w is `complements`, in which no digits are lost.
        complements: (q,).
        n_rigid: the number of rigid motions, the first of the directions.
    """

    basis: Array
    inverse: Array
    mass: Array
    means: Array
    directions: Array
    weights: Array
    complements: Array
    n_rigid: int

    @classmethod
    def of(cls, poses: Sequence[PriorCoordinates], ratio: float, box: ControlBox) -> PopulationEnergy:
        """Of a prior in the poses of all frames."""
        one, (l, m, n, _) = poses[0], box.control_points.shape
        mass = np.kron(one.basis.T @ box_mass((l, m, n)) @ one.basis, np.eye(3)).astype(np.float64)
        return cls(
            one.basis,
            one.root.T,
            mass,
            np.stack([(each.root.T @ each.mean).ravel() for each in poses]),
            np.stack([each.directions for each in poses]),
            one.weights(ratio),
            np.concatenate([np.zeros(one.n_rigid), 1 / (1 + ratio * one.squares)]),
            one.n_rigid,
        )

    @property
    def null_dimension(self) -> int:
        """The number of rigid motions."""
        return self.n_rigid

    @cached_property
    def _matrices(self) -> Array:
        """The matrices (F, 3 k, 3 k) of the frames."""
        scaled = self.directions * np.sqrt(self.weights)
        return np.asarray(np.eye(scaled.shape[1]) - scaled @ scaled.transpose(0, 2, 1), dtype=np.float64)

    @cached_property
    def _of_means(self) -> Array:
        """The products (F, 3 k) of the matrices and means."""
        return np.einsum("fij,fj->fi", self._matrices, self.means)

    @property
    def constant(self) -> float:
        """The energy at displacements of zero."""
        return float((self.means * self._of_means).sum() / len(self.means))

    def time_mass(self, basis: TimeBasis, splines_at_frames: Array) -> Array:
        """The matrix (K, K) of the mean over the frames of a square."""
        return np.asarray(splines_at_frames.T @ splines_at_frames / len(splines_at_frames), dtype=np.float64)

    def add(self, matrix: Array, factor: float, splines: Array) -> None:
        """Add `factor` R, of one pair of eigenvectors in time after the other."""
        size, count = self.means.shape[1], splines.shape[1]
        for a in range(count):
            for b in range(count):
                pairs = splines[:, a] * splines[:, b] / len(splines)
                block = np.s_[a * size : (a + 1) * size, b * size : (b + 1) * size]
                matrix[block] += factor * np.tensordot(pairs, self._matrices, 1)

    def right(self, splines: Array) -> Array:
        """The right side r (K 3 k,)."""
        return np.asarray((splines.T @ self._of_means).ravel() / len(splines), dtype=np.float64)

    def value(self, coordinates: Array, splines: Array) -> float:
        """The energy at p (K, 3 k)."""
        deviations = splines @ coordinates - self.means
        along = np.einsum("fiq,fi->fq", self.directions, deviations)
        return float(((deviations**2).sum() - (along**2 @ self.weights).sum()) / len(splines))

    def log_determinant(self, alpha: float, gamma: float) -> float:
        """The logarithm, as if the poses of all frames were that of the first, by Woodbury's identity.

        With d and V the eigenvalues and eigenvectors of M, A = V' U and e = gamma d / (alpha + gamma d) it is

            sum log(alpha + gamma d) + log|I - w + w^(1/2) A' diag(e) A w^(1/2)|.
        """
        if gamma <= 0:
            count, others = self.means.shape[1] - self.n_rigid, self.complements[self.n_rigid :]
            return float(count * np.log(alpha) + np.log(others).sum()) if alpha > 0 else 0.0
        values, along = self._of_mass
        whole, scaled = alpha + gamma * values, along * np.sqrt(self.weights)
        small = np.diag(self.complements) + scaled.T @ ((gamma * values / whole)[:, None] * scaled)
        return float(np.log(whole).sum() + np.linalg.slogdet(small)[1])

    @cached_property
    def _of_mass(self) -> tuple[Array, Array]:
        """The eigenvalues of M, and V' U."""
        values, vectors = np.linalg.eigh(self.mass)
        return np.maximum(values, 0.0), np.asarray(vectors.T @ self.directions[0], dtype=np.float64)


@dataclass(frozen=True)
class AsMembers:
    """Each frame begins with the pose and the scores of the modes that are nearest to its points.

    Penalties on folds would contradict the population, whose modes say nothing about the space inside: folds are
    removed after the rounds, with the surfaces held.

    Attributes:
        prior: the population, in the pose of one frame.
    """

    prior: ShapePrior

    def rounds(self, cycle: Cycle) -> int:
        """The number of frames."""
        return len(cycle.frames)

    def first(self, cycle: Cycle, undeformed: CycleState, report: Report) -> CycleState:
        """The state of the members that are nearest."""
        boxes = []
        for datasets in undeformed.datasets:
            boxes.append(best_pose([self.prior], datasets, cycle.robust)[1])
            report.round()
        first = _with_boxes(cycle, undeformed, boxes)
        return replace(first, fold_penalties=[replace(each, weight=0.0) for each in first.fold_penalties])

    def unfolded(self, cycle: Cycle, first: CycleState, state: CycleState, strengths: Strengths) -> CycleFit:
        """The fit whose frames that fold have nearly the same surfaces without folds."""
        # of the members themselves: when folds are removed, points of a surface may move along it
        distances = tuple(_distance(self.prior, box) for box in state.boxes)
        found = replace(cycle.result(state, strengths, (True,) * len(state.boxes)), prior_distances=distances)
        if all(certified(box, cycle.surfaces) for box in state.boxes):
            return found
        boxes = [self._unfolded(cycle, found, frame, box) for frame, box in enumerate(state.boxes)]
        state = _with_boxes(cycle, state, boxes)
        verified = tuple(certified(box, cycle.surfaces) for box in state.boxes)
        unfolded = cycle.result(state, strengths, verified)
        return replace(unfolded, posterior=found.posterior, prior_distances=distances)

    def _unfolded(self, cycle: Cycle, found: CycleFit, frame: int, box: ControlBox) -> ControlBox:
        if certified(box, cycle.surfaces) or found.posterior is None:
            return box
        samples = np.tensordot(cycle.splines_at_frames[frame], found.posterior.deviations, (0, 1))

        def deviation(origins: Array, normals: Array) -> Array:
            """The standard deviations (n,) of a surface along its normals, at points before deformation."""
            moved = np.einsum("nk,ski,ni->sn", box.matrix(origins), samples, normals, optimize=True)
            return np.sqrt((moved**2).mean(axis=0))

        return without_folds(cycle.surfaces, box, deviation, found.sigma) or box


def _distance(prior: ShapePrior, box: ControlBox) -> float:
    """The Mahalanobis distance of a shape to the mean of a population in any pose (`ShapePrior.distance`)."""
    moved = Similarity.between(prior, box).moved(prior)
    return moved.distance(box.control_points - moved.box.control_points)


def _with_boxes(cycle: Cycle, state: CycleState, boxes: Sequence[ControlBox]) -> CycleState:
    """The state whose splines in time are nearest to deformed boxes of all frames."""
    control = np.stack([box.control_points.ravel() for box in boxes])
    at_knots = np.linalg.pinv(cycle.splines_at_frames) @ control
    at_frames = (cycle.splines_at_frames @ at_knots).reshape(len(boxes), *cycle.box.rest.shape)
    smooth = [cycle.box.with_control_points(each) for each in at_frames]
    return first_state(cycle, state, at_knots.reshape(len(at_knots), -1, 3), smooth)
