"""The entry points: points in, a model out, in one call or in two steps."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from quadriform.columns import Chosen
from quadriform.errors import OptionError, Warnings, choose, known_options
from quadriform.fitting.cloud import Centred
from quadriform.fitting.diagnostics import (
    coverages,
    duplicates,
    far_control_points,
    model_warnings,
    named_texts,
    precision_loss,
    start_notes,
)
from quadriform.fitting.inputs import Given, common_unit, point_sets, points_sha256, without_meshes
from quadriform.fitting.least_squares.regularisers import Regulariser
from quadriform.fitting.options import METHODS, PaperOptions, TangentOptions, options_for
from quadriform.fitting.paper.two_step import two_step
from quadriform.fitting.refinement.large_clouds import on_all, sample_of_large
from quadriform.fitting.refinement.refine import LocalProblem, refine_tangent
from quadriform.fitting.result import ALONE, Fit, Progress, Result, rms, unnamed
from quadriform.fitting.superquadric.fit import fit_superquadric
from quadriform.fitting.threads import one_blas_thread
from quadriform.point_sets import PointSet
from quadriform.points import Array, Frame, by_name, check_weights
from quadriform.shapes.control_box import ControlBox
from quadriform.shapes.kinds import KINDS
from quadriform.shapes.model import DeformableModel
from quadriform.shapes.record import ModelRecord
from quadriform.shapes.spaces import SPACES
from quadriform.shapes.superquadric import Superquadric

Clouds = ArrayLike | Mapping[str, ArrayLike]
Weights = ArrayLike | Mapping[str, ArrayLike] | None


@known_options
@one_blas_thread
def fit(
    points: Given,
    *,
    kind: str = "ellipsoid",
    method: str = "tangent",
    box: tuple[int, int, int] | str = (5, 5, 5),
    regularity: str | Regulariser | None = None,
    strength: float | str = "auto",
    robust: bool | None = None,
    base: ArrayLike | tuple[ArrayLike, ArrayLike] | None = None,
    max_error: float | None = None,
    matching: str | None = None,
    iterations: int | None = None,
    tolerance: float | None = None,
    weights: Weights = None,
    progress: Progress | None = None,
    columns: Chosen = None,
    normals: ArrayLike | Mapping[str, ArrayLike] | None = None,
    unit: str | None = None,
    space: str = "unknown",
) -> Fit:
    """The fit of a superquadric to points, refined by a free-form deformation.

    `quadriform.fit` describes the options; here `points` are arrays or meshes in memory. More than 50,000 points
    are fitted to a sample first, then to all of them, a part at a time.

    Raises:
        PointsError, DegenerateError, OptionError: the input cannot be fitted.
    """
    given, notes = without_meshes(points, weights)
    sets = {name: each.in_metric_unit() for name, each in point_sets(given, columns, normals).items()}
    unit, space = common_unit(sets, unit), choose(space, (*SPACES, "unknown"), "space")
    choose(kind, tuple(KINDS), "kind")
    options = dict(box=box, regularity=regularity, strength=strength, robust=robust, base=base)
    options |= dict(max_error=max_error, matching=matching, iterations=iterations, tolerance=tolerance)
    chosen = options_for(method, options)
    clouds = _checked(sets, weights, method)
    paper = isinstance(chosen, PaperOptions)
    index = None if paper else sample_of_large(clouds.points, clouds.weights)
    sample = clouds if index is None else clouds.take(index)
    starts = {
        name: fit_superquadric(cloud, kind, "paper" if paper else "robust", None if paper else sample.weights[name])
        for name, cloud in sample.points.items()
    }
    found = _refined({name: each.superquadric for name, each in starts.items()}, sample, chosen, kind, progress)
    if index is not None and isinstance(chosen, TangentOptions):
        found = on_all(found, clouds.points, clouds.weights, index, chosen)
    if paper:
        found = replace(found, warnings=named_texts({n: s.warnings for n, s in starts.items()}) | found.warnings)
    else:  # warnings of the refined model are its own; its start matters where another order of points gives another
        found = replace(found, notes=(*found.notes, *start_notes(starts, found.model)))
    return _with(sets, notes, replace(found, model=replace(found.model, unit=unit, space=space)))


@known_options
@one_blas_thread
def refine(
    superquadric: Superquadric | Mapping[str, Superquadric],
    points: Given,
    *,
    method: str = "tangent",
    box: tuple[int, int, int] | str = (5, 5, 5),
    regularity: str | Regulariser | None = None,
    strength: float | str = "auto",
    robust: bool | None = None,
    base: ArrayLike | tuple[ArrayLike, ArrayLike] | None = None,
    max_error: float | None = None,
    matching: str | None = None,
    iterations: int | None = None,
    tolerance: float | None = None,
    start: ControlBox | None = None,
    weights: Weights = None,
    progress: Progress | None = None,
) -> Fit:
    """The fit that refines given superquadric(s) by a free-form deformation.

    Args:
        superquadric: where to start from; a mapping when `points` is one, with the same names.
        points: (n, 3) or a mesh, or several by name, as in `fit`.
        method: "tangent" or "paper".
        start: a deformed box of the same superquadric(s) to go on from, such as that of the frame before; only for
            "tangent".
        weights: as in `fit`.
        progress: as in `fit`.
        box, regularity, strength, robust, base, max_error, matching, iterations, tolerance: as in `fit`.

    Raises:
        PointsError, DegenerateError, OptionError: the input cannot be fitted.
    """
    given, notes = without_meshes(points, weights)
    sets = point_sets(given)
    surfaces = (
        {ALONE: superquadric} if isinstance(superquadric, Superquadric) else by_name(superquadric, "superquadric")
    )
    if surfaces.keys() != sets.keys():
        raise OptionError(f"surfaces {sorted(surfaces)} and points {sorted(sets)} must have the same names")
    clouds = _checked(sets, weights, method)
    options = dict(box=box, regularity=regularity, strength=strength, robust=robust, base=base)
    options |= dict(max_error=max_error, matching=matching, iterations=iterations, tolerance=tolerance)
    chosen = options_for(method, options)
    if start is not None and isinstance(chosen, PaperOptions):
        raise OptionError("option start is not one of method='paper'; use method='tangent'")

    index = None if method == "paper" else sample_of_large(clouds.points, clouds.weights)
    found = _refined(surfaces, clouds if index is None else clouds.take(index), chosen, None, progress, start)
    if index is not None and isinstance(chosen, TangentOptions):
        found = on_all(found, clouds.points, clouds.weights, index, chosen)
    return _with(sets, notes, found)


@dataclass(frozen=True)
class _Clouds:
    """Checked points (n, 3), weights (n,) and normals (n, 3), where there are any, of all surfaces by name."""

    points: dict[str, Array]
    weights: dict[str, Array]
    normals: dict[str, Array]

    def take(self, index: Mapping[str, NDArray[np.int64]]) -> _Clouds:
        """Some of the points."""
        parts = (self.points, self.weights, self.normals)
        return _Clouds(*({name: each[index[name]] for name, each in part.items()} for part in parts))


def _checked(sets: Mapping[str, PointSet], weights: Weights, method: str) -> _Clouds:
    choose(method, METHODS, "method")
    if weights is not None and method == "paper":
        raise OptionError("option weights is not one of method='paper'; use method='tangent'")
    given = by_name(weights, "weights") if isinstance(weights, Mapping) else dict.fromkeys(sets, weights)
    if given.keys() != sets.keys():
        raise OptionError(f"weights {sorted(given)} and points {sorted(sets)} must have the same names")
    points = {name: each.points for name, each in sets.items()}
    normals = {name: each.normals for name, each in sets.items() if each.normals is not None}
    return _Clouds(points, {name: check_weights(given[name], len(each)) for name, each in points.items()}, normals)


def _with(sets: Mapping[str, PointSet], notes: tuple[str, ...], found: Fit) -> Fit:
    """The fit with warnings and notes about the points."""
    of_sets = tuple(dict.fromkeys(note for each in sets.values() for note in each.notes))
    return replace(found, warnings=precision_warnings(sets) | found.warnings, notes=notes + of_sets + found.notes)


def precision_warnings(sets: Mapping[str, PointSet]) -> Warnings:
    """PRECISION_LOSS of clouds whose digits were lost before they came, or none."""
    return named_texts({name: precision_loss(each.number_type, each.points) for name, each in sets.items()})


def _refined(
    surfaces: Mapping[str, Superquadric],
    clouds: _Clouds,
    options: PaperOptions | TangentOptions,
    kind: str | None,
    progress: Progress | None,
    start: ControlBox | None = None,
) -> Fit:
    """Centre and scale, refine, undo; with a `kind` other superquadrics than the given may serve as starts."""
    if isinstance(options, PaperOptions):
        frame = Frame.of(np.concatenate(list(clouds.points.values())))  # copies are points like any other
        local = {name: frame.to_local(cloud) for name, cloud in clouds.points.items()}
        box, history, strength = two_step(_in_frame(surfaces, frame), local, options, progress)
        model = DeformableModel(_in_frame(surfaces, frame), box)
        return _in_world(Result(model, history, strength, warnings=far_control_points(model)), clouds.points, frame)
    centred = Centred.of(clouds.points, clouds.weights)
    frame, distinct = centred.frame, centred.distinct
    problem = LocalProblem(
        centred.points,
        centred.weights,
        {name: distinct[name].of_distinct(each) for name, each in clouds.normals.items()},
        options,
        half_space=options.half_space(clouds.points, frame),
        max_error=None if options.max_error is None else options.max_error / frame.scale,
        start=None if start is None else frame.shape_to_local(start),
        progress=progress,
    )
    result = refine_tangent(problem, _in_frame(surfaces, frame), kind)
    inliers = {name: distinct[name].spread(found) for name, found in (result.inliers or {}).items()}
    counted = {name: each.counted for name, each in distinct.items()}
    found = _in_world(replace(result, inliers=inliers, counted=counted), clouds.points, frame)
    copies = named_texts({name: duplicates(each.copies, len(each.counted)) for name, each in distinct.items()})
    return replace(found, warnings=copies | found.warnings)


def _in_frame(surfaces: Mapping[str, Superquadric], frame: Frame) -> dict[str, Superquadric]:
    return {name: frame.shape_to_local(surface) for name, surface in surfaces.items()}


def _in_world(result: Result, clouds: Mapping[str, Array], frame: Frame) -> Fit:
    """The fit in the unit and frame of the points, with distances and warnings."""
    local = {name: frame.to_local(cloud) for name, cloud in clouds.items()}
    model = result.model
    undeformed = DeformableModel(model.surfaces, model.box.with_control_points(model.box.rest))
    residuals = {name: model.distance(cloud, name) for name, cloud in local.items()}
    before = {name: undeformed.distance(cloud, name) for name, cloud in local.items()}
    inliers = result.inliers or {name: np.ones(len(cloud)) for name, cloud in local.items()}
    noise = result.noise if result.noise is not None else rms(residuals)
    record = ModelRecord(coverage=coverages(result, local, inliers))
    sha256 = points_sha256(clouds.values())
    return Fit(
        model=replace(frame.shape_to_world(model), input_sha256=sha256, record=record),
        warnings=model_warnings(result, local, residuals, inliers),
        residuals=unnamed({name: frame.scale * values for name, values in residuals.items()}),
        superquadric_residuals=unnamed({name: frame.scale * values for name, values in before.items()}),
        history=tuple(entry.scaled(frame.scale) for entry in result.history),
        strength=result.strength,
        noise=frame.scale * noise,
        inliers=unnamed(inliers),
        covariance=None if result.covariance is None else frame.scale**2 * result.covariance,
        enriched=None if result.enriched is None else replace(result.enriched, scale=frame.scale),
    )
