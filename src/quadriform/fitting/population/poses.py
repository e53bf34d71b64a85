"""Where a fit with a prior begins: poses of the mean shape, each improved with the modes, and the best one of them.

First the mean shape is moved rigidly to the data from many rotations, by iterated closest points (ICP). Then pose and
scores of the modes are estimated together from the best of these.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from quadriform.fitting.cloud import canonical_order, evenly_spread
from quadriform.fitting.population.coordinates import rigid_motions
from quadriform.fitting.refinement.point_to_plane import data_rows
from quadriform.fitting.refinement.stage import MixtureWeights
from quadriform.fitting.refinement.surface_data import SurfaceData
from quadriform.points import Array, rigid_motion
from quadriform.shapes.control_box import ControlBox
from quadriform.shapes.prior import ShapePrior
from quadriform.shapes.superquadric import Superquadric


@dataclass(frozen=True)
class PoseSearch:
    """The constants of the search for a pose."""

    points: int = 150
    """Of each surface for closest points: they determine six numbers."""
    cells: int = 12
    """Of the grid of the mean shape: 866 points, a few hundredths of its size apart."""
    angles: int = 8
    """Rotations about each principal axis of the mean shape at which a search starts: a body of revolution such as a
    heart is distinguished from itself in another rotation by details alone."""
    first_rounds: int = 5
    """Of closest points from all rotations; then several have come to the same pose, and bad ones are known."""
    most_promising: int = 20
    """Poses that continue."""
    last_rounds: int = 10
    """Of these; most have converged by then."""
    trimmed: float = 0.8
    """Fraction of the nearest points by which poses are compared and improved, lest outliers decide."""
    directions: int = 4
    """Of the axis of the mean shape that differs most from the others, in which a pose is improved with the modes. A
    body that is upside down may be nearer to the mean shape, and is not nearer with the modes."""
    best_directions: int = 2
    """Of these continue, each with all rotations about that axis."""
    same_direction: float = np.radians(45.0)
    """Directions that differ by less are the same."""
    same_angle: float = np.radians(10.0)
    """Poses that differ by less in their rotation have converged to the same one."""
    mode_points: int = 400
    """Of each surface in the rounds with modes."""
    first_mode_rounds: int = 5
    """Of all these poses; with fewer, good ones are not yet known."""
    best: int = 3
    """Of the poses continue."""
    last_mode_rounds: int = 5
    tangential_steps: int = 3
    """Of each foot point in a round with modes."""
    least_deviation: float = 1e-3
    """Of the distances, in RMS radii: of poses of exact data that are nearer than this, the scores decide."""


POSES = PoseSearch()


def best_pose(
    poses: Sequence[ShapePrior], datasets: Sequence[SurfaceData], robust: bool
) -> tuple[ShapePrior, ControlBox]:
    """The prior in the pose, and the deformed box, in which pose and modes come nearest to the data.

    Args:
        poses: the prior where the search begins.
        datasets: of each surface, in the order of those of the prior.
        robust: whether outliers are down-weighted.
    """
    some = [data.subsample(POSES.mode_points, robust) for data in datasets]
    first = _improved([WithModes.at(pose, some) for pose in poses], POSES.first_mode_rounds, robust)
    if len(poses) > 1:  # from a given pose nothing else is searched
        first = first[: POSES.best_directions]
        others = [WithModes.at(pose, some) for each in first for pose in _rotated_about_axis(each.prior)]
        first = sorted([*first, *_improved(others, POSES.first_mode_rounds, robust)], key=_criterion)
    best = _improved(first[: POSES.best], POSES.last_mode_rounds, robust)[0]
    return best.prior, best.box


def _improved(states: Sequence[WithModes], rounds: int, robust: bool) -> list[WithModes]:
    """The states after rounds, the best one first."""
    return sorted((each.after_rounds(rounds, robust) for each in states), key=_criterion)


def _criterion(state: WithModes) -> float:
    return state.criterion


def _rotated_about_axis(prior: ShapePrior) -> list[ShapePrior]:
    """The prior after rotations of its mean shape about the axis that differs most from the others."""
    model = prior.mean_model()
    points = np.concatenate([model.mesh(name, POSES.cells).vertices for name in model.surfaces])
    centre, axis = points.mean(axis=0), _axes(points)[0]
    angles = 2 * np.pi * np.arange(1, POSES.angles) / POSES.angles
    rotations = [Rotation.from_rotvec(angle * axis).as_matrix() for angle in angles]
    return [prior.moved(each, centre - each @ centre) for each in rotations]


def on_superquadrics(prior: ShapePrior, superquadrics: Mapping[str, Superquadric]) -> ShapePrior:
    """The prior moved so that the first of its superquadrics lies on a given one, centre on centre, axes on axes."""
    name, own = next(iter(prior.surfaces.items()))
    rotation = superquadrics[name].rotation @ own.rotation.T
    return prior.moved(rotation, superquadrics[name].translation - rotation @ own.translation)


def closest_poses(prior: ShapePrior, clouds: Mapping[str, Array]) -> list[ShapePrior]:
    """The prior in the poses in which the mean shape is nearest to points (n, 3) by name; the best one first."""
    model = prior.mean_model()
    targets = {name: model.mesh(name, POSES.cells).vertices for name in clouds}
    search = _ClosestPoints(targets, {name: _some(each) for name, each in clouds.items()})
    found = search.after_rounds(search.starts(), POSES.first_rounds).different()
    found = found.at(list(range(min(len(found.distances), POSES.most_promising))))
    found = search.after_rounds(found, POSES.last_rounds).different().in_all_directions(search.axis)
    return [prior.moved(rotation, shift) for rotation, shift in zip(found.rotations, found.shifts)]


def _some(points: Array) -> Array:
    return points[evenly_spread(canonical_order(points - points.mean(axis=0)), POSES.points)]


@dataclass(frozen=True)
class _Poses:
    """Rotations (p, 3, 3) and shifts (p, 3) of the mean shape, and trimmed mean squares (p,) of distances to points."""

    rotations: Array
    shifts: Array
    distances: Array

    def at(self, index: list[int]) -> _Poses:
        """Some of the poses."""
        return _Poses(self.rotations[index], self.shifts[index], self.distances[index])

    def different(self) -> _Poses:
        """The poses, the nearest one first, without those that have the rotation of a nearer one."""
        # the trace of a rotation is 1 + 2 cos of its angle
        traces = np.tensordot(self.rotations, self.rotations, ((1, 2), (1, 2)))
        same, kept = traces > 1 + 2 * np.cos(POSES.same_angle), list[int]()
        for index in np.argsort(self.distances, kind="stable"):
            if not same[index, kept].any():
                kept.append(int(index))
        return self.at(kept)

    def in_all_directions(self, axis: Array) -> _Poses:
        """The first pose for each of a few directions of an axis (3,) of the mean shape."""
        directions, kept = self.rotations @ axis, list[int]()
        for index, direction in enumerate(directions):
            if all(directions[each] @ direction < np.cos(POSES.same_direction) for each in kept):
                kept.append(index)
        return self.at(kept[: POSES.directions])


@dataclass(frozen=True)
class _ClosestPoints:
    """Iterated closest points (ICP) of the mean shape to the data, from many poses at once.

    Attributes:
        targets: name -> points (m, 3) of the mean shape.
        clouds: name -> points (n, 3) of the data.
    """

    targets: Mapping[str, Array]
    clouds: Mapping[str, Array]

    @cached_property
    def _trees(self) -> dict[str, cKDTree]:
        return {name: cKDTree(each) for name, each in self.targets.items()}

    @cached_property
    def _points(self) -> Array:
        """The points (n, 3) of all clouds."""
        return np.concatenate(list(self.clouds.values()))

    @cached_property
    def axis(self) -> Array:
        """The axis (3,) of the mean shape whose extent differs most from the others'."""
        return _axes(np.concatenate([self.targets[name] for name in self.clouds]))[0]

    def starts(self) -> _Poses:
        """Poses with the centres of both on each other: unrotated, and with principal axes on each other."""
        rotations = np.array(list(_rotations(self.targets, self.clouds)))
        middle = np.concatenate([self.targets[name] for name in self.clouds]).mean(axis=0)
        shifts = self._points.mean(axis=0) - rotations @ middle
        return _Poses(rotations, shifts, np.full(len(rotations), np.inf))

    def after_rounds(self, poses: _Poses, rounds: int) -> _Poses:
        """The poses after rounds in which each moves the mean shape's nearest points to the data."""
        rotations, shifts = poses.rotations, poses.shifts
        for _ in range(rounds):
            near, squares, kept = self._nearest(rotations, shifts)
            rotations, shifts = rigid_motion(near, self._points, kept.astype(np.float64))
        _, squares, kept = self._nearest(rotations, shifts)
        return _Poses(rotations, shifts, np.asarray((squares * kept).sum(axis=1) / kept.sum(axis=1)))

    def _nearest(self, rotations: Array, shifts: Array) -> tuple[Array, Array, NDArray[np.bool_]]:
        """Nearest points (p, n, 3) of the unmoved mean shape, squares (p, n) of distances, and which of them count."""
        near, squares = [], []
        for name, points in self.clouds.items():
            distances, index = self._trees[name].query((points - shifts[:, None]) @ rotations)
            near.append(self.targets[name][index])
            squares.append(distances**2)
        every = np.concatenate(squares, axis=1)
        return np.concatenate(near, axis=1), every, every <= np.quantile(every, POSES.trimmed, axis=1)[:, None]


