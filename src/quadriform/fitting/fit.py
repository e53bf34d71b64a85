"""The entry points: points in, a model out, in one call or in two steps.

`fit` takes arrays and meshes; `quadriform.fit` of `imaging/fit_files.py`, which also takes files, passes them on to it
and describes its options. In both, the option `support` is a plane that the body does not pass, such as a table, and
`Fit.supported` the share of the surface that data supports. `noise` is what is known of the errors of the points.
Points that are `counted` were given a weight above zero.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from quadriform.columns import Chosen
from quadriform.errors import OptionError, Warnings, choose, known_options
from quadriform.fitting.cloud import Centred, Distinct
from quadriform.fitting.diagnostics import (
    duplicates,
    far_control_points,
    low_overlap,
    named_texts,
    start_notes,
)
from quadriform.fitting.extrapolation import open_surfaces
from quadriform.fitting.least_squares.regularisers import Regulariser
from quadriform.fitting.noise import KnownNoise, partial_notes
from quadriform.fitting.options import METHODS, PaperOptions, TangentOptions, lengths_of, options_for
from quadriform.fitting.other_bodies import Masks, extended_to_clouds, points_of_others
from quadriform.fitting.paper.two_step import two_step
from quadriform.fitting.population.checks import check_no_others, check_prior
from quadriform.fitting.population.diagnostics import notes_on_walls
from quadriform.fitting.population.fit import refine_with_prior
from quadriform.fitting.population.poses import on_superquadrics
from quadriform.fitting.quality import Assessment
from quadriform.fitting.refinement.large_clouds import on_all, sample_of_large
from quadriform.fitting.refinement.refine import RefinementInput, refine_tangent
from quadriform.fitting.result import Fit, Progress, Result, SuperquadricFit, unnamed
from quadriform.fitting.superquadric.fit import fit_by_paper, fit_robust, fit_to_local
from quadriform.fitting.superquadric.surroundings import Plane, Surroundings, Viewpoint, surroundings_by_name
from quadriform.fitting.threads import one_blas_thread
from quadriform.point_sets import ALONE, Given, PointSet, common_unit, point_sets, points_sha256, precision_loss
from quadriform.points import Array, Frame, check_spread, check_weights, for_each
from quadriform.shapes.control_box import ControlBox
from quadriform.shapes.kinds import KINDS
from quadriform.shapes.landmarks import GIVEN_BASE, NONE_KNOWN, Landmarks
from quadriform.shapes.model import DeformableModel
from quadriform.shapes.prior import ShapePrior
from quadriform.shapes.record import ModelRecord
from quadriform.shapes.spaces import SPACES
from quadriform.shapes.superquadric import Superquadric

Clouds = ArrayLike | Mapping[str, ArrayLike]
Weights = ArrayLike | Mapping[str, ArrayLike] | None
Noise = ArrayLike | Mapping[str, ArrayLike] | None


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
    viewpoint: Viewpoint = None,
    support: Plane = None,
    max_error: float | None = None,
    matching: str | None = None,
    iterations: int | None = None,
    tolerance: float | None = None,
    weights: Weights = None,
    noise: Noise = None,
    prior: ShapePrior | None = None,
    progress: Progress | None = None,
    columns: Chosen = None,
    normals: ArrayLike | Mapping[str, ArrayLike] | None = None,
    unit: str | None = None,
    space: str = "unknown",
) -> Fit:
    """The fit of a superquadric to points, refined by a free-form deformation.

    The options are those of `quadriform.fit` (`imaging/fit_files.py`); here `points` are arrays or meshes in memory.
    Of more than 50,000 points a sample is fitted first, then all of them, a part at a time.

    Raises:
        PointsError, DegenerateError, OptionError: the input cannot be fitted.
        InputError: a prior of other surfaces, or in another unit or frame.
    """
    sets, unit = _in_metric_unit(point_sets(points, columns, normals, weights, noise), unit)
    choose(space, (*SPACES, "unknown"), "space")
    choose(kind, tuple(KINDS), "kind")
    options = dict(box=box, regularity=regularity, strength=strength, robust=robust) | lengths_of(sets, base, max_error)
    chosen = options_for(method, options | dict(matching=matching, iterations=iterations, tolerance=tolerance))
    clouds = _checked(sets, weights, noise, method)
    if prior is not None:
        check_no_others(kind=kind, viewpoint=viewpoint, support=support)
        found = _refine_with_prior(clouds, *check_prior(prior, chosen, clouds.points, unit, space), progress)
        return _with_notes_of_points(sets, replace(found, model=replace(found.model, unit=unit, space=space)))
    if viewpoint is not None or support is not None:
        known = surroundings_by_name(clouds.points, sets, viewpoint, support, method)
        clouds = replace(clouds, surroundings=known)
    found = _fitted(clouds, kind, chosen, progress)
    return _with_notes_of_points(sets, replace(found, model=replace(found.model, unit=unit, space=space)))


def _fitted(clouds: _Clouds, kind: str, options: PaperOptions | TangentOptions, progress: Progress | None) -> Fit:
    """The superquadrics, then their refinement; a very large cloud is fitted to a sample first."""
    if isinstance(options, PaperOptions):
        starts = {name: fit_by_paper(cloud, kind) for name, cloud in clouds.points.items()}
        found = _refine_paper({name: each.superquadric for name, each in starts.items()}, clouds, options, progress)
        return replace(found, warnings=named_texts({n: s.warnings for n, s in starts.items()}) | found.warnings)
    index = sample_of_large(clouds.points, clouds.weights)
    sample = clouds.take(index)
    starts = {
        name: fit_robust(cloud, kind, sample.weights[name], {}, sample.noise.get(name), sample.surroundings.get(name))
        for name, cloud in sample.points.items()
    }
    if options.robust:
        others = points_of_others(sample.points, starts)
        clouds = replace(clouds, others=extended_to_clouds(others, clouds.points, index))
    superquadrics = {name: each.superquadric for name, each in starts.items()}
    found = _refine_tangent(superquadrics, clouds, index, options, progress, kind_of_other_starts=kind, fitted=starts)
    # warnings are those of the model; of a start that did not converge, which rounding may change, there is a note
    return replace(found, notes=(*found.notes, *start_notes(starts, found.model)))


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
    noise: Noise = None,
    prior: ShapePrior | None = None,
    progress: Progress | None = None,
) -> Fit:
    """The fit that refines given superquadric(s) by a free-form deformation.

    Args:
        superquadric: where to start from; a mapping when `points` is one, with the same names.
        points: (n, 3) or a mesh, or several by name, as in `fit`.
        method: "tangent" or "paper".
        start: a deformed box of the same superquadric(s) to go on from, such as that of the frame before; only for
            "tangent".
        prior: as in `fit`; the pose begins where the first surface of the prior lies on the given one.
        box, regularity, strength, robust, base, max_error, matching, iterations, tolerance, weights, noise, progress:
            as in `fit`, which besides tries other superquadrics as starts and leaves out points of other bodies.

    Raises:
        PointsError, DegenerateError, OptionError: the input cannot be fitted.
    """
    sets, unit = _in_metric_unit(point_sets(points, weights=weights, noise=noise))
    named = {ALONE: superquadric} if isinstance(superquadric, Superquadric) else superquadric
    superquadrics: dict[str, Superquadric] = for_each(sets, named, "surfaces")
    clouds = _checked(sets, weights, noise, method)
    options = dict(box=box, regularity=regularity, strength=strength, robust=robust) | lengths_of(sets, base, max_error)
    chosen = options_for(method, options | dict(matching=matching, iterations=iterations, tolerance=tolerance))
    if prior is not None:
        check_no_others(start=start)
        checked = check_prior(prior, chosen, clouds.points, unit, "unknown")
        found = _refine_with_prior(clouds, *checked, progress, superquadrics)
    elif isinstance(chosen, TangentOptions):
        index = sample_of_large(clouds.points, clouds.weights)
        found = _refine_tangent(superquadrics, clouds, index, chosen, progress, start=start)
    elif start is None:
        found = _refine_paper(superquadrics, clouds, chosen, progress)
    else:
        raise OptionError("option start is not one of method='paper'; use method='tangent'")
    return _with_notes_of_points(sets, replace(found, model=replace(found.model, unit=unit)))


def _in_metric_unit(sets: Mapping[str, PointSet], unit: str | None = None) -> tuple[dict[str, PointSet], str]:
    """The clouds in a unit that models can have, and which it is: their own, or the given one."""
    metric = {name: each.in_metric_unit() for name, each in sets.items()}
    return metric, common_unit(metric, unit)


@dataclass(frozen=True)
class _Clouds:
    """Checked points (n, 3) by name, with weights (n,), normals (n, 3) if there are any, and notes on the noise.

    `noise`, covariances (n, 3, 3), is of all clouds or of none; `others` (n,) are masks of the points of other bodies,
    once known; `surroundings` is what is known beside the points: viewpoints, and the plane on which the body stands.
    """

    points: dict[str, Array]
    weights: dict[str, Array]
    normals: dict[str, Array]
    noise: dict[str, Array]
    notes: tuple[str, ...]
    others: Masks = field(default_factory=dict)
    surroundings: dict[str, Surroundings] = field(default_factory=dict)

    @property
    def weights_of_body(self) -> dict[str, Array]:
        """The weights, zero for points of other bodies."""
        return {name: np.where(self.others.get(name, False), 0.0, each) for name, each in self.weights.items()}

    def take(self, index: Mapping[str, NDArray[np.int64]] | None) -> _Clouds:
        """Some of the points; without an index all."""
        if index is None:
            return self
        parts = (self.points, self.weights, self.normals, self.noise)
        points, weights, normals, noise = ({name: each[index[name]] for name, each in p.items()} for p in parts)
        others = {name: each[index[name]] for name, each in self.others.items()}
        surroundings = {name: each.take(index[name]) for name, each in self.surroundings.items()}
        return _Clouds(points, weights, normals, noise, self.notes, others, surroundings)


def _checked(sets: Mapping[str, PointSet], weights: Weights, noise: Noise, method: str) -> _Clouds:
    choose(method, METHODS, "method")
    for option, value in (("weights", weights), ("noise", noise)):
        if value is not None and method == "paper":
            raise OptionError(f"option {option} is not one of method='paper'; use method='tangent'")
    given = for_each(sets, weights, "weights")
    points = {name: each.points for name, each in sets.items()}
    normals = {name: each.normals for name, each in sets.items() if each.normals is not None}
    checked = {name: check_weights(given[name], len(each)) for name, each in points.items()}
    for name, each in points.items():
        if not checked[name].all():
            check_spread(each[checked[name] > 0], needed=11)
    known = {name: each.noise for name, each in sets.items() if each.noise is not None}
    # without the noise of the others it is not known how much their points count beside these
    whole, notes = known.keys() == points.keys(), partial_notes({name: each.noise for name, each in sets.items()})
    return _Clouds(points, checked, normals, known if whole else {}, notes)


def _with_notes_of_points(sets: Mapping[str, PointSet], found: Fit) -> Fit:
    """The fit with warnings and notes about the points, and about the solids whose surfaces they are."""
    of_sets = tuple(dict.fromkeys(note for each in sets.values() for note in each.notes))
    overlap = low_overlap(found.model, sets, found.model.landmarks.base)
    return replace(found, warnings=precision_warnings(sets) | overlap | found.warnings, notes=of_sets + found.notes)


def precision_warnings(sets: Mapping[str, PointSet]) -> Warnings:
    """PRECISION_LOSS of clouds whose digits were lost before they came, or none."""
    return named_texts({name: precision_loss(each.number_type, each.points) for name, each in sets.items()})


def _refine_paper(
    superquadrics: Mapping[str, Superquadric], clouds: _Clouds, options: PaperOptions, progress: Progress | None
) -> Fit:
    """The fit by the paper's method: centred and scaled, refined, and back in the unit of the points."""
    frame = Frame.of(np.concatenate(list(clouds.points.values())))  # the paper counts copies as points
    local = {name: frame.to_local(cloud) for name, cloud in clouds.points.items()}
    starts = _in_frame(superquadrics, frame)
    box, history, strength = two_step(starts, local, options, progress)
    model = DeformableModel(starts, box)
    return _in_world(Result(model, history, strength, warnings=far_control_points(model)), clouds.points, frame, {})


