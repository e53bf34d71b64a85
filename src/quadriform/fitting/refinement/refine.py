"""The refinement by point-to-plane distances as a whole: starts, stages, the size of the box, and fold removal.

A refinement is certified when the map is verified not to fold inside the surfaces, and these do not cross
(`unfolding.certified`).
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from quadriform.errors import OptionError, Warnings
from quadriform.fitting.cloud import best_first
from quadriform.fitting.diagnostics import INLIER, POOR, folding, ill_conditioned, max_error_missed, smoother_than_data
from quadriform.fitting.least_squares.uncertainty import EnrichedBox
from quadriform.fitting.noise import KnownNoise
from quadriform.fitting.options import TangentOptions, check_box, check_strength
from quadriform.fitting.refinement.point_to_plane import linear_problem_of, probes
from quadriform.fitting.refinement.stage import SCHEDULE, Problem, Refined, Report, independent_fraction
from quadriform.fitting.refinement.stages import (
    all_coarse_stages,
    control_point_counts,
    fine_stage,
    first_stage,
    warm_start,
)
from quadriform.fitting.refinement.starts import candidates
from quadriform.fitting.refinement.surface_data import Subsample, SurfaceData
from quadriform.fitting.refinement.unfolding import accepted_sigma, least_regularised, without_folds
from quadriform.fitting.result import HalfSpace, Progress, Result
from quadriform.fitting.support import rms_without_data
from quadriform.fitting.support_settings import LIMITS
from quadriform.point_sets import ALONE
from quadriform.points import Array
from quadriform.shapes.closest import closest_on
from quadriform.shapes.control_box import ControlBox, common_box
from quadriform.shapes.fold_bound import never_folds
from quadriform.shapes.model import DeformableModel
from quadriform.shapes.superquadric import Superquadric

AUTO_SIDES = (3, 5, 7)
MORE = 2
"""Additional control points a side of the enriched box: the next step of 3, 5, 7. Its surface differs from the fitted
one where that has too few control points, which is part of the uncertainty (`least_squares/uncertainty.py`)."""
MUCH_NEARER = 0.5
"""A start is tried first where the RMS distance of the points from its undeformed surface (`_Trial.undeformed_rms`) is
below this fraction of the least sigma (of point-to-plane residuals) of any start after its first stage: then the first
stage led away from a good start. At the true surface both are the noise, and the rule has no effect."""

SMOOTH = (100.0, 10.0)
"""Factors on the strength of the first stage, for two refinements of a smooth box: the second continues from the result
of the first. At smaller factors a surface of open contours amplifies the rounding of the data to a thousandth of its
size and more."""


@dataclass(frozen=True)
class RefinementInput:
    """What is refined, in the centred, scaled frame.

    Attributes:
        clouds: name -> (n, 3) points.
        weights: name -> (n,), above 0.
        normals: name -> (n, 3) unit or zero, of the clouds that were given some.
        noise: what is known of the noise of the points.
        options: of the refinement.
        half_space: where no data is expected.
        max_error: RMS distance that box="auto" must reach.
        warm_start: a deformed box to continue from, or None; its number of control points replaces that of the options.
        progress: called after each round.
    """

    clouds: Mapping[str, Array]
    weights: Mapping[str, Array]
    normals: Mapping[str, Array]
    noise: KnownNoise
    options: TangentOptions
    half_space: HalfSpace | None = None
    max_error: float | None = None
    warm_start: ControlBox | None = None
    progress: Progress | None = None

    @cached_property
    def datasets(self) -> list[SurfaceData]:
        """The data of each surface, with a unit sphere in place of its superquadric until there are starts."""
        known, sphere, datasets = self.noise, Superquadric(), list[SurfaceData]()
        for name, cloud in self.clouds.items():
            normals, covariances, least = self.normals.get(name), known.relative.get(name), known.least_sigma
            weights, half_space = self.weights[name], self.half_space
            datasets.append(SurfaceData.of(sphere, cloud, weights, half_space, normals, covariances, least))
        return datasets

    @cached_property
    def first_sample(self) -> Subsample:
        """The points of the first stage, with unit spheres in place of the superquadrics."""
        return Subsample.of(self.datasets, SCHEDULE.first_points, self.options.robust)


def refine_tangent(
    given: RefinementInput, superquadrics: dict[str, Superquadric], kind_of_other_starts: str | None
) -> Result:
    """The refinement of all surfaces at once.

    Args:
        given: points and options.
        superquadrics: name -> superquadric to start from.
        kind_of_other_starts: of superquadrics that are tried as starts too; None to try only the given ones.
    """
    starts = [superquadrics]
    if kind_of_other_starts is not None:
        starts = candidates(given.clouds, superquadrics, kind_of_other_starts)
    if given.warm_start is not None:
        return _best_start(given, starts, check_box(given.warm_start.control_points.shape[:3]))
    if given.max_error is None:
        return _best_start(given, starts, check_box(given.options.box))
    for side in AUTO_SIDES:
        result = _best_start(given, starts, (side, side, side))
        error = _error(result, given.clouds, given.weights)
        if error <= given.max_error:
            return result
    missed = max_error_missed(AUTO_SIDES[-1], error / given.max_error, (result.sigma or 0) / given.max_error)
    return replace(result, warnings=result.warnings | missed)


def smooth_box(given: RefinementInput, superquadrics: dict[str, Superquadric]) -> ControlBox:
    """A smooth box, in which all frames of `track` start, refined at large strengths.

    These are the strength of the first stage times each factor of `SMOOTH` in turn. The box is that of the last
    refinement before one that folds or leaves control points undetermined, and so has no folds. Where that is the first
    one, it is the box after the first stage, which is not checked for folds. Folds are not removed: that would amplify
    rounding as well. The options must not have a strength.
    """
    l, m, n = shape = check_box(given.options.box)
    first = _Trial.of(given, superquadrics, shape).first
    box = first.box.elevate((l - 1, m - 1, n - 1))
    for number, factor in enumerate(SMOOTH):
        options = replace(given.options, strength=factor * first.solution.strength)
        trial = _Trial.of(replace(given, options=options, warm_start=box if number else None), superquadrics, shape)
        try:
            found = fine_stage(trial.problem, trial.datasets, trial.coarse).box
        except OptionError:  # this strength leaves control points undetermined
            break
        if not never_folds(found, trial.surfaces.values()):
            break
        box = found
    return box


def _error(result: Result, clouds: Mapping[str, Array], weights: Mapping[str, Array]) -> float:
    """RMS distance of the points to the model, counted by their weights times their inlier probabilities."""
    counts = {name: weights[name] * each for name, each in (result.inliers or {}).items()}
    squares = sum(float(counts[name] @ result.model.distance(cloud, name) ** 2) for name, cloud in clouds.items())
    return float(np.sqrt(squares / sum(float(each.sum()) for each in counts.values())))


def _best_start(
    given: RefinementInput, starts: Sequence[dict[str, Superquadric]], shape: tuple[int, int, int]
) -> Result:
    """The best certified refinement of all starts, or what comes nearest to one.

    The first start is the first one that is tried, and the accepted noise is relative to that of its refinement.

    1. Where a start has a certified refinement within the accepted noise, it is that one; with several surfaces, if
       none has, the certified one of least noise. Where parts of its surface are far from data although data covers
       the body, that of least misfit both ways, of the refinements up to the first without such parts.
    2. Where there is none, and the first start is a poor fit: the certified refinement of it with the least noise at
       larger strengths (`least_regularised`). Where it is no poor fit, and `robust`: a certified refinement without
       robust weights. With these, whole faces of a body with sharp edges can be taken for outliers, and then no data
       prevents folds there.
    3. Where that does not exist, the refinement of the first start with its folds, and `FOLDING`.

    `POOR_FIT` is reported where the removal of folds made the distances from the points much larger.
    """
    first, best = _first_and_best(given, starts, shape)
    trial, refined, _ = first
    if best is None and refined.sigma > POOR:
        regularised = least_regularised(trial.problem, refined, trial.surfaces)
        best = None if regularised is None else Attempt(trial, regularised)
    elif best is None and given.options.robust:
        unweighted = replace(given, options=replace(given.options, robust=False))
        _, best = _first_and_best(unweighted, starts, shape, accepted_sigma(refined.sigma))
    if best is None:
        return _result(first, folding(DeformableModel(trial.surfaces, refined.box)))
    is_close = best.refined.sigma <= accepted_sigma(refined.sigma)
    return _result(best, {} if is_close else smoother_than_data(best.refined.sigma, refined.sigma))


def _first_and_best(
    given: RefinementInput,
    starts: Sequence[dict[str, Superquadric]],
    shape: tuple[int, int, int],
    largest_sigma: float | None = None,
) -> tuple["Attempt", "Attempt | None"]:
    """The refinement of the first start, and a certified one of accepted noise, else that of least noise.

    Starts are tried in the order of the marginal likelihood after their first stage, those whose surfaces cross last.
    The first certified one is taken, unless its surfaces are farther from data, where they have none, than the noise.
    Then others follow, up to the first that is nearer than that, and of all these the one of least misfit is taken.
    With several surfaces in one box the space between them must not fold: there any noise is accepted where none is
    better. None in place of the second where no refinement is certified within the accepted noise.

    Args:
        given: points and options.
        starts: superquadrics by name.
        shape: control points along each axis.
        largest_sigma: the accepted noise; None for one relative to that of the first start.
    """
    attempts, noisy, found = list["Attempt"](), list["Attempt"](), list["Attempt"]()
    for trial in _crossing_last(_ordered(given, starts, shape)):
        refined = fine_stage(trial.problem, trial.datasets, trial.coarse)
        attempts.append(Attempt(trial, refined))
        accepted = accepted_sigma(attempts[0].refined.sigma) if largest_sigma is None else largest_sigma
        # between several surfaces a fold is worse than noise
        limit = np.inf if len(trial.surfaces) > 1 else accepted
        for certified in without_folds(trial.problem, refined, trial.surfaces, limit):
            if certified.sigma > accepted:
                noisy.append(Attempt(trial, certified))
                continue
            found.append(Attempt(trial, certified, rms_far_from_data(certified)))
            if found[-1].far_from_data <= found[0].refined.sigma:
                return attempts[0], min(found, key=Attempt.misfit)
    return attempts[0], min(found or noisy, key=Attempt.misfit, default=None)


def _ordered(
    given: RefinementInput, starts: Sequence[dict[str, Superquadric]], shape: tuple[int, int, int]
) -> "list[_Trial]":
    """Trials of the starts, the one of largest evidence after its first stage first.

    A start that is much nearer to the points undeformed than any is after its first stage comes before it: beside sharp
    edges the correspondence of the first stage can be wrong.
    """
    trials = [_Trial.of(given, superquadrics, shape) for superquadrics in starts]
    if len(trials) == 1:
        return trials
    # `best_first` puts the largest value first; the criterion is minus twice the log evidence
    order = best_first(np.array([-trial.first.solution.criterion for trial in trials]))
    undeformed = np.array([trial.undeformed_rms for trial in trials])
    nearest = best_first(-undeformed)[0]
    if undeformed[nearest] < MUCH_NEARER * min(trial.first.sigma for trial in trials):
        order = np.array([nearest, *order[order != nearest]])
    return [trials[index] for index in order]


@dataclass(frozen=True)
class _Trial:
    """A start, of superquadrics by name, and its coarse stages when they are needed."""

    given: RefinementInput
    surfaces: dict[str, Superquadric]
    problem: Problem
    datasets: list[SurfaceData]

    @classmethod
    def of(
        cls, given: RefinementInput, superquadrics: dict[str, Superquadric], shape: tuple[int, int, int]
    ) -> "_Trial":
        """From superquadrics by name and the number of control points along each axis."""
        surfaces = {name: superquadrics[name] for name in given.clouds}
        box, options = common_box(superquadrics, shape), given.options
        report = Report(given.progress, SCHEDULE.coarse_rounds * len(control_point_counts(box)) + SCHEDULE.fine_rounds)
        strength = check_strength(options.strength)
        measured = probes(surfaces.values())
        problem = Problem(box, measured, options.regularity, strength, options.robust, report, given.noise.least_sigma)
        datasets = [data.with_superquadric(each) for data, each in zip(given.datasets, surfaces.values())]
        return cls(given, surfaces, problem, datasets)

    @cached_property
    def first(self) -> Refined:
        """After the first stage."""
        return first_stage(self.problem, self.given.first_sample.with_superquadrics(self.surfaces.values()))

    @cached_property
    def undeformed_rms(self) -> float:
        """RMS distance of the points of the first stage to the superquadrics."""
        box, datasets = self.problem.box, self.given.first_sample.with_superquadrics(self.surfaces.values()).datasets
        distances = [data.with_nearest_foot_points(box).distances(box) for data in datasets]
        return float(np.sqrt((np.concatenate(distances) ** 2).mean()))

    @cached_property
    def coarse(self) -> Refined:
        """After the coarse stages, or one round from a given box."""
        if self.given.warm_start is not None:
            return warm_start(self.problem, self.datasets, self.given.warm_start)
        return all_coarse_stages(self.problem, self.first, self.datasets)


class Attempt(NamedTuple):
    """A start, a refinement of it, and how far its surfaces are from data where they have none: `rms_far_from_data`."""

    trial: _Trial
    refined: Refined
    far_from_data: float = 0.0

    def misfit(self) -> float:
        """The RMS distance between points and surfaces, both ways."""
        return float(np.hypot(self.refined.sigma, self.far_from_data))


def rms_far_from_data(refined: Refined) -> float:
    """The distance from data of the parts of surfaces without support, as RMS over all area; 0 of partial or no data.

    A closed surface that data covers has data everywhere, so such a part is wrong, however near the points are: the
    tip of a superquadric beyond the end of a body, to which no point belongs, stays where it is.
    """
    if not all(data.is_covered() and (data.inliers >= INLIER).any() for data in refined.datasets):
        return 0.0
    squares = list[float]()
    for data in refined.datasets:
        model, kept = DeformableModel({ALONE: data.superquadric}, refined.box), data.inliers >= INLIER
        mesh = model.mesh(resolution=LIMITS.resolution)
        feet = closest_on(data.superquadric, refined.box, data.points[kept]).points
        excluded = data.in_half_space(mesh.vertices[mesh.faces].mean(axis=1))
        squares.append(rms_without_data(mesh, data.points[kept], feet, refined.sigma, excluded) ** 2)
    return float(np.sqrt(np.mean(squares)))


def _crossing_last(trials: Sequence[_Trial]) -> Iterator[_Trial]:
    """The trials in their order, those whose surfaces cross after the coarse stages at the end."""
    last = []
    for trial in trials:
        if trial.coarse.crosses_though_covered:
            last.append(trial)
        else:
            yield trial
    yield from last


def _result(attempt: Attempt, warnings: Warnings) -> Result:
    trial, refined, _ = attempt
    model, given = DeformableModel(trial.surfaces, refined.box), trial.given
    return Result(
        model=model,
        history=refined.history,
        strength=refined.solution.strength,
        sigma=refined.sigma,
        covariance=refined.solution.covariance(),
        enriched=_enriched(trial.problem, refined),
        inliers={name: data.inliers for name, data in zip(given.clouds, refined.datasets)},
        warnings=warnings | ill_conditioned(model, refined.solution, refined.sigma),
        half_space=given.half_space,
    )


def _enriched(problem: Problem, refined: Refined) -> EnrichedBox:
    """The problem of the same foot points in a box with more control points, for the uncertainty."""
    l, m, n = refined.box.degrees
    # the same deformation, so foot points and inlier probabilities stay
    enriched = refined.box.elevate((l + MORE, m + MORE, n + MORE))
    # by the residuals of the result: rounds that converge at once have that with which their stage began
    fraction = independent_fraction(refined.datasets, refined.box, problem.unknowns)
    none = (None,) * len(refined.datasets)
    # of the data alone: the prior beyond a base is no measurement
    linear = linear_problem_of(refined.datasets, none, enriched, problem.regularity, fraction, problem.least_sigma)
    return EnrichedBox(enriched, linear, refined.solution.strength)
