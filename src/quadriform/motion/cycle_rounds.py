"""The rounds of a cycle: from a single fit of one frame to the strengths of the points, and to maps without folds.

All frames start from the single fit of one of them. The surface is smooth at first, for an estimated strength has two
fixed points: once a surface follows correlated errors, its residuals look independent.
"""

from dataclasses import dataclass, replace

import numpy as np

from quadriform.errors import DegenerateError, OptionError
from quadriform.fitting.refinement.multiresolution import SCHEDULE
from quadriform.fitting.refinement.unfolding import FOLDS
from quadriform.fitting.result import Progress
from quadriform.motion.cycle import Cycle, CycleFit, CycleState
from quadriform.shapes.control_box import ControlBox


@dataclass(frozen=True)
class CycleRounds:
    """The constants of the rounds."""

    affine: int = 6
    """Rounds in which each frame is an affine image of the first: most of a heart's motion is affine."""
    strongest: float = 100.0
    """Factor on the strengths in the next round: the affine images are near already, so maps need not be affine."""
    falling: int = 4
    """Rounds in which this factor decreases to 1, lest frames far from their points fold."""
    searches: int = 2
    """Rounds after these in which the strength in time is estimated; it changes little, and takes a dozen solutions."""
    least: int = 6
    """The least number of rounds after these; in all of them the strength in space is estimated again."""
    most: int = 16
    """The largest number."""
    tolerance: float = 0.005
    """They end when the noise changes by less than this fraction from one round to the next."""
    times_stronger: float = 10.0
    """Where folds are not removed at strengths, this many times larger ones are tried."""
    retries: int = 2
    """Number of times: up to a hundred times the strengths, where maps are nearly affine."""
    unfolding: int = 15
    """Most rounds of fold removal at each of these: a round takes seconds for a cycle of many frames."""


ROUNDS = CycleRounds()
Strengths = tuple[float, float]


class _Report:
    """Counts rounds for the caller's progress, up to a fixed number."""

    def __init__(self, progress: Progress | None) -> None:
        self.progress, self.done = progress, 0

    total = ROUNDS.affine + ROUNDS.falling + ROUNDS.least

    def round(self) -> None:
        """One more round is done; those beyond the number that was announced are not counted."""
        self.done = min(self.done + 1, self.total)
        if self.progress is not None:
            self.progress(self.done, self.total)


def fit_cycle(cycle: Cycle, start: ControlBox, alpha: float | None, progress: Progress | None = None) -> CycleFit:
    """The fit from a box that fits one of the frames.

    Args:
        cycle: what is fitted.
        start: the box.
        alpha: the strength in space; None for the one that maximises the marginal likelihood.
        progress: called after each round.

    Raises:
        OptionError: the strength that the user gave leaves control points undetermined.
        DegenerateError: no strength that was tried gave a solvable problem.
    """
    report = _Report(progress)
    undeformed = cycle.init()
    frames, first = cycle.extremes(undeformed), _near(cycle, undeformed, start, report)
    found = _converged(cycle, first, frames, alpha, report)
    if found is None and alpha is not None:
        raise OptionError(f"option strength={alpha:g} leaves control points undetermined; expected a larger one")
    if found is None:
        raise DegenerateError("frames leave control points undetermined; expected points all around the body")
    return _without_folds(cycle, *found)


def _near(cycle: Cycle, undeformed: CycleState, start: ControlBox, report: _Report) -> CycleState:
    """All frames as affine images of a box, found on an unweighted subsample, with the nearest foot points of all."""
    state = cycle.all_at(undeformed, start)
    sample = [[data.subsample(SCHEDULE.coarse_points[0], cycle.robust) for data in each] for each in state.datasets]
    near, plain = replace(state, datasets=sample, shifts=state.shifts[:0]), replace(cycle, planes=None, robust=False)
    gamma = ROUNDS.strongest * _first_in_time(state)
    for _ in range(ROUNDS.affine):
        near = plain.step(near.nearest(), (FOLDS.affine, gamma)) or near
        report.round()
    return replace(near, datasets=state.datasets, shifts=state.shifts, reference=cycle.box).nearest()


def _first_in_time(state: CycleState) -> float:
    """The strength in time where the search for it begins.

    A sinusoidal motion of one period, with the RMS radius as its amplitude and time in periods, then has a penalty of
    the noise squared: its second derivative is (2 pi)^2 times the amplitude, and is squared in the penalty.
    """
    return state.noise**2 / (2 * np.pi) ** 4


def _converged(
    cycle: Cycle, state: CycleState, frames: tuple[int, int], alpha: float | None, report: _Report
) -> tuple[CycleState, Strengths] | None:
    """The state when the noise has converged, and the strengths; None where control points stay undetermined."""
    strengths = alpha or cycle.strength_in_space(state, frames, None, first=True), _first_in_time(state)
    state = replace(state, fraction=cycle.effective_fraction(state, first=True))
    for factor in np.geomspace(ROUNDS.strongest, 1, ROUNDS.falling):
        state = cycle.step(state, (factor * strengths[0], factor * strengths[1])) or state
        report.round()
    after: CycleState | None = state
    for done in range(ROUNDS.most):
        if done < ROUNDS.least:
            strengths = alpha or cycle.strength_in_space(state, frames, strengths[0]), strengths[1]
        if done < ROUNDS.searches:
            state = replace(state, fraction=cycle.effective_fraction(state))
            strengths = strengths[0], cycle.evidence(state).best_in_time(*strengths)
        before, after = state, cycle.step(state, strengths)
        report.round()
        if after is None:
            return None
        state = after
        if done + 1 >= ROUNDS.least and abs(state.noise - before.noise) < ROUNDS.tolerance * before.noise:
            break
    return state, strengths


def _without_folds(cycle: Cycle, state: CycleState, strengths: Strengths) -> CycleFit:
    """The fit at these strengths, or at the least larger ones that let all frames be verified to be free of folds.

    Where there are none it is the folded one.
    """
    most = max(FOLDS.accepted * state.noise, FOLDS.negligible)
    for retry in range(ROUNDS.retries + 1):
        factor = ROUNDS.times_stronger**retry
        stronger = factor * strengths[0], factor * strengths[1]
        found = _unfolded(cycle, state, stronger, most)
        if found is not None:
            return cycle.result(found, stronger, (True,) * len(found.boxes))
    return cycle.result(state, strengths, cycle.checked(state)[0])


def _unfolded(cycle: Cycle, state: CycleState, strengths: Strengths, most: float) -> CycleState | None:
    """The state after rounds under growing penalties until no frame folds; None at a noise above `most`."""
    found: CycleState | None = state
    for _ in range(ROUNDS.unfolding):
        if found is None or found.noise > most:
            return None
        verified, found = cycle.checked(found)
        if all(verified):
            return found
        found = cycle.step(found, strengths)
    return None