def _refine_tangent(
    superquadrics: Mapping[str, Superquadric],
    clouds: _Clouds,
    index: Mapping[str, NDArray[np.int64]] | None,
    options: TangentOptions,
    progress: Progress | None,
    kind_of_other_starts: str | None = None,
    start: ControlBox | None = None,
    fitted: Mapping[str, SuperquadricFit] | None = None,
) -> Fit:
    """The fit by the default method, to a sample by index, then to all points.

    Args:
        superquadrics: name -> superquadric to start from.
        clouds: all points.
        index: name -> indices of the sample; None if that is all points.
        options: of the refinement.
        progress: called after each round.
        kind_of_other_starts: of superquadrics that are tried as starts too; None to try only the given ones.
        start: a deformed box to go on from, or None.
        fitted: name -> the fits of the superquadrics, whose covariances show how well the surface is known where it has
            no data; None where the superquadrics were given.
    """
    sample = clouds.take(index)
    centred = Centred.of(sample.points, sample.weights_of_body)
    frame, distinct = centred.frame, centred.distinct
    given = _refinement_input(sample, centred, options, progress)
    given = replace(given, warm_start=None if start is None else frame.shape_to_local(start))
    known, base = given.noise, options.base_plane(sample.points)
    starts = {name: fit_to_local(each, frame) for name, each in (fitted or {}).items()}
    refined = refine_tangent(given, _in_frame(superquadrics, frame), kind_of_other_starts)
    result = replace(refined, starts=starts)
    found = _in_world(_of_all_points(result, distinct, sample), sample.points, frame, sample.noise)
    copies = named_texts({name: duplicates(each.copies, len(each.counted)) for name, each in distinct.items()})
    landmarks = NONE_KNOWN if base is None else Landmarks(base, GIVEN_BASE)
    model = replace(found.model, landmarks=landmarks)
    found = replace(found, model=model, warnings=copies | found.warnings, notes=(*clouds.notes, *found.notes))
    # this method always has an enriched box: the same data with more control points, for `Fit.uncertainty`
    if index is None or found.enriched is None:
        return found
    counted = {name: each > 0 for name, each in clouds.weights.items()}
    weights = clouds.weights_of_body
    return on_all(found, found.enriched, clouds.points, weights, counted, clouds.noise, centred, known, options)


