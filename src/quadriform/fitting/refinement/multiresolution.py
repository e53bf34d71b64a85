"""The rounds of the refinement: few control points and few data points first, all of them at the end.

One round updates the foot points (a correspondence), the inlier probabilities (a robust kernel) and the control points
(the linear problem at a selected strength). A stage makes rounds until its stopping rule is met.
"""

from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from quadriform.fitting.least_squares.marginal_likelihood import Solution
from quadriform.fitting.least_squares.normal_equations import NormalEquations
from quadriform.fitting.least_squares.regularisers import Regulariser
from quadriform.fitting.refinement.correspondence import Correspondence
from quadriform.fitting.refinement.point_to_plane import Attraction, evidence_of, moved, record, step_length
from quadriform.fitting.refinement.surface_data import Subsample, SurfaceData
from quadriform.fitting.result import Iteration, Progress
from quadriform.points import Array
from quadriform.shapes.control_box import ControlBox
from quadriform.shapes.model import DeformableModel

Datasets = tuple[SurfaceData, ...]
Attractions = tuple[Attraction | None, ...]


@dataclass(frozen=True)
class Schedule:
    """The constants of the stages; lengths of the data in RMS radii."""

    first_points: int = 400
    """Of a surface in the first stage: enough to compare starts."""
    coarse_points: tuple[int, ...] = (1000, 700, 1500)
    """In the coarse stages; another number gives another path, for a surface that is self-intersecting after it."""
    medium_points: int = 3000
    """More than these are used in the last rounds only: the surface has nearly converged by then."""
    coarse_rounds: int = 8
    fine_rounds: int = 10
    last_rounds: int = 3
    """At most so many in a coarse stage, in the fine stage, and on all points; most stages stop earlier."""
    coarse_motion: float = 0.2
    fine_motion: float = 0.02
    """A stage ends when the surface moves less than this fraction of the noise: less does not change inliers."""
    tangential_steps: int = 3
    """Of a foot point in a round, which converges quadratically: more would not move it."""


SCHEDULE = Schedule()
FIRST_NOISE = 1.4826
"""Times the median absolute distance: the standard deviation of a Gaussian, even if half of the points are outliers."""


@dataclass(frozen=True)
class Start:
    """What a stage begins from.

    Attributes:
        box: deformed.
        datasets: one a surface.
        solution: of an earlier, similar problem, or None.
        noise: of the data, or None where it is not known.
        history: one record for each round so far.
    """

    box: ControlBox
    datasets: Datasets
    solution: Solution | None = None
    noise: float | None = None
    history: tuple[Iteration, ...] = ()


@dataclass(frozen=True)
class Refined:
    """A box refined by at least one round, in the centred, scaled frame.

    Attributes:
        box: deformed.
        datasets: one a surface, with foot points and inlier probabilities.
        solution: of the last round.
        history: one record for each round.
    """

    box: ControlBox
    datasets: Datasets
    solution: Solution
    history: tuple[Iteration, ...]

    @property
    def noise(self) -> float:
        """Standard deviation of the data along the normal."""
        return self.solution.noise

    @property
    def covered(self) -> bool:
        """Whether the data samples all of every surface."""
        return all(data.is_covered() for data in self.datasets)

    @property
    def self_intersecting(self) -> bool:
        """Whether surfaces cross although the data covers them: more strength would not undo that."""
        if not self.covered:
            return False
        surfaces = {str(number): data.superquadric for number, data in enumerate(self.datasets)}
        return bool(DeformableModel(surfaces, self.box).crossings())

    def nearest(self) -> "Refined":
        """With the nearest foot points."""
        return replace(self, datasets=tuple(data.with_nearest_foot_points(self.box) for data in self.datasets))


class Penalty(Protocol):
    """A cost of the box besides the data's and the regulariser's."""

    def equations(self, box: ControlBox) -> NormalEquations:
        """Its normal equations, linear about a box, in the displacement from the undeformed box."""

    def cost(self, box: ControlBox) -> float:
        """The cost itself."""


class FootPoints(Protocol):
    """A correspondence of data points and the surface."""

    def update(self, box: ControlBox, datasets: Datasets) -> tuple[Datasets, Attractions]:
        """Data with new foot points, and model points that are attracted to the data besides."""


class TangentialSteps:
    """Foot points that move along the surface."""

    def update(self, box: ControlBox, datasets: Datasets) -> tuple[Datasets, Attractions]:
        """Data with foot points after a few tangential Gauss-Newton steps."""
        steps = SCHEDULE.tangential_steps
        return tuple(data.with_tangential_steps(box, steps) for data in datasets), (None,) * len(datasets)


class Nearest:
    """Foot points that are sought on the whole surface."""

    def update(self, box: ControlBox, datasets: Datasets) -> tuple[Datasets, Attractions]:
        """Data with the nearest foot points."""
        return tuple(data.with_nearest_foot_points(box) for data in datasets), (None,) * len(datasets)


