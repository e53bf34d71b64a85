"""The entry points: points in, a model out, in one call or in two steps."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from quadriform.columns import Chosen
from quadriform.errors import OptionError, Warnings, choose, known_options
from quadriform.fitting.cloud import Distinct
from quadriform.fitting.diagnostics import (
    coverages,
    duplicates,
    far_control_points,
    model_warnings,
    named_texts,
    precision_loss,
    start_notes,
)
from quadriform.fitting.inputs import ALONE, Given, common_unit, point_sets, without_meshes
from quadriform.fitting.least_squares.regularisers import Regulariser
from quadriform.fitting.options import METHODS, PaperOptions, TangentOptions, options_for
from quadriform.fitting.paper.two_step import two_step
from quadriform.fitting.refinement.large_clouds import MANY, on_all, sampled
from quadriform.fitting.refinement.refine import fit_tangent
from quadriform.fitting.result import Fit, Progress, Result, rms
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
Normals = dict[str, Array]
"""Name -> (n, 3), of the clouds that have normals."""
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
    """Fit a superquadric, and refine it by a free-form deformation.

    `quadriform.fit` says what the options are; here `points` are arrays or meshes in memory. More than 50,000 points
    are fitted to a sample first, then to all of them, a part at a time.

    Raises:
        PointsError, DegenerateError, OptionError: the input cannot be fitted.
    """
    given, notes = without_meshes(points, weights)
    sets = {name: each.in_metric_unit() for name, each in point_sets(given, columns, normals).items()}
    clouds, unit, space = _points(sets), common_unit(sets, unit), choose(space, (*SPACES, "unknown"), "space")
    choose(kind, tuple(KINDS), "kind")
    options = dict(box=box, regularity=regularity, strength=strength, robust=robust, base=base)
    options |= dict(max_error=max_error, matching=matching, iterations=iterations, tolerance=tolerance)
    chosen = options_for(method, options)
    counted = _weights(weights, clouds, method)
    way = "paper" if method == "paper" else "robust"
    bare = weights is None

    def whole(few: dict[str, Array], counts: dict[str, Array], facing: Normals) -> Fit:
        starts = {n: fit_superquadric(cloud, kind, way, None if bare else counts[n]) for n, cloud in few.items()}
        surfaces = {name: start.superquadric for name, start in starts.items()}
        refined = _refine(surfaces, few, counts, facing, chosen, kind, progress)
        if method != "paper":
            # the refined model speaks for itself, but for a start that would be another one in another order of points
            return replace(refined, notes=(*refined.notes, *start_notes(starts, refined.model)))
        said = named_texts({name: s.warnings for name, s in starts.items()})
        return replace(refined, warnings=said | refined.warnings)

    found = _few_first(clouds, counted, _normals(sets), chosen, whole)
    return _with(
        precision_warnings(sets), notes, sets, replace(found, model=replace(found.model, unit=unit, space=space))
    )


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
    """Refine given superquadric(s).

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
    clouds = _points(sets)
    surfaces = (
        {ALONE: superquadric} if isinstance(superquadric, Superquadric) else by_name(superquadric, "superquadric")
    )
    if surfaces.keys() != clouds.keys():
        raise OptionError(f"surfaces {sorted(surfaces)} and points {sorted(clouds)} must have the same names")
    counted = _weights(weights, clouds, method)
    options = dict(box=box, regularity=regularity, strength=strength, robust=robust, base=base)
    options |= dict(max_error=max_error, matching=matching, iterations=iterations, tolerance=tolerance)
    chosen = options_for(method, options)
    if start is not None and isinstance(chosen, PaperOptions):
        raise OptionError("option start is not one of method='paper'; use method='tangent'")

    def whole(few: dict[str, Array], counts: dict[str, Array], facing: Normals) -> Fit:
        return _refine(surfaces, few, counts, facing, chosen, None, progress, start)

    return _with(precision_warnings(sets), notes, sets, _few_first(clouds, counted, _normals(sets), chosen, whole))


def _with(warnings: Warnings, notes: tuple[str, ...], sets: Mapping[str, PointSet], found: Fit) -> Fit:
    of_sets = tuple(dict.fromkeys(note for each in sets.values() for note in each.notes))
    return replace(found, warnings=warnings | found.warnings, notes=notes + of_sets + found.notes)


def _points(sets: Mapping[str, PointSet]) -> dict[str, Array]:
    return {name: each.points for name, each in sets.items()}


def _normals(sets: Mapping[str, PointSet]) -> Normals:
    return {name: each.normals for name, each in sets.items() if each.normals is not None}


def precision_warnings(sets: Mapping[str, PointSet]) -> Warnings:
    """PRECISION_LOSS of clouds whose digits were lost before they came, or none."""
    return named_texts({name: precision_loss(each.number_type, each.points) for name, each in sets.items()})


def _few_first(
    clouds: dict[str, Array],
    weights: dict[str, Array],
    normals: Normals,
    options: PaperOptions | TangentOptions,
    fitted: Callable[[dict[str, Array], dict[str, Array], Normals], Fit],
) -> Fit:
    """The fit of clouds with weights; of very large clouds that of a sample, gone on with on all points."""
    if isinstance(options, PaperOptions) or max(map(len, clouds.values())) <= MANY:
        return fitted(clouds, weights, normals)
    few = {name: sampled(cloud, weights[name]) for name, cloud in clouds.items()}
    facing = {name: each[few[name]] for name, each in normals.items()}
    found = fitted({n: clouds[n][index] for n, index in few.items()}, {n: weights[n][few[n]] for n in few}, facing)
    every = on_all(found, clouds, weights, few, options)
    return replace(
        every,
        model=replace(every.model, input_sha256=_hash(clouds)),
        residuals=_unnamed(every.residuals),
        superquadric_residuals=_unnamed(every.superquadric_residuals),
        inliers=_unnamed(every.inliers),
    )


