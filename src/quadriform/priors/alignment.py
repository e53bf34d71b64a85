"""Corresponding control points: models in one coordinate frame, expressed over one reference.

Each superquadric is represented by the symmetric matrix S = R diag(a) R^T, which maps the unit sphere onto its
ellipsoid and does not depend on the names of its axes, nor on rotations of an ellipsoid onto itself. S S_ref^-1 maps
the reference onto it point by point, and the control box of the model maps these points onto its surface. Procrustes
analysis aligns them to the mean of all models, and least squares give the control points over the reference.
"""

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import permutations, product

import numpy as np
from scipy.spatial.transform import Rotation

from quadriform.errors import InputError
from quadriform.points import Array, rigid_motion
from quadriform.priors.features import Features
from quadriform.shapes.control_box import ControlBox, common_box
from quadriform.shapes.model import DeformableModel
from quadriform.shapes.superquadric import Superquadric

CELLS = 8
"""Of the grid on each reference surface: 386 points."""
WEAK = 0.05
"""Semi-axes that differ by a smaller fraction of their mean do not determine the orientation."""
SAME_ORIENTATION = 0.5
"""Bodies have one orientation in the world when the mean of their matrices deviates from a ball's by this fraction of
their own mean deviation."""
STEPS = 20
PASSES = 3
"""Alternations of poses and mean."""
FAR = 0.25
"""An orientation is replaced only by one that leaves less than this fraction of the distance: round bodies are alike
from many sides, and the nearest of these by chance is not the right one."""


@dataclass(frozen=True)
class Reference:
    """Ellipsoids about the origin in an undeformed box, over which all models are expressed.

    Attributes:
        surfaces: name -> ellipsoid.
        box: undeformed, around them.
        uncertainty: of a semi-axis; axes whose lengths differ by less are not rotated to those of the reference.
    """

    surfaces: dict[str, Superquadric]
    box: ControlBox
    uncertainty: float

    @cached_property
    def features(self) -> Features:
        """Over evenly spread points of all surfaces, one surface after the other."""
        origins = np.concatenate([surface.grid(CELLS)[0] for surface in self.surfaces.values()])
        return Features(self.box, origins)

    def row(self, points: Array) -> Array:
        """The features (3 k,) of a shape whose points (n, 3) correspond to those of the reference."""
        return self.features.row(points)

    def model(self, row: Array, space: str, unit: str) -> DeformableModel:
        """The model of such features."""
        control = self.box.control_points + self.features.displacements(row).reshape(self.box.control_points.shape)
        return DeformableModel(self.surfaces, self.box.with_control_points(control), space, unit)


def ellipsoid_matrix(surface: Superquadric) -> Array:
    """Return the symmetric matrix (3, 3) that maps the unit sphere onto the ellipsoid of a superquadric."""
    return (surface.rotation * surface.semi_axes) @ surface.rotation.T


def corresponding(model: DeformableModel, reference: Reference, rotation: Array) -> Array:
    """Return the world points (n, 3) of a model's surfaces that correspond to the points of the reference.

    Args:
        model: with the surfaces of the reference.
        reference: whose points are taken.
        rotation: (3, 3) of directions from the world to the frame of the reference.
    """
    found = []
    for name, own in reference.surfaces.items():
        surface = model.surfaces[name]
        sphere = (own.grid(CELLS)[0] - own.translation) @ np.linalg.solve(ellipsoid_matrix(own), rotation)
        found.append(model.box.deform(surface.project(surface.translation + sphere @ ellipsoid_matrix(surface))))
    return np.concatenate(found)


def aligned_rigidly(points_world: Array, target: Array) -> Array:
    """Return points (n, 3) after the rigid motion to centred targets (n, 3) of least squares."""
    rotation, _ = rigid_motion(points_world, target)
    return centred(points_world) @ rotation.T