def _rotations(targets: Mapping[str, Array], clouds: Mapping[str, Array]) -> Iterator[Array]:
    """Rotations at which a search starts: none, and those between principal axes, each rotated about these."""
    yield np.eye(3)
    of_mean, of_data = (_axes(np.concatenate(list(each.values()))) for each in (targets, clouds))
    # the axis of the mean that differs most from the others goes to each axis of the data, both ways round
    for axis in range(3):
        for sign in (1.0, -1.0):
            first = _between(of_mean[0], sign * of_data[axis])
            for angle in 2 * np.pi * np.arange(POSES.angles) / POSES.angles:
                yield Rotation.from_rotvec(angle * sign * of_data[axis]).as_matrix() @ first


def _axes(points: Array) -> Array:
    """Principal axes as rows (3, 3), the one first whose extent differs most from the others'."""
    _, extents, axes = np.linalg.svd(points - points.mean(axis=0), full_matrices=False)
    ratios = extents[:-1] / extents[1:]
    order = [0, 1, 2] if ratios[0] >= ratios[1] else [2, 0, 1]
    return np.asarray(axes[order], dtype=np.float64)


def _between(one: Array, other: Array) -> Array:
    """A rotation (3, 3) that maps one unit vector to another."""
    return np.asarray(Rotation.align_vectors(other[None], one[None])[0].as_matrix(), dtype=np.float64)


