"""One stage of the coarse-to-fine refinement: its state, its parts, and the rounds at one number of control points.

A round updates the foot points, the inlier probabilities and the control points (the linear problem at a selected
strength). A stage makes rounds until the surface hardly moves. `stages.py` has the sequence of stages, from few control
points and few data points to all of them. The glossary is in `quadriform/fitting/__init__.py`.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Protocol

import numpy as np

from quadriform.fitting.least_squares.marginal_likelihood import LinearProblem, Solution
from quadriform.fitting.least_squares.normal_equations import NormalEquations
from quadriform.fitting.least_squares.regularisers import Regulariser
from quadriform.fitting.refinement.base_prior import base_priors
from quadriform.fitting.refinement.correspondence import Correspondence
from quadriform.fitting.refinement.point_to_plane import (
    Attraction,
    displaced,
    effective_fraction_of_data,
    linear_problem_of,
    record,
    step_length,
)
from quadriform.fitting.refinement.surface_data import Subsample, SurfaceData, with_excess
from quadriform.fitting.result import Iteration, Progress
from quadriform.points import Array
from quadriform.shapes.control_box import ControlBox
from quadriform.shapes.model import DeformableModel

Datasets = tuple[SurfaceData, ...]
Attractions = tuple[Attraction | None, ...]
FootPointUpdate = Callable[[ControlBox, Datasets], tuple[Datasets, Attractions]]
"""From a deformed box and data to the data with new foot points, and attractions of model points, or None for each."""


@dataclass(frozen=True)
class Schedule:
    """The constants of the stages: numbers of points and rounds, and fractions of the noise."""

    first_points: int = 400
    """Points of each surface in the first stage, in which superquadrics to start from are compared."""
    coarse_points: int = 1000
    """Points of each surface in the coarse stages."""
    other_coarse_points: tuple[int, ...] = (700, 1500)
    """Their numbers if the result intersects itself, in turn: another subsample may lead to another minimum."""
    fine_points: int = 3000
    """Points of each surface in the fine stage; a last stage uses all, when the surface has nearly converged."""
    coarse_rounds: int = 8
    """Most rounds of each coarse stage; most stages stop earlier."""
    fine_rounds: int = 10
    """Most rounds of the fine stage."""
    last_rounds: int = 3
    """Most rounds of the last stage, on all points."""
    coarse_motion: float = 0.2
    fine_motion: float = 0.02
    """A stage ends when the RMS motion of the surface in a round is below this fraction of the noise."""
    strength_searches: int = 3
    """Most searches for a smaller strength by cross-validation, each from the result of the one before."""
    tangential_steps: int = 3
    """Gauss-Newton steps of each foot point in a round; the next round continues from there."""


SCHEDULE = Schedule()
MAD_TO_SIGMA = 1.4826
"""From the median absolute distance to the standard deviation of a Gaussian; its breakdown point is 50 % outliers."""


@dataclass(frozen=True)
class InitialState:
    """The state before the first round of a stage.

    Attributes:
        box: deformed.
        datasets: one for each surface.
        solution: of the stage before, where the search for the strength begins; or None.
        history: one record for each round so far.
    """

    box: ControlBox
    datasets: Datasets
    solution: Solution | None = None
    history: tuple[Iteration, ...] = ()

    @property
    def sigma(self) -> float | None:
        """Standard deviation of the inliers' point-to-plane residuals; None before there is a solution."""
        return None if self.solution is None else self.solution.sigma


@dataclass(frozen=True)
class Refined:
    """A box refined by at least one round, in the centred, scaled frame.

    Attributes:
        box: deformed.
        datasets: one for each surface, with foot points and inlier probabilities.
        solution: of the last round.
        history: one record for each round.
    """

    box: ControlBox
    datasets: Datasets
    solution: Solution
    history: tuple[Iteration, ...]

    @property
    def sigma(self) -> float:
        """Standard deviation of the inliers' point-to-plane residuals."""
        return self.solution.sigma

    @cached_property
    def crosses_though_covered(self) -> bool:
        """Whether a surface crosses itself or another although the data covers every surface.

        By `SurfaceData.is_covered` it is False for contours and data with gaps: there the coarse stages are not
        repeated, and a crossing is removed with the folds, at larger strengths.
        """
        if not all(data.is_covered() for data in self.datasets):
            return False
        surfaces = {str(number): data.superquadric for number, data in enumerate(self.datasets)}
        return bool(DeformableModel(surfaces, self.box).crossings())

    def nearest(self) -> "Refined":
        """The state with the nearest foot points."""
        return replace(self, datasets=tuple(data.with_nearest_foot_points(self.box) for data in self.datasets))


class Penalty(Protocol):
    """A cost of the box besides the data's and the regulariser's."""

    def equations(self, box: ControlBox) -> NormalEquations:
        """Its normal equations, linearised at a box; the unknowns are displacements from the undeformed box."""

    def cost(self, box: ControlBox) -> float:
        """The cost itself."""


