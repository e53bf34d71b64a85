"""A prior learned from the shapes of a population: models, or meshes whose vertices correspond."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from quadriform.errors import DegenerateError, InputError, OptionError, choose, known_options
from quadriform.fitting.options import check_box
from quadriform.fitting.threads import one_blas_thread
from quadriform.point_sets import UNITS
from quadriform.points import Array, rms_length
from quadriform.priors.alignment import Correspondence
from quadriform.priors.corresponding_meshes import (
    corresponding_vertices,
    mean_model,
    meshes_by_name,
    procrustes,
)
from quadriform.priors.features import Features
from quadriform.priors.principal import Components
from quadriform.priors.quality import NEGLIGIBLE, leave_one_out_error, modes_for, specificity
from quadriform.shapes.mesh import Mesh
from quadriform.shapes.model import DeformableModel
from quadriform.shapes.prior import PriorReport, ShapePrior, freedom_of
from quadriform.shapes.spaces import SPACES
from quadriform.shapes.superquadric import Superquadric

EXPLAINED = 0.999
"""Fraction of the variance that the modes explain, unless their number is given."""
LEAST_FREEDOM = 1e-3
"""Smallest error that the freedom allows for, relative to the standard deviation of the population: no finite number of
shapes shows that there are no others."""
MOST_CONTROL_POINTS = 1000
"""Of the box: the precision has three rows for each."""
SAME = 1e-9
"""Shapes whose standard deviation is a smaller fraction of their size are all the same."""


@known_options
@one_blas_thread
def learn_prior(
    models: Sequence[DeformableModel | Mesh | Mapping[str, Mesh]],
    *,
    box: tuple[int, int, int] = (5, 5, 5),
    scale: bool = False,
    modes: int | None = None,
    space: str | None = None,
    unit: str | None = None,
) -> ShapePrior:
    """A prior of shape learned from a population: its mean, its modes, and what lies outside of them.

    Position and orientation of each shape are removed by least squares (Procrustes analysis). The shapes become
    displacements of the control points of one box around superquadrics that all have in common, by least squares over
    corresponding points. The modes are the principal components of these, in the metric of distances over the surface.
    The freedom outside of the modes is that under which the points move as far as shapes that were left out lie from
    the modes of the others.

    Args:
        models: three or more, each with the same surfaces: models whose superquadrics are ellipsoids, as those of a
            cohort; or meshes, or meshes by name, in which vertices of one number correspond.
        box: control points along each axis.
        scale: whether sizes are removed too: all shapes are scaled to the mean size (RMS distance of their points to
            their centre), and a fit with the prior estimates a size besides the pose.
        modes: their number; by default as many as explain 99.9 % of the variance.
        space: the frame of meshes, "LPS" or "RAS"; models have their own.
        unit: of meshes, "mm" or "m"; models have their own.

    Raises:
        InputError: fewer than three, neither models nor meshes, or of different surfaces, frames or units; meshes whose
            vertices do not correspond.
        DegenerateError: all shapes are the same.
        OptionError: a box, a number of modes, a frame or a unit that cannot be.
    """
    counts = check_box(box)
    if np.prod(counts) > MOST_CONTROL_POINTS:
        raise OptionError(f"option box={box!r}: expected at most {MOST_CONTROL_POINTS} control points for a prior")
    if not isinstance(models, Iterable):
        raise InputError(f"models: expected three or more in a list, found one {type(models).__name__}")
    shapes = list(models)
    if len(shapes) < 3:
        raise InputError(f"models: expected three or more to learn a prior from, found {len(shapes)}")
    given = [shape for shape in shapes if isinstance(shape, DeformableModel)]
    if len(given) == len(shapes):
        population = _population_of_models(given, counts, scale)
        _check_stated(space, population.space, "space")
        _check_stated(unit, population.unit, "unit")
    else:
        stated = choose(space or "unknown", (*SPACES, "unknown"), "space"), choose(unit or "unknown", UNITS, "unit")
        population = _population_of_meshes(shapes, counts, scale, *stated)
    return replace(population.prior(modes), any_size=scale)


@dataclass(frozen=True)
class _Population:
    """Shapes in one frame of coordinates.

    Attributes:
        surfaces: name -> superquadric that all have in common.
        features: over points of these surfaces.
        points: (s, n, 3), of s shapes, centred, which correspond to these points.
        mean: (k, 3), displacements of the control points of the mean shape.
        space: "LPS", "RAS" or "unknown".
        unit: "mm", "m" or "unknown".
    """

    surfaces: dict[str, Superquadric]
    features: Features
    points: Array
    mean: Array
    space: str
    unit: str

    def prior(self, modes: int | None) -> ShapePrior:
        """Return the prior with a number of modes, or those that explain nearly all of the variance."""
        rows = np.array([self.features.row(each) for each in self.points])
        found = Components.of(rows)
        deviation = float(np.sqrt(found.variances.sum()))
        if deviation <= SAME * float(_sizes(self.points).max()):
            raise DegenerateError(f"models: all {len(rows)} shapes are the same; a prior needs shapes that differ")
        count = _number_of_modes(modes, found)
        report = self._report(rows, found, count)
        metric, box = self.features.gram, self.features.box
        return ShapePrior(
            surfaces=self.surfaces,
            box=box,
            mean=self.mean,
            modes=np.array([self.features.displacements(each) for each in found.directions[:count]]),
            variances=found.variances[:count],
            metric=metric,
            freedom=freedom_of(max(report.leave_one_out, LEAST_FREEDOM * deviation), box, metric),
            n_models=len(rows),
            report=report,
            space=self.space,
            unit=self.unit,
        )

    def _report(self, rows: Array, found: Components, count: int) -> PriorReport:
        modes_90, modes_95, modes_99 = (modes_for(found.variances, fraction) for fraction in (0.90, 0.95, 0.99))
        return PriorReport(
            leave_one_out=leave_one_out_error(rows, found, count),
            residual=self._residual(rows - found.mean),
            modes_90=modes_90,
            modes_95=modes_95,
            modes_99=modes_99,
            specificity=specificity(rows, found, count),
        )

    def _residual(self, rows: Array) -> float:
        """RMS distance of the points to those of the control points, from their features less those of the mean."""
        total = 0.0
        for row, points in zip(rows, self.points):
            displacement = self.mean + self.features.displacements(row)
            moved = self.features.origins + self.features.matrix @ displacement
            total += rms_length(points - moved) ** 2
        return float(np.sqrt(total / len(rows)))


def _population_of_models(models: Sequence[DeformableModel], counts: tuple[int, int, int], scale: bool) -> _Population:
    for what in ("space", "unit"):
        found = list(dict.fromkeys(getattr(model, what) for model in models))
        if len(found) > 1:
            raise InputError(f"models: expected one {what}, found {', '.join(found)}; convert them to one first")
    shapes = Correspondence.of(models, counts)
    points = _scaled(shapes.points(models)) if scale else shapes.points(models)
    reference = shapes.reference
    mean = reference.features.displacements(reference.row(points.mean(axis=0)))
    return _Population(reference.surfaces, reference.features, points, mean, shapes.space, shapes.unit)


def _population_of_meshes(
    shapes: Sequence[Any], counts: tuple[int, int, int], scale: bool, space: str, unit: str
) -> _Population:
    for number, shape in enumerate(shapes):
        if not isinstance(shape, Mesh | Mapping):
            raise InputError(
                f"models: expected all of them to be models, or all to be meshes, found {type(shape).__name__} "
                f"at index {number}"
            )
    meshes = [meshes_by_name(number, shape) for number, shape in enumerate(shapes)]
    points = procrustes(corresponding_vertices(meshes))
    points = _scaled(points) if scale else points
    model, features = mean_model(points.mean(axis=0), meshes[0], counts)
    mean = (model.box.control_points - model.box.rest).reshape(-1, 3)
    return _Population(model.surfaces, features, points, mean, space, unit)


def _check_stated(stated: str | None, found: str, what: str) -> None:
    if stated not in (None, found):
        raise OptionError(f"option {what}={stated!r}: the models are in {found}; convert them first")


def _sizes(points: Array) -> Array:
    """RMS distances (s,) of points (s, n, 3) to the centre of each shape, the origin."""
    return np.asarray(np.sqrt((points**2).sum(axis=2).mean(axis=1)), dtype=np.float64)


def _scaled(points: Array) -> Array:
    """The points (s, n, 3) of shapes that all have the mean size."""
    sizes = _sizes(points)
    return points * (sizes.mean() / sizes)[:, None, None]


def _number_of_modes(modes: int | None, found: Components) -> int:
    """The number that was asked for, or that of modes which explain nearly all of the variance."""
    if modes is None:
        return modes_for(found.variances, EXPLAINED)
    most = modes_for(found.variances, 1 - NEGLIGIBLE)
    if type(modes) is not int or not 1 <= modes <= most:
        raise OptionError(f"option modes={modes!r}: expected 1 to {most}, beyond which these shapes do not vary")
    return modes