def _refine_with_prior(
    clouds: _Clouds,
    prior: ShapePrior,
    options: TangentOptions,
    progress: Progress | None,
    superquadrics: Mapping[str, Superquadric] | None = None,
) -> Fit:
    """The fit of a member of a population, from all poses or from where superquadrics lie."""
    centred = Centred.of(clouds.points, clouds.weights_of_body)
    given = _refinement_input(clouds, centred, options, progress)
    local, base = centred.frame.shape_to_local(prior), options.base_plane(clouds.points)
    poses = None if superquadrics is None else [on_superquadrics(local, _in_frame(superquadrics, centred.frame))]
    result = _of_all_points(refine_with_prior(given, local, poses), centred.distinct, clouds)
    found = _in_world(result, clouds.points, centred.frame, clouds.noise)
    copies = named_texts({name: duplicates(each.copies, len(each.counted)) for name, each in centred.distinct.items()})
    landmarks = NONE_KNOWN if base is None else Landmarks(base, GIVEN_BASE)
    model = replace(found.model, landmarks=landmarks)
    notes = (*clouds.notes, *found.notes, *notes_on_walls(prior.surfaces))
    return replace(found, model=model, warnings=copies | found.warnings, notes=notes)


def _refinement_input(
    clouds: _Clouds, centred: Centred, options: TangentOptions, progress: Progress | None
) -> RefinementInput:
    """Points and options in the centred, scaled frame."""
    frame, base = centred.frame, options.base_plane(clouds.points)
    return RefinementInput(
        centred.points,
        centred.weights,
        {name: centred.distinct[name].of_distinct(each) for name, each in clouds.normals.items()},
        KnownNoise.of(clouds.noise, centred),
        options,
        half_space=None if base is None else (frame.to_local(base.point[None])[0], base.direction),
        max_error=None if options.max_error is None else options.max_error / frame.scale,
        progress=progress,
    )