def tangential_steps(box: ControlBox, datasets: Datasets) -> tuple[Datasets, Attractions]:
    """Data with foot points after a few tangential Gauss-Newton steps from where they are; no attractions."""
    steps = SCHEDULE.tangential_steps
    return tuple(data.with_tangential_steps(box, steps) for data in datasets), (None,) * len(datasets)


def nearest_foot_points(box: ControlBox, datasets: Datasets) -> tuple[Datasets, Attractions]:
    """Data with the nearest foot points of the whole surface; no attractions."""
    return tuple(data.with_nearest_foot_points(box) for data in datasets), (None,) * len(datasets)


@dataclass(frozen=True)
class FacingPairs:
    """Correspondence of data points and model points whose normals face the same side, in both directions.

    Each data point is paired with a near model point of similar normal. For a surface that the data covers completely,
    model points that no data point chose are attracted to data points too, by the terms of an `Attraction`.

    Attributes:
        pairs: of each surface, the data points and the model points among which pairs are found.
        covered: whether the data covers each surface.
    """

    pairs: tuple[Correspondence, ...]
    covered: tuple[bool, ...]

    @classmethod
    def of(cls, sample: Subsample) -> "FacingPairs":
        """For the points of a subsample."""
        both = zip(sample.datasets, sample.clouds)
        return cls(tuple(Correspondence.between(data.superquadric, cloud) for data, cloud in both), sample.covered)

    def update(self, box: ControlBox, datasets: Datasets) -> tuple[Datasets, Attractions]:
        """Data with new foot points, then moved tangentially; and attractions of model points without data."""
        result, attractions = list[SurfaceData](), list[Attraction | None]()
        for pairs, covered, data in zip(self.pairs, self.covered, datasets):
            # pairs are points of a grid; tangential steps move the foot points to positions between them
            costs = pairs.costs(box)
            paired = replace(data, origins=pairs.matched(costs))
            result.append(paired.with_tangential_steps(box, SCHEDULE.tangential_steps))
            attractions.append(pairs.attraction(costs, box, result[-1]) if covered else None)
        return tuple(result), tuple(attractions)


class WeightingRule(Protocol):
    """A rule for the inlier probabilities: the robust kernel."""

    def weighted(self, box: ControlBox, datasets: Datasets, sigma: float | None) -> Datasets:
        """Data with the inlier probabilities at a sigma of the residuals; None where it is not known."""


class FixedWeights:
    """Inlier probabilities that are not updated; at first they are one."""

    def weighted(self, box: ControlBox, datasets: Datasets, sigma: float | None) -> Datasets:
        """The same data."""
        return datasets


class MixtureWeights:
    """Inlier probabilities by a mixture of Gaussian inliers and uniform outliers."""

    def weighted(self, box: ControlBox, datasets: Datasets, sigma: float | None) -> Datasets:
        """Data with the probabilities at a sigma; a sigma of None stands for an estimate from the median distance."""
        if sigma is None:  # of all surfaces together: a median is no estimate for a surface of outliers alone
            distances = [data.standardised_distances(box) for data in datasets]
            sigma = MAD_TO_SIGMA * float(np.median(np.concatenate(distances)))
        return tuple(data.with_inliers(box, sigma) for data in datasets)


@dataclass(frozen=True)
class StoppingRule:
    """When a stage ends.

    Attributes:
        rounds: after so many.
        motion: earlier where the RMS motion of the surface in a round is below this fraction of sigma.
    """

    rounds: int
    motion: float = 0.0

    def converged(self, state: Refined) -> bool:
        """Whether the surface moved less in the last round."""
        return state.history[-1].surface_motion < self.motion * state.sigma


ONCE, FIXED = StoppingRule(1), FixedWeights()


IndependentFraction = Callable[[Datasets, ControlBox | None, float], float]
"""A rule for how many points count as independent, as `all_independent` and `independent_fraction`."""


def all_independent(datasets: Datasets, fitted: ControlBox | None, least: float) -> float:
    """One: all points count as independent."""
    return 1.0


def independent_fraction(datasets: Datasets, fitted: ControlBox | None, least: float) -> float:
    """Effective number of independent points over the number of all points, in (0, 1].

    It changes the evidence, and so the strength, and the uncertainty; points are not weighted by it
    (`marginal_likelihood.py`).

    Errors of neighbours may be correlated, as those of a contour, a mask or a scan are. The correlation is estimated
    from the residuals of a fit, and the fit depends on it, through the strength. Two kinds of fits agree with their own
    residuals. A smooth fit leaves the correlated errors as residuals: few points count, and the strength is large. A
    fit that follows these errors leaves residuals that look independent: all points count, and the strength is small.
    The smooth one is meant. So in the first round of a stage that starts without a solution only `least` points count,
    which gives a smooth surface; each later round uses the residuals of the round before.

    Args:
        datasets: one for each surface.
        fitted: the box after the round before; None in the first round of a stage that starts without a solution.
        least: least effective number of points. With fewer than there are unknowns the evidence would have no maximum
            where a surface without details fits.
    """
    total_weight = sum(data.total_weight for data in datasets)
    least_fraction = least / max(total_weight, least)
    return least_fraction if fitted is None else max(least_fraction, effective_fraction_of_data(datasets, fitted))