def _refine(
    surfaces: dict[str, Superquadric],
    clouds: dict[str, Array],
    weights: dict[str, Array],
    normals: Normals,
    options: PaperOptions | TangentOptions,
    kind: str | None,
    progress: Progress | None,
    start: ControlBox | None = None,
) -> Fit:
    """Centre and scale, refine, undo; with a `kind` other superquadrics than the given may serve as starts."""
    if isinstance(options, PaperOptions):  # where copies are points like any other
        frame = Frame.of(np.concatenate(list(clouds.values())))
        local, starts = _local(clouds, frame), _placed(surfaces, frame)
        box, history, strength = two_step(starts, local, options, progress)
        model = DeformableModel(starts, box)
        result = Result(model, history, strength, warnings=far_control_points(model))
        return _in_world(result, clouds, frame)
    parts = {name: Distinct.of(cloud, weights[name]) for name, cloud in clouds.items()}
    frame = Frame.of(np.concatenate([part.points for part in parts.values()]))
    local = _local({name: part.points for name, part in parts.items()}, frame)
    counted = _of_mean_one({name: part.weights for name, part in parts.items()})
    limit = None if options.max_error is None else options.max_error / frame.scale
    beyond = options.beyond(clouds, frame)
    begin = None if start is None else start.placed(1 / frame.scale, -frame.centre / frame.scale)
    facing = {name: parts[name].of_distinct(each) for name, each in normals.items()}
    result = fit_tangent(
        _placed(surfaces, frame), local, counted, options, beyond, limit, kind, progress, begin, facing
    )
    inliers = {name: parts[name].spread(found) for name, found in (result.inliers or {}).items()}
    there = {name: part.counted for name, part in parts.items()}
    found = _in_world(replace(result, inliers=inliers, counted=there), clouds, frame)
    return replace(
        found,
        warnings=named_texts({n: duplicates(part.copies, len(part.counted)) for n, part in parts.items()})
        | found.warnings,
    )


def _of_mean_one(weights: dict[str, Array]) -> dict[str, Array]:
    """Weights whose mean over all distinct points that count is one: what is said twice of all is no new evidence."""
    every = np.concatenate(list(weights.values()))
    mean = every[every > 0].mean()
    return {name: values / mean for name, values in weights.items()}


def _local(clouds: Mapping[str, Array], frame: Frame) -> dict[str, Array]:
    return {name: frame.to_local(cloud) for name, cloud in clouds.items()}


def _placed(surfaces: Mapping[str, Superquadric], frame: Frame) -> dict[str, Superquadric]:
    return {name: surface.placed(1 / frame.scale, -frame.centre / frame.scale) for name, surface in surfaces.items()}


def _in_world(result: Result, clouds: dict[str, Array], frame: Frame) -> Fit:
    local = _local(clouds, frame)
    model = result.model
    before = DeformableModel(model.surfaces, model.box.with_control_points(model.box.rest))
    residuals = {name: model.distance(cloud, name) for name, cloud in local.items()}
    first = {name: before.distance(cloud, name) for name, cloud in local.items()}
    inliers = result.inliers or {name: np.ones(len(cloud)) for name, cloud in local.items()}
    noise = result.noise if result.noise is not None else rms(residuals)
    record = ModelRecord(coverage=coverages(result, local, inliers))
    return Fit(
        model=replace(model.placed(frame.scale, frame.centre), input_sha256=_hash(clouds), record=record),
        warnings=model_warnings(result, local, residuals, inliers),
        residuals=_unnamed({name: frame.scale * values for name, values in residuals.items()}),
        superquadric_residuals=_unnamed({name: frame.scale * values for name, values in first.items()}),
        history=tuple(entry.scaled(frame.scale) for entry in result.history),
        strength=result.strength,
        noise=frame.scale * noise,
        inliers=_unnamed(inliers),
        covariance=None if result.covariance is None else frame.scale**2 * result.covariance,
        finer=None if result.finer is None else replace(result.finer, scale=frame.scale),
    )


def _weights(weights: Weights, clouds: dict[str, Array], method: str) -> dict[str, Array]:
    choose(method, METHODS, "method")
    if weights is not None and method == "paper":
        raise OptionError("option weights is not one of method='paper'; use method='tangent'")
    given = by_name(weights, "weights") if isinstance(weights, Mapping) else dict.fromkeys(clouds, weights)
    if given.keys() != clouds.keys():
        raise OptionError(f"weights {sorted(given)} and points {sorted(clouds)} must have the same names")
    return {name: check_weights(given[name], len(cloud)) for name, cloud in clouds.items()}


def _unnamed(values: Array | dict[str, Array]) -> Array | dict[str, Array]:
    return values[ALONE] if isinstance(values, dict) and values.keys() == {ALONE} else values


def _hash(clouds: Mapping[str, Array]) -> str:
    """SHA-256 of the points as float64 rows, surface after surface; a reader of a file puts the file's own instead."""
    found = hashlib.sha256()
    for cloud in clouds.values():
        found.update(np.ascontiguousarray(cloud).data)
    return found.hexdigest()