@dataclass(frozen=True)
class Facing:
    """Foot points near the data that face the same way, and an attraction of the surface where the data covers it."""

    pairs: tuple[Correspondence, ...]
    covered: tuple[bool, ...]

    @classmethod
    def of(cls, sample: Subsample) -> "Facing":
        """For the points of a subsample."""
        both = zip(sample.datasets, sample.clouds)
        return cls(tuple(Correspondence.between(data.superquadric, cloud) for data, cloud in both), sample.covered)

    def update(self, box: ControlBox, datasets: Datasets) -> tuple[Datasets, Attractions]:
        """Data with foot points sought anew, then moved tangentially; and the attraction of other model points."""
        result, attractions = list[SurfaceData](), list[Attraction | None]()
        for pairs, covered, data in zip(self.pairs, self.covered, datasets):
            costs = pairs.costs(box)
            result.append(
                replace(data, origins=pairs.facing(costs)).with_tangential_steps(box, SCHEDULE.tangential_steps)
            )
            attractions.append(pairs.attraction(costs, box, result[-1]) if covered else None)
        return tuple(result), tuple(attractions)


class Kernel(Protocol):
    """A rule for the inlier probabilities."""

    def weighted(self, box: ControlBox, datasets: Datasets, noise: float | None) -> Datasets:
        """Data with new inlier probabilities."""


class FixedWeights:
    """Inlier probabilities as they are: at first one."""

    def weighted(self, box: ControlBox, datasets: Datasets, noise: float | None) -> Datasets:
        """The same data."""
        return datasets


class MixtureWeights:
    """Inlier probabilities by a mixture of Gaussian inliers and uniform outliers."""

    def weighted(self, box: ControlBox, datasets: Datasets, noise: float | None) -> Datasets:
        """Data with probabilities at a noise; without one at that of the median distance."""
        distances = [data.distances(box) for data in datasets]
        sigma = FIRST_NOISE * float(np.median(np.concatenate(distances))) if noise is None else noise
        return tuple(data.weighted(each, sigma) for data, each in zip(datasets, distances))


@dataclass(frozen=True)
class StoppingRule:
    """At most so many rounds, fewer when the surface moves less than a fraction of the noise."""

    rounds: int
    motion: float = 0.0


class Report:
    """Counts rounds for the caller's progress."""

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
        strength: alpha per data point; None for the evidence's.
        robust: whether outliers are down-weighted.
        report: of the rounds.
    """

    box: ControlBox
    probes: Array
    regularity: str | Regulariser
    strength: float | None
    robust: bool
    report: Report

    @property
    def kernel(self) -> Kernel:
        """Of the fine stage."""
        return MixtureWeights() if self.robust else FixedWeights()

    def weighted(self, state: Refined) -> Refined:
        """The state with the inliers of its own distances."""
        return replace(state, datasets=self.kernel.weighted(state.box, state.datasets, None))

    def recorded(self, before: ControlBox, state: Refined) -> Refined:
        """The state with a record of its round, which is reported."""
        self.report.round()
        entry = record(before, state.box, self.probes, state.noise)
        return replace(state, history=(*state.history, entry))

    def penalised(self, state: Refined, penalty: Penalty, strength: float) -> Refined | None:
        """The state after a round at a given strength with a penalty that is not linear: as far as it lowers the sum.

        None where penalty and strength leave control points undetermined.
        """
        box, (datasets, none) = state.box, TangentialSteps().update(state.box, state.datasets)
        evidence = evidence_of(datasets, none, box, self.regularity, state.solution.effective_fraction)
        solution = evidence.plus(penalty.equations(box)).solve(strength)
        if solution is None:
            return None
        whole = moved(box, solution)

        def at(length: float) -> ControlBox:
            step = length * (whole.control_points - box.control_points)
            return whole if length == 1 else box.with_control_points(box.control_points + step)

        def total(length: float) -> float:
            trial = at(length)
            return evidence.cost(trial.control_points - trial.rest, solution.strength) + penalty.cost(trial)

        after = at(step_length(total))
        return self.recorded(box, Refined(after, datasets, solution, state.history))


@dataclass(frozen=True)
class Stage:
    """A solver: rounds with one correspondence and one kernel until a stopping rule is met."""

    problem: Problem
    foot_points: FootPoints
    kernel: Kernel
    stop: StoppingRule
    effective_fraction: float = 1.0

    def step(self, state: Start | Refined) -> Refined:
        """The state after one round."""
        datasets, attractions = self.foot_points.update(state.box, state.datasets)
        datasets = self.kernel.weighted(state.box, datasets, state.noise)
        evidence = evidence_of(datasets, attractions, state.box, self.problem.regularity, self.effective_fraction)
        solution = evidence.select(self.problem.strength, state.solution)
        after = Refined(moved(state.box, solution), datasets, solution, state.history)
        return self.problem.recorded(state.box, after)

    def converged(self, state: Refined) -> bool:
        """Whether the surface moved less than the stopping rule's fraction of the noise."""
        return state.history[-1].surface_motion < self.stop.motion * state.noise

    def run(self, start: Start) -> Refined:
        """The state when the stopping rule is met."""
        state = self.step(start)
        for _ in range(self.stop.rounds - 1):
            if self.converged(state):
                break
            state = self.step(state)
        return state
