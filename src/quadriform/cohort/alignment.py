"""Models brought to one frame and onto one reference, so that their control points correspond.

Each superquadric is seen as the symmetric matrix S = R diag(a) R^T, which carries the unit sphere onto its ellipsoid
and does not know how its axes are called or turned about themselves. S S_ref^-1 carries the reference onto it, point by
point; the model's own box carries these points on to its surface. Procrustes' method brings them to the mean of all,
and least squares give the control points over the reference that do the same.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import permutations, product

import numpy as np
from scipy.linalg import cho_factor, cho_solve, solve_triangular
from scipy.spatial.transform import Rotation

from quadriform.errors import InputError
from quadriform.fitting.least_squares.regularisers import Bending
from quadriform.points import Array
from quadriform.shapes.control_box import ControlBox, common_box
from quadriform.shapes.model import DeformableModel
from quadriform.shapes.superquadric import Superquadric

CELLS = 8
"""Of the grid on each reference surface: 386 points."""
HOLD = 1e-8
"""Bending energy per square of displacement: enough for what the surface does not see, nothing for what it does."""
WEAK = 0.05
"""Semi-axes that differ by a smaller share of their mean say nothing about the orientation."""
ALIKE = 0.5
"""Bodies lie alike in the world when the mean of their stretches is longer than wide by this share of what they are."""
STEPS = 20
FAR = 0.25
"""An orientation is given up only for one that leaves less than this share of the distance.

Round bodies look alike from many sides; the nearest of these by chance is not the right one.
"""


@dataclass(frozen=True)
class Reference:
    """Ellipsoids about the origin in an undeformed box, over which all models are expressed.

    Attributes:
        surfaces: name -> ellipsoid.
        box: undeformed, around them.
        doubt: of a length; axes whose lengths differ by less are not turned after the reference's.
    """

    surfaces: dict[str, Superquadric]
    box: ControlBox
    doubt: float

    @cached_property
    def origins(self) -> Array:
        """Even points (n, 3) of all surfaces, one surface after the other."""
        return np.concatenate([surface.grid(CELLS)[0] for surface in self.surfaces.values()])

    @cached_property
    def matrix(self) -> Array:
        """From control points (k) to these points, (n, k)."""
        return self.box.matrix(self.origins)

    @cached_property
    def gram(self) -> Array:
        """Symmetric (k, k): the mean square of the points' displacements, and a trace of bending energy."""
        shape = self.box.control_points.shape[:3]
        held = Bending().matrix((shape[0], shape[1], shape[2]))
        return self.matrix.T @ self.matrix / len(self.matrix) + HOLD * held

    @cached_property
    def root(self) -> Array:
        """Lower triangle L (k, k) with L L^T the Gram matrix."""
        return np.asarray(np.linalg.cholesky(self.gram), dtype=np.float64)

    def row(self, points: Array) -> Array:
        """The numbers (3 k,) of a shape whose points (n, 3) correspond to the reference's.

        They are its control points' displacements in coordinates in which the distance of two shapes is the RMS
        distance between their surfaces' points.
        """
        wanted = self.matrix.T @ (points - self.origins) / len(points)
        moved: Array = cho_solve(cho_factor(self.gram), wanted)
        return (self.root.T @ moved).ravel()

    def model(self, row: Array, space: str, unit: str) -> DeformableModel:
        """The model of such numbers."""
        moved = solve_triangular(self.root.T, np.reshape(row, (-1, 3)))
        control = self.box.control_points + moved.reshape(self.box.control_points.shape)
        return DeformableModel(self.surfaces, self.box.with_control_points(control), space, unit)


def stretch(surface: Superquadric) -> Array:
    """The symmetric matrix (3, 3) of a superquadric: it carries the unit sphere onto its ellipsoid."""
    return (surface.rotation * surface.semi_axes) @ surface.rotation.T


def corresponding(model: DeformableModel, reference: Reference, turn: Array) -> Array:
    """World points (n, 3) of a model's surfaces that correspond to the reference's own.

    Args:
        model: with the reference's surfaces.
        reference: over which the points are taken.
        turn: (3, 3) from the world to the frame of the reference, for directions.
    """
    found = []
    for name, own in reference.surfaces.items():
        surface = model.surfaces[name]
        sphere = (own.grid(CELLS)[0] - own.translation) @ np.linalg.solve(stretch(own), turn)
        found.append(model.box.deform(surface.project(surface.translation + sphere @ stretch(surface))))
    return np.concatenate(found)


def placed(points_world: Array, target: Array) -> Array:
    """Points (n, 3) moved rigidly to where they are nearest to centred targets (n, 3) (Kabsch)."""
    away = points_world - points_world.mean(axis=0)
    u, _, vt = np.linalg.svd(target.T @ away)
    u[:, -1] *= np.sign(np.linalg.det(u @ vt))
    return away @ (u @ vt).T


