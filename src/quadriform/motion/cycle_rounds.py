"""The rounds of a cycle: from a smooth fit of one frame to the strengths of the points, and to maps without folds.

All frames start from the smooth fit of one of them. The surface is smooth at first: once a surface follows
correlated errors its residuals look independent, and the estimated strength stays too small (`independent_fraction` of
`fitting/refinement/stage.py`).
"""

from dataclasses import dataclass, replace

import numpy as np

from quadriform.errors import DegenerateError, OptionError
from quadriform.fitting.refinement.point_to_plane import data_rows
from quadriform.fitting.refinement.stage import SCHEDULE
from quadriform.fitting.refinement.unfolding import FOLDS, accepted_sigma
from quadriform.fitting.result import Progress
from quadriform.motion.affine_start import AffineMotion, fitted_motion
from quadriform.motion.cycle import Cycle, CycleFit, CycleState
from quadriform.shapes.control_box import ControlBox


@dataclass(frozen=True)
class CycleRounds:
    """The constants of the rounds."""

    affine: int = 6
    """Rounds in which each frame is an affine image of the smooth fit: most of a heart's motion is affine."""
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
    unfolding: int = 15
    """Most rounds of fold removal at the strengths of the fit: a round takes seconds for a cycle of many frames."""


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
    frames, first = cycle.extremes(undeformed), _affine_images(cycle, undeformed, start, report)
    found = _fitted(cycle, first, frames, alpha, report)
    if found is None and alpha is not None:
        raise OptionError(f"option strength={alpha:g} leaves control points undetermined; expected a larger one")
    if found is None:
        raise DegenerateError("frames leave control points undetermined; expected points all around the body")
    return _unfolded_fit(cycle, first, *found)


def _affine_images(cycle: Cycle, undeformed: CycleState, start: ControlBox, report: _Report) -> CycleState:
    """All frames as affine images of a box, found on an unweighted subsample, with the nearest foot points of all.

    What is a fold is relative to the change of volume of each frame.
    """
    motion, gamma = AffineMotion.identity(cycle.weights_in_time), ROUNDS.strongest * _first_in_time(undeformed)
    sample = [[data.subsample(SCHEDULE.coarse_points, cycle.robust) for data in each] for each in undeformed.datasets]
    for _ in range(ROUNDS.affine):
        rows = [
            [data_rows(data.with_nearest_foot_points(box), box) for data in each]
            for each, box in zip(sample, motion.boxes(start))
        ]
        found = fitted_motion(rows, start, cycle.weights_in_time, cycle.basis, gamma)
        report.round()
        if found is None:
            break
        motion = found
    boxes = motion.boxes(start)
    return replace(
        undeformed,
        displacement=motion.at_knots(start.control_points.reshape(-1, 3)) - cycle.box.rest.reshape(-1, 3),
        boxes=boxes,
        fold_penalties=[penalty.relative_to(box) for penalty, box in zip(undeformed.fold_penalties, boxes)],
    ).nearest()


def _first_in_time(state: CycleState) -> float:
    """The strength in time where the search for it begins.

    A sinusoidal motion of one period, with the RMS radius as its amplitude and time in periods, then has a penalty of
    the noise squared: its second derivative is (2 pi)^2 times the amplitude, and is squared in the penalty.
    """
    return state.sigma**2 / (2 * np.pi) ** 4


def _fitted(
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
            strengths = strengths[0], cycle.linear_problem(state).best_in_time(*strengths)
        before, after = state, cycle.step(state, strengths)
        report.round()
        if after is None:
            return None
        state = after
        if done + 1 >= ROUNDS.least and abs(state.sigma - before.sigma) < ROUNDS.tolerance * before.sigma:
            break
    return state, strengths


def _unfolded_fit(cycle: Cycle, first: CycleState, state: CycleState, strengths: Strengths) -> CycleFit:
    """The fit without folds, or where that is not reached the folded one.

    Fold removal starts from the fit at these strengths, and then from the first state again: its surfaces are smooth.
    """
    most, before = accepted_sigma(state.sigma), state.sigma
    found = _unfolded(cycle, state, strengths, most)
    if found is not None:
        return cycle.result(found, strengths, (True,) * len(found.boxes))
    smooth = replace(first, fraction=state.fraction)
    verified, found, strengths = _by_decreasing_strength(cycle, smooth, strengths, most) or (None, state, strengths)
    return cycle.result(found, strengths, verified or cycle.with_checked_folds(found)[0], before)


def _by_decreasing_strength(
    cycle: Cycle, state: CycleState, strengths: Strengths, most: float
) -> tuple[tuple[bool, ...], CycleState, Strengths] | None:
    """The last state that does not fold at strengths that decrease from ones under which nothing folds to the given.

    With its strengths, and what is verified. Any noise is accepted at stronger ones: a map that folds must not be used,
    and whether a surface is far from its points is reported apart. None where all states fold.
    """
    found = None
    for factor in np.geomspace(FOLDS.strongest, 1, FOLDS.descent):
        stronger = float(factor * strengths[0]), float(factor * strengths[1])
        for _ in range(FOLDS.rounds):
            state = cycle.step(state, stronger) or state
            verified, state = cycle.with_checked_folds(state)
            if all(verified):
                break
        if all(verified):
            found = verified, state, stronger
    at_last = _unfolded(cycle, state, strengths, most)
    return found if at_last is None else ((True,) * len(at_last.boxes), at_last, strengths)


def _unfolded(cycle: Cycle, state: CycleState, strengths: Strengths, most: float) -> CycleState | None:
    """The state after rounds under growing penalties until no frame folds; None at a noise above `most`."""
    found: CycleState | None = state
    for _ in range(ROUNDS.unfolding):
        if found is None or found.sigma > most:
            return None
        verified, found = cycle.with_checked_folds(found)
        if all(verified):
            return found
        found = cycle.step(found, strengths)
    return None