@dataclass(frozen=True)
class Similarity:
    """The motion x -> size rotation x + shift from the mean shape of a prior to a deformed box, by least squares.

    Attributes:
        rotation: (3, 3).
        shift: (3,).
        size: one, unless sizes are estimated.
    """

    rotation: Array
    shift: Array
    size: float

    @classmethod
    def between(cls, prior: ShapePrior, box: ControlBox) -> Similarity:
        """From the mean shape to the shape of a box with the rest position of that of the prior."""
        origins = np.concatenate([surface.grid(POSES.cells)[0] for surface in prior.surfaces.values()])
        mean, now = prior.mean_model().box.deform(origins), box.deform(origins)
        rotation, _ = rigid_motion(mean, now)
        middle, centre = mean.mean(axis=0), now.mean(axis=0)
        rotated, size = (mean - middle) @ rotation.T, 1.0
        if prior.any_size:
            size = float(np.sum((now - centre) * rotated) / np.sum(rotated**2))
        return cls(rotation, centre - size * rotation @ middle, size)

    def moved(self, prior: ShapePrior) -> ShapePrior:
        """The prior after the motion."""
        return prior.moved(self.rotation, self.shift, self.size)

    def with_surfaces(self, datasets: Sequence[SurfaceData], prior: ShapePrior) -> tuple[SurfaceData, ...]:
        """The data with the surfaces of the prior after the motion, and foot points that moved with them."""
        return tuple(
            replace(data, superquadric=each, origins=self.size * data.origins @ self.rotation.T + self.shift)
            for data, each in zip(datasets, prior.surfaces.values())
        )