def aligned(model: DeformableModel, reference: Reference, target: Array, in_world: bool) -> tuple[Array, Array]:
    """Points (n, 3) of a model in the frame of the reference, and the turn (3, 3) from the world that says which.

    Args:
        model: with the reference's surfaces.
        reference: over which the points are taken.
        target: (n, 3), centred, to which they are brought.
        in_world: whether all models lie alike in the world; else the model's axes are laid along the reference's, by
            their names if nothing speaks clearly for another of the 24 ways.
    """
    name, own = next(iter(reference.surfaces.items()))
    axes = model.surfaces[name].rotation
    starts = [np.eye(3)] if in_world else [own.rotation @ signed @ axes.T for signed in _cube_turns()]
    chosen, least = (target, np.eye(3)), np.inf
    for start in starts:
        turn = _along(stretch(model.surfaces[name]), stretch(own), start, reference.doubt)
        points = placed(corresponding(model, reference, turn), target)
        miss = float(np.linalg.norm(points - target))
        if miss < FAR * least:
            chosen, least = (points, turn), miss
    return chosen


def _along(matrix: Array, reference: Array, start: Array, doubt: float) -> Array:
    """The turn next to a start that brings a stretch onto the reference's, as far as their axes tell (Gauss-Newton).

    Without doubt a heart, which is nearly round about its long axis, would be spun about it by its noise.
    """
    weak = doubt**2
    spins = np.cross(np.eye(3)[:, None], np.eye(3)).transpose(0, 2, 1)
    turn, total = start, np.zeros(3)
    for _ in range(STEPS):
        now = turn @ matrix @ turn.T
        slopes = np.array([(spin @ now - now @ spin).ravel() for spin in spins]).T
        right = slopes.T @ (reference - now).ravel() - weak * total
        step = np.linalg.solve(slopes.T @ slopes + weak * np.eye(3), right)
        total = total + step
        turn = Rotation.from_rotvec(total).as_matrix() @ start
        if np.abs(step).max() < 1e-12:
            break
    return turn


def _cube_turns() -> list[Array]:
    """The 24 rotations that carry the coordinate axes onto each other."""
    every = product(permutations(range(3)), product((1, -1), repeat=3))
    signed = [np.eye(3)[list(order)] * signs for order, signs in every]
    return [matrix for matrix in signed if np.linalg.det(matrix) > 0]


def reference_of(
    models: Sequence[DeformableModel], shape: tuple[int, int, int], passes: int
) -> tuple[Reference, Array, bool]:
    """A reference for models, their mean points (n, 3) over it, and whether the models lie alike in the world.

    Its ellipsoids are the means of the models' own; orientations and means are found in turn. Models that lie
    alike in the world begin as they lie, others from the first of them.

    Args:
        models: one or more, with the same surfaces, all ellipsoids.
        shape: control points along each axis.
        passes: how often.

    Raises:
        InputError: the models have different surfaces.
    """
    check_alike(models, tuple(models[0].surfaces))
    in_world = _alike_in_world(models)
    first = models if in_world else models[:1]
    reference = _mean_reference(first, [np.eye(3)] * len(first), shape)
    mean = np.mean([_centred(corresponding(model, reference, np.eye(3))) for model in first], axis=0)
    for _ in range(passes):
        turns = [aligned(model, reference, mean, in_world)[1] for model in models]
        reference = _mean_reference(models, turns, shape)
        mean = np.mean([placed(corresponding(m, reference, turn), mean) for m, turn in zip(models, turns)], axis=0)
    return reference, mean, in_world


def _alike_in_world(models: Sequence[DeformableModel]) -> bool:
    """Whether models lie alike, and not anyhow; balls do, for nothing speaks against it."""
    name = next(iter(models[0].surfaces))
    each = np.array([stretch(model.surfaces[name]) for model in models])
    longer = np.mean([_deviation(one) for one in each])
    return bool(longer < WEAK * np.trace(each.mean(axis=0)) / 3 or _deviation(each.mean(axis=0)) > ALIKE * longer)


def _deviation(matrix: Array) -> float:
    """How far a stretch is from a ball's."""
    return float(np.linalg.norm(matrix - np.trace(matrix) / 3 * np.eye(3)))


def check_alike(models: Sequence[DeformableModel], names: tuple[str, ...]) -> None:
    """See that models have the same surfaces, and only ellipsoids.

    Raises:
        InputError: one has not.
    """
    for number, model in enumerate(models):
        if set(model.surfaces) != set(names) or any(s.kind != "ellipsoid" for s in model.surfaces.values()):
            raise InputError(f"model {number}: expected the surfaces {', '.join(names)}, all of kind 'ellipsoid'")


def _centred(points: Array) -> Array:
    return points - points.mean(axis=0)


def _mean_reference(
    models: Sequence[DeformableModel], turns: Sequence[Array], shape: tuple[int, int, int]
) -> Reference:
    surfaces, doubts = {}, []
    outer = next(iter(models[0].surfaces))
    for name in models[0].surfaces:
        each = np.array([turn @ stretch(model.surfaces[name]) @ turn.T for model, turn in zip(models, turns)])
        mean, first = each.mean(axis=0), models[0].surfaces[name]
        floor = WEAK * float(np.trace(mean)) / 3
        axes = _along(np.diag(first.semi_axes), mean, turns[0] @ first.rotation, floor)
        lengths = np.einsum("ji,njk,ki->ni", axes, each, axes)
        doubts.append(max(floor, float(lengths.std(axis=0).max())))
        gaps = [m.surfaces[name].translation - m.surfaces[outer].translation for m in models]
        centre = np.mean([turn @ gap for turn, gap in zip(turns, gaps)], axis=0)
        surfaces[name] = Superquadric("ellipsoid", lengths.mean(axis=0), rotation=axes, translation=centre)
    return Reference(surfaces, common_box(surfaces, shape), doubts[0])