def _of_all_points(result: Result, distinct: Mapping[str, Distinct], clouds: _Clouds) -> Result:
    """A result for the distinct points with the inlier probabilities of all, of copies and of those without weight.

    Points of other bodies are outliers like others, and counted.
    """
    inliers = {name: distinct[name].expand_to_duplicates(found) for name, found in (result.inliers or {}).items()}
    return replace(result, inliers=inliers, counted={name: each > 0 for name, each in clouds.weights.items()})


def _in_frame(superquadrics: Mapping[str, Superquadric], frame: Frame) -> dict[str, Superquadric]:
    return {name: frame.shape_to_local(each) for name, each in superquadrics.items()}


def _in_world(result: Result, clouds: Mapping[str, Array], frame: Frame, noise: Mapping[str, Array]) -> Fit:
    """The assessed fit in the unit and frame of the points, as are the clouds and the covariances of their noise."""
    local = {name: frame.to_local(cloud) for name, cloud in clouds.items()}
    known = {name: each / frame.scale**2 for name, each in noise.items()}
    found = Assessment.of(result, local, known, frame.scale)
    record = ModelRecord(coverage=found.coverage)
    sha256 = points_sha256(clouds.values())
    return Fit(
        model=replace(frame.shape_to_world(result.model), input_sha256=sha256, record=record),
        warnings=found.warnings,
        residuals=unnamed({name: frame.scale * values for name, values in found.residuals.items()}),
        superquadric_residuals=unnamed({n: frame.scale * each for n, each in found.superquadric_residuals.items()}),
        history=tuple(entry.scaled(frame.scale) for entry in result.history),
        strength=result.strength,
        noise=frame.scale * found.sigma,
        inliers=unnamed(found.inliers),
        support={name: each.scaled(frame.scale) for name, each in found.support.items()},
        extrapolations=open_surfaces(result, found.support, found.feet_of_inliers, frame),
        covariance=None if result.covariance is None else frame.scale**2 * result.covariance,
        enriched=None if result.enriched is None else replace(result.enriched, scale=frame.scale),
        prior_distance=result.prior_distance,
    )