def near_data(datasets: Sequence[SurfaceData], prior: ShapePrior, box: ControlBox) -> tuple[SurfaceData, ...]:
    """Data with the surfaces of a prior and foot points near them, the nearest ones of a grid on a deformed box."""
    found = list[SurfaceData]()
    for data, surface in zip(datasets, prior.surfaces.values()):
        origins = surface.grid(POSES.cells)[0]
        _, index = cKDTree(box.deform(origins)).query(data.points)
        found.append(replace(data, superquadric=surface, origins=origins[index]))
    return tuple(found)


def on_data(datasets: Sequence[SurfaceData], prior: ShapePrior, box: ControlBox) -> tuple[SurfaceData, ...]:
    """Data with the surfaces of a prior and the nearest foot points on a deformed box."""
    with_surfaces = [data.with_superquadric(each) for data, each in zip(datasets, prior.surfaces.values())]
    return tuple(data.with_nearest_foot_points(box) for data in with_surfaces)


@dataclass(frozen=True)
class WithModes:
    """A pose with modes, whose scores have the distribution of the population; no freedom outside of the modes.

    Attributes:
        prior: in this pose.
        box: deformed.
        datasets: of each surface.
        criterion: minus twice the log of the likelihood of the data times the prior of the scores, up to a constant;
            before the last round.
    """

    prior: ShapePrior
    box: ControlBox
    datasets: tuple[SurfaceData, ...]
    criterion: float = np.inf

    @classmethod
    def at(cls, prior: ShapePrior, datasets: Sequence[SurfaceData]) -> WithModes:
        """The mean shape in the pose of a prior."""
        box = prior.mean_model().box
        return cls(prior, box, near_data(datasets, prior, box))

    def after_rounds(self, rounds: int, robust: bool) -> WithModes:
        """The state after Gauss-Newton steps of pose and scores."""
        prior, box, state, criterion = self.prior, self.box, self.datasets, self.criterion
        for _ in range(rounds):
            state = tuple(data.with_tangential_steps(box, POSES.tangential_steps) for data in state)
            if robust:
                state = MixtureWeights().weighted(box, state, None)
            box, criterion = _step(prior, box, state)
            motion = Similarity.between(prior, box)
            prior = motion.moved(prior)
            box, state = prior.box.with_control_points(box.control_points), motion.with_surfaces(state, prior)
        return WithModes(prior, box, state, criterion)


def _step(prior: ShapePrior, box: ControlBox, datasets: Sequence[SurfaceData]) -> tuple[ControlBox, float]:
    """The box after a Gauss-Newton step of rigid motion and scores, and the criterion before it."""
    rigid_columns = rigid_motions(prior)
    columns = np.concatenate([rigid_columns, prior.deviations[:, None, None] * prior.modes])
    columns = columns.reshape(len(columns), -1).T
    mean = prior.mean.ravel()
    matrix, right = np.zeros((columns.shape[1],) * 2), np.zeros(columns.shape[1])
    for rows in (data_rows(data, box) for data in datasets):
        # few columns: their products at the points take less time than the normal equations of all control points
        basis = box.matrix(rows.origins)
        moved = (basis @ columns.reshape(basis.shape[1], -1)).reshape(len(basis), 3, -1)
        weighted = rows.metric @ moved
        matrix += np.tensordot(moved, weighted, ((0, 1), (0, 1)))
        right += np.tensordot(weighted, rows.targets - rows.origins - basis @ prior.mean, ((0, 1), (0, 1)))
    distances = np.concatenate([data.along_normals(box).residuals for data in datasets])
    weights = np.concatenate([data.effective_weights for data in datasets])
    least = max(prior.report.residual, POSES.least_deviation) ** 2
    variance = max(float(weights @ distances**2 / weights.sum()), least)
    penalty = np.zeros(len(right))
    penalty[len(rigid_columns) :] = variance
    matrix[np.diag_indices(len(matrix))] += penalty + 1e-9 * np.abs(matrix.diagonal()).max() * (penalty == 0)
    found = np.linalg.solve(matrix, right)
    moved_box = box.with_control_points(box.rest + (mean + columns @ found).reshape(box.control_points.shape))
    scores = found[len(rigid_columns) :]
    return moved_box, float(weights.sum() * np.log(variance) + scores @ scores)