def aligned(model: DeformableModel, reference: Reference, target: Array, in_world: bool) -> tuple[Array, Array]:
    """Return points (n, 3) of a model in the frame of the reference, and the rotation (3, 3) from the world to it.

    Args:
        model: with the surfaces of the reference.
        reference: whose points are taken.
        target: (n, 3), centred, to which the points are aligned.
        in_world: whether all models have one orientation in the world; else the axes of the model are aligned to those
            of the reference, in their order unless another of the 24 rotations is clearly better.
    """
    name, own = next(iter(reference.surfaces.items()))
    axes = model.surfaces[name].rotation
    starts = [np.eye(3)] if in_world else [own.rotation @ signed @ axes.T for signed in _cube_rotations()]
    chosen, least = (target, np.eye(3)), np.inf
    for start in starts:
        matrix = ellipsoid_matrix(model.surfaces[name])
        rotation = _rotation_to(matrix, ellipsoid_matrix(own), start, reference.uncertainty)
        points = aligned_rigidly(corresponding(model, reference, rotation), target)
        distance = float(np.linalg.norm(points - target))
        if distance < FAR * least:
            chosen, least = (points, rotation), distance
    return chosen


def _rotation_to(matrix: Array, reference: Array, start: Array, uncertainty: float) -> Array:
    """The rotation near a start that maps an ellipsoid matrix to the reference's, damped by the uncertainty.

    Gauss-Newton on rotation vectors. Without damping a heart, which is nearly round about its long axis, would be
    rotated about it by its noise.
    """
    damping = uncertainty**2
    generators = np.cross(np.eye(3)[:, None], np.eye(3)).transpose(0, 2, 1)
    rotation, total = start, np.zeros(3)
    for _ in range(STEPS):
        now = rotation @ matrix @ rotation.T
        # derivative of exp(w) S exp(-w) by w: the commutator with each generator
        jacobian = np.array([(generator @ now - now @ generator).ravel() for generator in generators]).T
        right = jacobian.T @ (reference - now).ravel() - damping * total
        step = np.linalg.solve(jacobian.T @ jacobian + damping * np.eye(3), right)
        total = total + step
        rotation = Rotation.from_rotvec(total).as_matrix() @ start
        if np.abs(step).max() < 1e-12:
            break
    return rotation


def _cube_rotations() -> list[Array]:
    """The 24 rotations that map the coordinate axes onto each other."""
    every = product(permutations(range(3)), product((1, -1), repeat=3))
    signed = [np.eye(3)[list(order)] * signs for order, signs in every]
    return [matrix for matrix in signed if np.linalg.det(matrix) > 0]


def _same_orientation(models: Sequence[DeformableModel]) -> bool:
    """Whether models have one orientation in the world; balls have, for nothing contradicts it."""
    name = next(iter(models[0].surfaces))
    # if orientations are random, deviations from a ball cancel in the mean
    each = np.array([ellipsoid_matrix(model.surfaces[name]) for model in models])
    mean = each.mean(axis=0)
    deviation = np.mean([_deviation(one) for one in each])
    return bool(deviation < WEAK * np.trace(mean) / 3 or _deviation(mean) > SAME_ORIENTATION * deviation)


def _deviation(matrix: Array) -> float:
    """The Frobenius norm of the difference from the matrix of a ball."""
    return float(np.linalg.norm(matrix - np.trace(matrix) / 3 * np.eye(3)))


def _check_same_surfaces(models: Sequence[DeformableModel], names: Collection[str]) -> None:
    for number, model in enumerate(models):
        if set(model.surfaces) != set(names) or any(not s.is_radial for s in model.surfaces.values()):
            raise InputError(f"model {number}: expected the surfaces {', '.join(names)}, all of kind 'ellipsoid'")


def centred(points: Array) -> Array:
    """Return points (n, 3) about their mean."""
    return points - points.mean(axis=0)