class Report:
    """Counts rounds for the caller's progress; `total` is an expected number, and more rounds may be done."""

    def __init__(self, progress: Progress | None, total: int) -> None:
        self.progress, self.total, self.done = progress, total, 0

    def round(self) -> None:
        """One more round is done."""
        self.done += 1
        if self.progress is not None:
            self.progress(self.done, self.total)


@dataclass(frozen=True)
class Problem:
    """What all rounds of a refinement have in common.

    Attributes:
        box: undeformed, around the outermost surface, with the requested number of control points.
        probes: (n, 3) points of all surfaces before deformation, of which the motion is measured.
        regularity: name or object.
        strength: alpha, the weight of the regulariser per data point; None for that of the largest marginal likelihood
            or, where residuals are correlated, a smaller one that predicts left-out patches of the surface better.
        robust: whether outliers are down-weighted.
        report: of the rounds.
        least_sigma: lower bound of sigma, the standard deviation of the residuals.
    """

    box: ControlBox
    probes: Array
    regularity: str | Regulariser
    strength: float | None
    robust: bool
    report: Report
    least_sigma: float = 0.0

    @property
    def unknowns(self) -> float:
        """The number of coordinates of the control points."""
        return float(self.box.rest.size)

    @property
    def weighting(self) -> WeightingRule:
        """The rule for the inlier probabilities in the fine stage; coarse stages keep those of their data."""
        return MixtureWeights() if self.robust else FixedWeights()

    def linear_problem(
        self, datasets: Datasets, attractions: Attractions, box: ControlBox, effective_fraction: float
    ) -> LinearProblem:
        """The linear problem of a round as a function of the strength."""
        found = linear_problem_of(datasets, attractions, box, self.regularity, effective_fraction, self.least_sigma)
        for prior in base_priors(datasets, box):
            found = found.with_extra_terms(prior.equations(box))
        return found

    def recorded(self, before: ControlBox, state: Refined) -> Refined:
        """The state with a record of its round, which is reported."""
        self.report.round()
        entry = record(before, state.box, self.probes, state.sigma)
        return replace(state, history=(*state.history, entry))

    def penalised(self, state: Refined, penalty: Penalty, strength: float) -> Refined | None:
        """The state after one Gauss-Newton step with a further penalty, at fixed strength and inlier probabilities.

        The step is shortened until the sum of data, regulariser and penalties does not increase, down to a
        shortest step (`step_length`). Penalties are this one and the base priors. None where the control points are
        undetermined.
        """
        box, (datasets, no_attractions) = state.box, tangential_steps(state.box, state.datasets)
        linear = self.linear_problem(datasets, no_attractions, box, state.solution.effective_fraction)
        solution = linear.with_extra_terms(penalty.equations(box)).solve(strength)
        if solution is None:
            return None
        whole, penalties = displaced(box, solution), (penalty, *base_priors(datasets, box))

        # the penalty is linear only near the box, so a whole step may make it larger
        def at(length: float) -> ControlBox:
            """The box at a fraction of the step."""
            step = length * (whole.control_points - box.control_points)
            return whole if length == 1 else box.with_control_points(box.control_points + step)

        def total(length: float) -> float:
            """The cost of data, regulariser and penalties at a fraction of the step."""
            trial = at(length)
            # `cost` leaves out the extra terms of the linear problem, so that the base priors count once
            cost = linear.cost(trial.control_points - trial.rest, solution.strength)
            return cost + sum(each.cost(trial) for each in penalties)

        after = at(step_length(total))
        return self.recorded(box, Refined(after, datasets, solution, state.history))


@dataclass(frozen=True)
class Stage:
    """Rounds with one update of the foot points and one weighting rule until a stopping rule is met.

    Attributes:
        problem: what the stages have in common.
        foot_points: the update of the foot points.
        weighting: the rule for the inlier probabilities.
        stop: the stopping rule.
        independent: the rule for how many points count as independent.
    """

    problem: Problem
    foot_points: FootPointUpdate
    weighting: WeightingRule = FIXED
    stop: StoppingRule = ONCE
    independent: IndependentFraction = all_independent

    def step(self, state: InitialState | Refined) -> Refined:
        """The state after one round."""
        problem, box = self.problem, state.box
        datasets, attractions = self.foot_points(box, state.datasets)
        datasets = with_excess(datasets, [box] * len(datasets))
        datasets = self.weighting.weighted(box, datasets, state.sigma)
        fitted = None if state.solution is None else box
        fraction = self.independent(datasets, fitted, problem.unknowns)
        linear = problem.linear_problem(datasets, attractions, box, fraction)
        solution = linear.solve_or_best(problem.strength, state.solution)
        return problem.recorded(box, Refined(displaced(box, solution), datasets, solution, state.history))

    def run(self, start: InitialState | Refined) -> Refined:
        """The state when the stopping rule is met."""
        state = self.step(start)
        for _ in range(self.stop.rounds - 1):
            if self.stop.converged(state):
                break
            state = self.step(state)
        return state
