"""The refinement by point-to-plane distances as a whole: starts, stages, the size of the box, and fold removal."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from quadriform.errors import Warnings
from quadriform.fitting.cloud import best_first
from quadriform.fitting.diagnostics import POOR, folding, ill_conditioned, max_error_missed, smoother_than_data
from quadriform.fitting.least_squares.uncertainty import EnrichedBox
from quadriform.fitting.noise import KnownNoise
from quadriform.fitting.options import TangentOptions, check_box, check_strength
from quadriform.fitting.refinement.multiresolution import SCHEDULE, Problem, Refined, Report
from quadriform.fitting.refinement.point_to_plane import linear_problem_of, probes
from quadriform.fitting.refinement.stages import (
    all_coarse_stages,
    control_point_counts,
    fine_stage,
    first_stage,
    warm_start,
)
from quadriform.fitting.refinement.starts import candidates
from quadriform.fitting.refinement.surface_data import Subsample, SurfaceData
from quadriform.fitting.refinement.unfolding import accepted_noise, least_regularised, without_folds
from quadriform.fitting.result import HalfSpace, Progress, Result
from quadriform.points import Array
from quadriform.shapes.control_box import ControlBox, common_box
from quadriform.shapes.model import DeformableModel
from quadriform.shapes.superquadric import Superquadric

AUTO_SIDES = (3, 5, 7)
MORE = 2
"""Additional control points a side of the enriched box of the uncertainty: the next step of 3, 5, 7."""
MUCH_NEARER = 0.5
"""An undeformed start at less than this fraction of the distance of all starts after their first stage is tried first.
For a start at the true surface both are the same."""


@dataclass(frozen=True)
class LocalProblem:
    """What is refined, in the centred, scaled frame.

    Attributes:
        clouds: name -> (n, 3) points.
        weights: name -> (n,), above 0.
        normals: name -> (n, 3) unit or zero, of the clouds that were given some.
        noise: what is known of the noise of the points.
        options: of the refinement.
        half_space: where no data is expected.
        max_error: RMS distance that box="auto" must reach.
        start: a deformed box to continue from; its number of control points takes precedence over that of the options.
        progress: called after each round.
    """

    clouds: Mapping[str, Array]
    weights: Mapping[str, Array]
    normals: Mapping[str, Array]
    noise: KnownNoise
    options: TangentOptions
    half_space: HalfSpace | None = None
    max_error: float | None = None
    start: ControlBox | None = None
    progress: Progress | None = None

    @cached_property
    def datasets(self) -> list[SurfaceData]:
        """The data of each surface; around spheres, until there are starts."""
        normals, noise = self.normals.get, self.noise.relative.get
        return [
            SurfaceData.of(Superquadric(), cloud, self.weights[name], self.half_space, normals(name), noise(name))
            for name, cloud in self.clouds.items()
        ]

    @cached_property
    def first_sample(self) -> Subsample:
        """The points of the first stage, around spheres."""
        return Subsample.of(self.datasets, SCHEDULE.first_points, self.options.robust)


def refine_tangent(problem: LocalProblem, surfaces: dict[str, Superquadric], kind: str | None) -> Result:
    """The refinement of all surfaces at once.

    Args:
        problem: points and options.
        surfaces: name -> start.
        kind: other starts of this kind may replace the given ones; None keeps them.
    """
    starts = [surfaces] if kind is None else candidates(problem.clouds, surfaces, kind)
    if problem.start is not None:
        return _best_start(problem, starts, check_box(problem.start.control_points.shape[:3]))
    if problem.max_error is None:
        return _best_start(problem, starts, check_box(problem.options.box))
    for side in AUTO_SIDES:
        result = _best_start(problem, starts, (side, side, side))
        error = _error(result, problem.clouds)
        if error <= problem.max_error:
            return result
    missed = max_error_missed(AUTO_SIDES[-1], error / problem.max_error, (result.noise or 0) / problem.max_error)
    return replace(result, warnings=result.warnings | missed)


def _error(result: Result, clouds: Mapping[str, Array]) -> float:
    """RMS distance of the inliers to the model."""
    inliers = result.inliers or {}
    squares = sum(float(inliers[name] @ result.model.distance(cloud, name) ** 2) for name, cloud in clouds.items())
    return float(np.sqrt(squares / sum(float(weights.sum()) for weights in inliers.values())))


def _best_start(
    problem: LocalProblem, starts: Sequence[dict[str, Superquadric]], shape: tuple[int, int, int]
) -> Result:
    """The best certified refinement; a fold is kept, and reported, only by a fit that is not poor.

    Where no start gives a certified one, all are tried once more without robust weights: with these, whole faces of a
    body with sharp edges can be taken for outliers, and then no data prevents folds there.
    """
    first, found = _certified(problem, starts, shape)
    trial, folded = first
    if found is None and folded.noise > POOR:
        regularised = least_regularised(trial.problem, folded, trial.surfaces)
        found = None if regularised is None else (trial, regularised)
    elif found is None and problem.options.robust:
        unweighted = replace(problem, options=replace(problem.options, robust=False))
        found = _certified(unweighted, starts, shape, accepted_noise(folded.noise))[1]
    if found is None:
        return _result(*first, folding(DeformableModel(trial.surfaces, folded.box)))
    is_close = found[1].noise <= accepted_noise(folded.noise)
    return _result(*found, {} if is_close else smoother_than_data(found[1].noise, folded.noise))


def _certified(
    problem: LocalProblem,
    starts: Sequence[dict[str, Superquadric]],
    shape: tuple[int, int, int],
    largest_noise: float | None = None,
) -> tuple["Tried", "Tried | None"]:
    """The first start refined, and the best start that is free of folds at an accepted noise, or at the least noise.

    Starts are tried in the order of the evidence after their first stage, self-intersecting ones last. With several
    surfaces in one box the space between them must not fold: there any noise is accepted where none is better.

    Args:
        problem: points and options.
        starts: superquadrics by name.
        shape: control points along each axis.
        largest_noise: the accepted noise; None for that of the first start.
    """
    tried, noisy = list["Tried"](), list["Tried"]()
    for trial in _self_intersecting_last(_ordered(problem, starts, shape)):
        refined = fine_stage(trial.problem, trial.datasets, trial.coarse)
        tried.append((trial, refined))
        accepted = accepted_noise(tried[0][1].noise) if largest_noise is None else largest_noise
        # between several surfaces a fold is worse than noise
        limit = np.inf if len(trial.surfaces) > 1 else accepted
        for found in without_folds(trial.problem, refined, trial.surfaces, limit):
            if found.noise <= accepted:
                return tried[0], (trial, found)
            noisy.append((trial, found))
    return tried[0], min(noisy, key=lambda found: found[1].noise, default=None)


def _ordered(
    problem: LocalProblem, starts: Sequence[dict[str, Superquadric]], shape: tuple[int, int, int]
) -> "list[_Trial]":
    """Trials of the starts, the one of largest evidence after its first stage first.

    A start that is much nearer to the points undeformed than any is after its first stage comes before it: beside sharp
    edges the correspondence of the first stage can be wrong.
    """
    # the criterion is minus twice the log evidence, so the least is the best
    trials = [_Trial.of(problem, surfaces, shape) for surfaces in starts]
    if len(trials) == 1:
        return trials
    order = best_first(np.array([-trial.first.solution.criterion for trial in trials]))
    undeformed = np.array([trial.undeformed_noise for trial in trials])
    nearest = best_first(-undeformed)[0]
    if undeformed[nearest] < MUCH_NEARER * min(trial.first.noise for trial in trials):
        order = np.array([nearest, *order[order != nearest]])
    return [trials[index] for index in order]


@dataclass(frozen=True)
class _Trial:
    """A start, and its coarse stages when they are needed."""

    local: LocalProblem
    surfaces: dict[str, Superquadric]
    problem: Problem
    datasets: list[SurfaceData]

    @classmethod
    def of(cls, local: LocalProblem, start: dict[str, Superquadric], shape: tuple[int, int, int]) -> "_Trial":
        """From superquadrics by name and the number of control points along each axis."""
        surfaces = {name: start[name] for name in local.clouds}
        box, options = common_box(start, shape), local.options
        report = Report(local.progress, SCHEDULE.coarse_rounds * len(control_point_counts(box)) + SCHEDULE.fine_rounds)
        strength = check_strength(options.strength)
        measured = probes(surfaces.values())
        problem = Problem(box, measured, options.regularity, strength, options.robust, report, local.noise.least)
        datasets = [data.around(each) for data, each in zip(local.datasets, surfaces.values())]
        return cls(local, surfaces, problem, datasets)

    @cached_property
    def first(self) -> Refined:
        """After the first stage."""
        return first_stage(self.problem, self.local.first_sample.around(list(self.surfaces.values())))

    @cached_property
    def undeformed_noise(self) -> float:
        """RMS distance of the points of the first stage to the superquadrics."""
        box, datasets = self.problem.box, self.local.first_sample.around(list(self.surfaces.values())).datasets
        distances = [data.with_nearest_foot_points(box).distances(box) for data in datasets]
        return float(np.sqrt((np.concatenate(distances) ** 2).mean()))

    @cached_property
    def coarse(self) -> Refined:
        """After the coarse stages, or one round from a given box."""
        if self.local.start is not None:
            return warm_start(self.problem, self.datasets, self.local.start)
        return all_coarse_stages(self.problem, self.first, self.datasets)


Tried = tuple[_Trial, Refined]
"""A start and its refinement."""


def _self_intersecting_last(trials: Sequence[_Trial]) -> Iterator[_Trial]:
    """The trials in their order, those whose surfaces intersect after the coarse stages at the end."""
    last = []
    for trial in trials:
        if trial.coarse.self_intersecting():
            last.append(trial)
        else:
            yield trial
    yield from last


def _result(trial: _Trial, refined: Refined, warnings: Warnings) -> Result:
    model, local = DeformableModel(trial.surfaces, refined.box), trial.local
    return Result(
        model=model,
        history=refined.history,
        strength=refined.solution.strength,
        noise=refined.noise,
        covariance=refined.solution.covariance(),
        enriched=_enriched(trial.problem, refined),
        inliers={name: data.inliers for name, data in zip(local.clouds, refined.datasets)},
        warnings=warnings | ill_conditioned(model, refined.solution),
        half_space=local.half_space,
    )


def _enriched(problem: Problem, refined: Refined) -> EnrichedBox:
    """The problem of the same foot points in a box with more control points."""
    l, m, n = refined.box.degrees
    # the same deformation, so foot points and inlier probabilities stay
    enriched = refined.box.elevate((l + MORE, m + MORE, n + MORE))
    none, fraction = (None,) * len(refined.datasets), refined.solution.effective_fraction
    # of the data alone: the prior beyond a base is no measurement
    linear = linear_problem_of(refined.datasets, none, enriched, problem.regularity, fraction, problem.least_noise)
    return EnrichedBox(enriched, linear, refined.solution.strength)