def _mean_reference(
    models: Sequence[DeformableModel], rotations: Sequence[Array], shape: tuple[int, int, int]
) -> Reference:
    surfaces, uncertainties = {}, []
    outer = next(iter(models[0].surfaces))
    for name, first in models[0].surfaces.items():
        each = np.array([r @ ellipsoid_matrix(m.surfaces[name]) @ r.T for m, r in zip(models, rotations)])
        mean = each.mean(axis=0)
        least = WEAK * float(np.trace(mean)) / 3
        # principal axes of the mean, near those of the first model so that their order is kept
        axes = _rotation_to(np.diag(first.semi_axes), mean, rotations[0] @ first.rotation, least)
        lengths = np.einsum("ji,njk,ki->ni", axes, each, axes)
        uncertainties.append(max(least, float(lengths.std(axis=0).max())))
        offsets = [m.surfaces[name].translation - m.surfaces[outer].translation for m in models]
        centre = np.mean([rotation @ offset for rotation, offset in zip(rotations, offsets)], axis=0)
        surfaces[name] = Superquadric("ellipsoid", lengths.mean(axis=0), rotation=axes, translation=centre)
    return Reference(surfaces, common_box(surfaces, shape), uncertainties[0])


@dataclass(frozen=True)
class Correspondence:
    """Shapes as rows of corresponding features: control points over one reference, in one coordinate frame.

    A row has three features for each control point, 375 for 5 x 5 x 5. The distance of two rows is the RMS distance of
    corresponding points of two surfaces, in the unit of the data. Position and orientation are removed, size is not.

    Attributes:
        reference: ellipsoids and box over which shapes are expressed.
        mean_points: (n, 3), the mean of the shapes over the reference's points.
        in_world: whether the shapes have one orientation in the world, as images of patients do; else they were
            rotated by the axes of their superquadrics.
        space: of the models.
        unit: of their lengths.
    """

    reference: Reference
    mean_points: Array
    in_world: bool
    space: str
    unit: str

    @classmethod
    def of(
        cls, models: Sequence[DeformableModel], shape: tuple[int, int, int], passes: int = PASSES
    ) -> "Correspondence":
        """Return the correspondence of one or more models, over the mean of their ellipsoids.

        Orientations and means are computed alternately. Models with one orientation start with it, others with that
        of the first.

        Args:
            models: with the same surfaces, all ellipsoids.
            shape: control points along each axis.
            passes: the number of alternations.

        Raises:
            InputError: the models have different surfaces.
        """
        _check_same_surfaces(models, models[0].surfaces)
        in_world = _same_orientation(models)
        first = models if in_world else models[:1]
        reference = _mean_reference(first, [np.eye(3)] * len(first), shape)
        mean = np.mean([centred(corresponding(model, reference, np.eye(3))) for model in first], axis=0)
        for _ in range(passes):
            rotations = [aligned(model, reference, mean, in_world)[1] for model in models]
            reference = _mean_reference(models, rotations, shape)
            pairs = zip(models, rotations)
            points = [aligned_rigidly(corresponding(m, reference, rotation), mean) for m, rotation in pairs]
            mean = np.mean(points, axis=0)
        return cls(reference, mean, in_world, models[0].space, models[0].unit)

    def transform(self, models: Sequence[DeformableModel]) -> Array:
        """Return rows (len(models), 3 k), each independent of the others.

        Raises:
            InputError: models with other surfaces than those of the reference.
        """
        return np.array([self.reference.row(each) for each in self.points(models)])

    def points(self, models: Sequence[DeformableModel]) -> Array:
        """Return points (len(models), n, 3) that correspond to those of the reference, in its frame.

        Raises:
            InputError: models with other surfaces than those of the reference.
        """
        _check_same_surfaces(models, self.reference.surfaces)
        return np.array([aligned(model, self.reference, self.mean_points, self.in_world)[0] for model in models])

    def inverse_transform(self, rows: Array) -> list[DeformableModel]:
        """Return models of rows (n, 3 k), about the origin."""
        return [self.reference.model(row, self.space, self.unit) for row in np.atleast_2d(rows)]
