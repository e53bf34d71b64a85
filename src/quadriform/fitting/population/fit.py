"""The fit of a member of a population: pose and shape, by rounds on the data and a prior."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import cast

import numpy as np

from quadriform.fitting.diagnostics import folding
from quadriform.fitting.least_squares.uncertainty import EnrichedBox
from quadriform.fitting.population.coordinates import PriorCoordinates
from quadriform.fitting.population.diagnostics import outside_population
from quadriform.fitting.population.given_surfaces import GivenSurface, GivenSurfaces, State
from quadriform.fitting.population.linear_problem import PriorProblem, PriorSolution
from quadriform.fitting.population.poses import Similarity, best_pose, closest_poses, near_data, on_data
from quadriform.fitting.refinement.point_to_plane import data_rows, probes
from quadriform.fitting.refinement.refine import RefinementInput
from quadriform.fitting.refinement.stage import (
    SCHEDULE,
    Attractions,
    Datasets,
    InitialState,
    Problem,
    Refined,
    Report,
    Stage,
    StoppingRule,
    all_independent,
    independent_fraction,
    tangential_steps,
)
from quadriform.fitting.refinement.stages import with_details
from quadriform.fitting.refinement.unfolding import certified
from quadriform.fitting.result import Result
from quadriform.points import Array
from quadriform.shapes.closest import surface_normals
from quadriform.shapes.control_box import ControlBox
from quadriform.shapes.model import DeformableModel
from quadriform.shapes.prior import ShapePrior
from quadriform.shapes.superquadric import Superquadric


@dataclass(frozen=True)
class PriorRounds:
    """The constants of the rounds with a prior."""

    poses: int = 4
    """How often the rigid part of the shape becomes part of the pose, with a few rounds in between."""
    rounds: int = 4
    """Most rounds between two of these."""
    cells: int = 12
    """Of the grids of the surfaces whose map is sought anew where it folds."""
    least_deviation: float = 0.3
    """Their standard deviation is taken as at least this fraction of that of the data: a map without folds need not
    follow them more exactly."""


ROUNDS = PriorRounds()
Deviation = Callable[[Array, Array], Array]
"""From points (n, 3) before deformation and normals (n, 3) to standard deviations (n,) of a surface along these."""


@dataclass(frozen=True, kw_only=True)
class PriorRefinement(Problem):
    """What the rounds with a prior in one pose have in common.

    Attributes:
        prior: in this pose, in its coordinates.
        ratio: of the prior, where it is not estimated.
    """

    prior: PriorCoordinates
    ratio: float | None = None

    def linear_problem(  # type: ignore[override]
        self, datasets: Datasets, attractions: Attractions, box: ControlBox, effective_fraction: float
    ) -> PriorProblem:
        """The linear problem of a round as a function of the weights of the prior."""
        parts = [data_rows(data, box).equations(box) for data in datasets]
        total = sum(data.total_weight for data in datasets)
        equations = sum(parts[1:], parts[0])
        return PriorProblem(equations, self.prior, total, effective_fraction, self.least_sigma, self.ratio)


@dataclass(frozen=True)
class Posed:
    """The fit of a member of a population before its folds are removed.

    Attributes:
        prior: in the pose of the fit.
        problem: of the rounds in this pose.
        refined: the result of the rounds.
    """

    prior: ShapePrior
    problem: PriorRefinement
    refined: Refined

    @property
    def ratio(self) -> float:
        """The ratio of the prior."""
        return _ratio(self.refined)


def posed(given: RefinementInput, prior: ShapePrior, poses: Sequence[ShapePrior] | None = None) -> Posed:
    """The fit of pose and shape to all surfaces at once.

    Args:
        given: points and options.
        prior: with the surfaces of the points, in the unit of the frame of the points.
        poses: the prior where the search for its pose begins; None to search all rotations.
    """
    datasets = [given.datasets[list(given.clouds).index(name)] for name in prior.surfaces]
    report = Report(given.progress, ROUNDS.poses * ROUNDS.rounds)
    starts = closest_poses(prior, given.clouds) if poses is None else poses
    prior, box = best_pose(starts, datasets, given.options.robust)
    some = [data.subsample(SCHEDULE.fine_points, robust=False) for data in datasets]
    state: InitialState | Refined = InitialState(box, near_data(some, prior, box))
    for _ in range(ROUNDS.poses):
        state = _after_rounds(_problem(given, prior, report), state)
        motion = Similarity.between(prior, state.box)
        prior = motion.moved(prior)
        box = prior.box.with_control_points(state.box.control_points)
        state = replace(state, box=box, datasets=motion.with_surfaces(state.datasets, prior))
    problem = _problem(given, prior, report)
    found = _stage(problem, ROUNDS.rounds).run(replace(state, datasets=on_data(datasets, prior, state.box)))
    return Posed(prior, problem, found)


def refine_with_prior(given: RefinementInput, prior: ShapePrior, poses: Sequence[ShapePrior] | None = None) -> Result:
    """The refinement of all surfaces at once by the shapes of a population; the arguments are those of `posed`."""
    found = posed(given, prior, poses)
    problem = replace(found.problem, ratio=found.ratio)
    return _result(given, problem, found.prior, with_details(problem, found.refined))


def _ratio(found: Refined) -> float:
    """The ratio of the prior that the rounds ended with."""
    return cast(PriorSolution, found.solution).ratio


def _problem(given: RefinementInput, prior: ShapePrior, report: Report) -> PriorRefinement:
    return PriorRefinement(
        box=prior.box,
        probes=probes(prior.surfaces.values()),
        regularity="bending",
        strength=None,
        robust=given.options.robust,
        report=report,
        least_sigma=given.noise.least_sigma,
        prior=PriorCoordinates.of(prior),
    )


def _after_rounds(problem: PriorRefinement, start: InitialState | Refined) -> Refined:
    """The state after a round that estimates the weights of the prior, and a few rounds at these weights."""
    state = _stage(problem, 1).run(start)
    with_weights = replace(problem, strength=state.solution.strength, ratio=_ratio(state))
    # how many points count as independent only matters for the weights
    return replace(_stage(with_weights, ROUNDS.rounds - 1), independent=all_independent).run(state)


def _stage(problem: PriorRefinement, rounds: int) -> Stage:
    stop = StoppingRule(rounds, SCHEDULE.fine_motion)
    return Stage(problem, tangential_steps, problem.weighting, stop, independent_fraction)


def _result(given: RefinementInput, problem: PriorRefinement, prior: ShapePrior, found: Refined) -> Result:
    none = (None,) * len(found.datasets)
    linear = problem.linear_problem(found.datasets, none, found.box, found.solution.effective_fraction)
    # of as many control points, for the modes are those of the prior's box: no bias by too few of them is estimated
    enriched = EnrichedBox(found.box, linear, found.solution.strength)
    box: ControlBox | None = found.box
    if not certified(found.box, prior.surfaces):
        box = without_folds(prior.surfaces, found.box, partial(enriched.deviation, found.box), found.sigma)
    model = DeformableModel(prior.surfaces, found.box if box is None else box)
    by_name = dict(zip(prior.surfaces, found.datasets))
    distance = prior.distance(found.box.control_points - found.box.rest)
    return Result(
        model=model,
        history=found.history,
        strength=found.solution.strength,
        sigma=found.sigma,
        covariance=found.solution.covariance(),
        enriched=enriched,
        inliers={name: by_name[name].inliers for name in given.clouds},
        warnings=outside_population(prior, distance) | (folding(model) if box is None else {}),
        half_space=given.half_space,
        prior_distance=distance,
    )


def without_folds(
    surfaces: Mapping[str, Superquadric], box: ControlBox, deviation: Deviation, sigma: float
) -> ControlBox | None:
    """A box with the same surfaces, and a map without folds that bends as little as they allow; None if none is found.

    The population is known by its surfaces, and the modes say nothing about the space inside. So points of the surfaces
    found are fitted without the prior, as data whose noise is the standard deviation of these surfaces: where they are
    known well they stay, and beyond the data, where two of them may even cross, they give way.

    Args:
        surfaces: name -> superquadric.
        box: that may fold.
        deviation: of the surfaces, at points before deformation along normals.
        sigma: standard deviation of the data.
    """
    given, origins = list[GivenSurface](), list[Array]()
    for surface in surfaces.values():
        origins.append(surface.grid(ROUNDS.cells)[0])
        deviations = deviation(origins[-1], surface_normals(surface, box, origins[-1]))
        deviations = np.maximum(deviations, ROUNDS.least_deviation * sigma)
        given.append(GivenSurface(surface, box.deform(origins[-1]), deviations))
    l, m, n, _ = box.control_points.shape
    return GivenSurfaces.of(given, (l, m, n)).without_folds(State(box, tuple(origins)))
