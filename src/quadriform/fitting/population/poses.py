"""Where a fit with a prior begins: poses of the mean shape, each improved with the modes, and the best one of them.

First the mean shape is moved rigidly to the data from many rotations, by iterated closest points (ICP). Then pose and
scores of the modes are estimated together from the best of these.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from quadriform.fitting.cloud import canonical_order, evenly_spread
from quadriform.fitting.population.coordinates import rigid_motions
from quadriform.fitting.refinement.point_to_plane import data_rows
from quadriform.fitting.refinement.stage import MixtureWeights
from quadriform.fitting.refinement.surface_data import SurfaceData
from quadriform.points import Array
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
    closest_rounds: int = 15
    """Of closest points; most starts have converged by then."""
    trimmed: float = 0.8
    """Fraction of the nearest points by which poses are compared and improved, lest outliers decide."""
    kept: int = 8
    """Poses that are improved with the modes."""
    same_angle: float = np.radians(10.0)
    """Poses that differ by less in their rotation have converged to the same one."""
    mode_points: int = 400
    """Of each surface in the rounds with modes."""
    mode_rounds: int = 10
    tangential_steps: int = 3
    """Of each foot point in a round with modes."""


POSES = PoseSearch()


def moved(prior: ShapePrior, rotation: Array, shift: Array, size: float = 1.0) -> ShapePrior:
    """A prior after size * rotation x + shift."""
    return prior.rotated(rotation).transformed(size, shift)


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
    found = [with_modes(pose, some, robust) for pose in poses]
    return min(found, key=lambda each: each.criterion).result


def on_superquadrics(prior: ShapePrior, superquadrics: Mapping[str, Superquadric]) -> ShapePrior:
    """The prior moved so that the first of its superquadrics lies on a given one, centre on centre, axes on axes."""
    name, own = next(iter(prior.surfaces.items()))
    rotation = superquadrics[name].rotation @ own.rotation.T
    return moved(prior, rotation, superquadrics[name].translation - rotation @ own.translation)


def closest_poses(prior: ShapePrior, clouds: Mapping[str, Array]) -> list[ShapePrior]:
    """The prior in the poses in which the mean shape is nearest to points (n, 3) by name; the best one first."""
    model = prior.mean_model()
    targets = {name: model.mesh(name, POSES.cells).vertices for name in clouds}
    some = {name: _some(each) for name, each in clouds.items()}
    found = [_closest(targets, some, rotation) for rotation in _rotations(targets, some)]
    found.sort(key=lambda pose: pose.distance)
    return [moved(prior, pose.rotation, pose.shift) for pose in _different(found)][: POSES.kept]


@dataclass(frozen=True)
class _Pose:
    """A rotation (3, 3) and a shift (3,) of the mean shape, and the trimmed mean square distance of the points."""

    rotation: Array
    shift: Array
    distance: float


def _some(points: Array) -> Array:
    return points[evenly_spread(canonical_order(points - points.mean(axis=0)), POSES.points)]


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


def _closest(targets: Mapping[str, Array], clouds: Mapping[str, Array], rotation: Array) -> _Pose:
    """The pose after rounds of closest points from a rotation, with the centres of both on each other."""
    trees = {name: cKDTree(each) for name, each in targets.items()}
    points, model = (np.concatenate(list(each.values())) for each in (clouds, targets))
    shift = points.mean(axis=0) - rotation @ model.mean(axis=0)
    for _ in range(POSES.closest_rounds):
        near, squares = _nearest(trees, targets, clouds, rotation, shift)
        kept = squares <= np.quantile(squares, POSES.trimmed)
        rotation, shift = rigid(near[kept], points[kept])
    _, squares = _nearest(trees, targets, clouds, rotation, shift)
    kept = squares <= np.quantile(squares, POSES.trimmed)
    return _Pose(rotation, shift, float(squares[kept].mean()))


def _nearest(
    trees: Mapping[str, cKDTree],
    targets: Mapping[str, Array],
    clouds: Mapping[str, Array],
    rotation: Array,
    shift: Array,
) -> tuple[Array, Array]:
    """The nearest points (n, 3) of the unmoved mean shape to all points, and the squares (n,) of the distances."""
    near, squares = [], []
    for name, points in clouds.items():
        distances, index = trees[name].query((points - shift) @ rotation)
        near.append(targets[name][index])
        squares.append(distances**2)
    return np.concatenate(near), np.concatenate(squares)


def rigid(source: Array, target: Array) -> tuple[Array, Array]:
    """The rotation (3, 3) and the shift (3,) that move points (n, 3) to others by least squares (Kabsch)."""
    middle, centre = source.mean(axis=0), target.mean(axis=0)
    u, _, vt = np.linalg.svd((target - centre).T @ (source - middle))
    u[:, -1] *= np.sign(np.linalg.det(u @ vt))  # no reflection
    rotation = u @ vt
    return rotation, centre - rotation @ middle


def _different(poses: Sequence[_Pose]) -> list[_Pose]:
    """The poses without those that have the rotation of one before them."""
    kept = list[_Pose]()
    for pose in poses:
        angles = [Rotation.from_matrix(pose.rotation @ each.rotation.T).magnitude() for each in kept]
        if all(angle > POSES.same_angle for angle in angles):
            kept.append(pose)
    return kept


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
        rotation, _ = rigid(mean, now)
        middle, centre = mean.mean(axis=0), now.mean(axis=0)
        rotated, size = (mean - middle) @ rotation.T, 1.0
        if prior.any_size:
            size = float(np.sum((now - centre) * rotated) / np.sum(rotated**2))
        return cls(rotation, centre - size * rotation @ middle, size)

    def moved(self, prior: ShapePrior) -> ShapePrior:
        """The prior after the motion."""
        return moved(prior, self.rotation, self.shift, self.size)

    def with_surfaces(self, datasets: Sequence[SurfaceData], prior: ShapePrior) -> tuple[SurfaceData, ...]:
        """The data with the surfaces of the prior after the motion, and foot points that moved with them."""
        return tuple(
            replace(data, superquadric=each, origins=self.size * data.origins @ self.rotation.T + self.shift)
            for data, each in zip(datasets, prior.surfaces.values())
        )


def on_data(datasets: Sequence[SurfaceData], prior: ShapePrior, box: ControlBox) -> tuple[SurfaceData, ...]:
    """Data with the surfaces of a prior and the nearest foot points on a deformed box."""
    with_surfaces = [data.with_superquadric(each) for data, each in zip(datasets, prior.surfaces.values())]
    return tuple(data.with_nearest_foot_points(box) for data in with_surfaces)


@dataclass(frozen=True)
class WithModes:
    """A pose with modes.

    Attributes:
        result: the prior in this pose, and the deformed box.
        criterion: minus twice the log of the likelihood of the data times the prior of the scores, up to a constant.
    """

    result: tuple[ShapePrior, ControlBox]
    criterion: float


def with_modes(prior: ShapePrior, datasets: Sequence[SurfaceData], robust: bool) -> WithModes:
    """Pose and scores of the modes by Gauss-Newton steps from the mean shape in the pose of a prior.

    The scores have the prior of the population; there is no freedom outside of the modes.
    """
    box, criterion = prior.mean_model().box, np.inf
    state = on_data(datasets, prior, box)
    for _ in range(POSES.mode_rounds):
        state = tuple(data.with_tangential_steps(box, POSES.tangential_steps) for data in state)
        if robust:
            state = MixtureWeights().weighted(box, state, None)
        box, criterion = _step(prior, box, state)
        motion = Similarity.between(prior, box)
        prior = motion.moved(prior)
        box, state = prior.box.with_control_points(box.control_points), motion.with_surfaces(state, prior)
    return WithModes((prior, box), criterion)


def _step(prior: ShapePrior, box: ControlBox, datasets: Sequence[SurfaceData]) -> tuple[ControlBox, float]:
    """The box after a Gauss-Newton step of rigid motion and scores, and the criterion before it."""
    equations = [data_rows(data, box).equations(box) for data in datasets]
    whole = sum(equations[1:], equations[0])
    rigid_columns = rigid_motions(prior)
    columns = np.concatenate([rigid_columns, prior.deviations[:, None, None] * prior.modes])
    columns = columns.reshape(len(columns), -1).T
    mean = prior.mean.ravel()
    distances = np.concatenate([data.along_normals(box).residuals for data in datasets])
    weights = np.concatenate([data.effective_weights for data in datasets])
    variance = max(float(weights @ distances**2 / weights.sum()), prior.report.residual**2, np.finfo(float).tiny)
    matrix, right = columns.T @ whole.matrix @ columns, columns.T @ (whole.right - whole.matrix @ mean)
    penalty = np.zeros(len(right))
    penalty[len(rigid_columns) :] = variance
    matrix[np.diag_indices(len(matrix))] += penalty + 1e-9 * np.abs(matrix.diagonal()).max() * (penalty == 0)
    found = np.linalg.solve(matrix, right)
    moved_box = box.with_control_points(box.rest + (mean + columns @ found).reshape(box.control_points.shape))
    scores = found[len(rigid_columns) :]
    return moved_box, float(weights.sum() * np.log(variance) + scores @ scores)
