"""The rounds of a cycle: from a smooth fit of one frame to the strengths of the points, and to maps without folds.

All frames start from the smooth fit of one of them. It must be smooth: once a surface follows correlated errors its
residuals look independent, and the estimated strength stays too small (`independent_fraction` of
`fitting/refinement/stage.py`).
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from quadriform.errors import DegenerateError, OptionError
from quadriform.fitting.refinement.point_to_plane import data_rows
from quadriform.fitting.refinement.stage import SCHEDULE
from quadriform.fitting.refinement.unfolding import FOLDS, accepted_sigma
from quadriform.fitting.result import Progress
from quadriform.motion.affine_start import AffineMotion, fitted_motion
from quadriform.motion.cycle import Cycle, CycleFit, CycleState
from quadriform.points import Array
from quadriform.shapes.control_box import ControlBox


@dataclass(frozen=True)
class CycleRounds:
    """The constants of the rounds."""

    affine_rounds: int = 6
    """Rounds in which each frame is an affine image of the smooth fit: most of a heart's motion is affine."""
    first_factor: float = 100.0
    """Factor on the strengths in the first round after the affine ones: the affine images are near the points already,
    so maps need not be affine. Also that on the strength in time of the affine motion."""
    falling_rounds: int = 4
    """Rounds in which this factor decreases to 1, lest frames far from their points fold. Outliers are sought at sigma
    times its root: a part of a surface that is still far from its points must not lose them as outliers, for then it
    would stay there."""
    search_rounds: int = 2
    """Rounds after the falling ones in which the strength in time is estimated, before it stays: it changes little, and
    takes a dozen solutions."""
    least_rounds: int = 6
    """Least number of rounds after the falling ones; in all of them the strength in space is estimated again."""
    most_rounds: int = 16
    """Largest number of rounds after the falling ones."""
    tolerance: float = 0.005
    """Between these numbers the rounds end when sigma changes by less than this fraction from one to the next."""
    unfolding_rounds: int = 15
    """Most rounds of fold removal at the strengths of the fit: a round takes seconds for a cycle of many frames."""


ROUNDS = CycleRounds()
Strengths = tuple[float, float]


class Report:
    """Counts rounds for the caller's progress, up to a fixed number."""

    def __init__(self, progress: Progress | None, at_first: int = ROUNDS.affine_rounds) -> None:
        self.progress, self.done = progress, 0
        self.total = at_first + ROUNDS.falling_rounds + ROUNDS.least_rounds

    def round(self) -> None:
        """One more round is done; those beyond the number that was announced are not counted."""
        self.done = min(self.done + 1, self.total)
        if self.progress is not None:
            self.progress(self.done, self.total)


class Approach(Protocol):
    """How the rounds of a cycle begin, and how folds are removed after them."""

    def rounds(self, cycle: Cycle) -> int:
        """The number of rounds that `first` reports."""

    def first(self, cycle: Cycle, undeformed: CycleState, report: Report) -> CycleState:
        """The state in which the rounds begin."""

    def unfolded(self, cycle: Cycle, first: CycleState, state: CycleState, strengths: Strengths) -> CycleFit:
        """The fit without folds, or where that is not reached one with folds.

        Args:
            cycle: what is fitted.
            first: the state in which the rounds began.
            state: in which they ended.
            strengths: at the end.
        """


def fit_cycle(cycle: Cycle, approach: Approach, alpha: float | None, progress: Progress | None = None) -> CycleFit:
    """The fit; with folds where they could not be removed.

    Args:
        cycle: what is fitted.
        approach: how it begins and ends.
        alpha: the strength in space; None for the smaller one of the best strengths of two frames
            (`Cycle.strength_in_space`), those of `Cycle.extremes`.
        progress: called after each round.

    Raises:
        OptionError: the strength that the user gave leaves control points undetermined.
        DegenerateError: the estimated strengths leave control points undetermined, or in one of the two frames all do.
    """
    report = Report(progress, approach.rounds(cycle))
    undeformed = cycle.init()
    extreme_frames, first = cycle.extremes(undeformed), approach.first(cycle, undeformed, report)
    found = _fitted(cycle, first, extreme_frames, alpha, report)
    if found is None and alpha is not None:
        raise OptionError(f"option strength={alpha:g} leaves control points undetermined; expected a larger one")
    if found is None:
        raise DegenerateError("frames leave control points undetermined; expected points all around the body")
    return approach.unfolded(cycle, first, *found)


@dataclass(frozen=True)
class FromOneFrame:
    """All frames begin as affine images of a smooth box of one of them; folds are removed by penalties.

    Attributes:
        box: of the one frame.
    """

    box: ControlBox

    def rounds(self, cycle: Cycle) -> int:
        """The number of rounds of affine maps."""
        return ROUNDS.affine_rounds

    def first(self, cycle: Cycle, undeformed: CycleState, report: Report) -> CycleState:
        """The affine images."""
        return _affine_images(cycle, undeformed, self.box, report)

    def unfolded(self, cycle: Cycle, first: CycleState, state: CycleState, strengths: Strengths) -> CycleFit:
        """The fit without folds, or where that is not reached the one with folds."""
        return _unfolded_fit(cycle, first, state, strengths)


def _affine_images(cycle: Cycle, undeformed: CycleState, start: ControlBox, report: Report) -> CycleState:
    """The state in which all frames are affine images of a box, with the nearest foot points of all points.

    The affine maps are fitted to a subsample, all of whose points are inliers. What is a fold is relative to the change
    of volume of each frame.
    """
    motion = AffineMotion.identity(cycle.splines_at_frames)
    gamma = ROUNDS.first_factor * _initial_strength_in_time(undeformed)
    sample = [[data.subsample(SCHEDULE.coarse_points, cycle.robust) for data in each] for each in undeformed.datasets]
    for _ in range(ROUNDS.affine_rounds):
        rows = [
            [data_rows(data.with_nearest_foot_points(box), box) for data in each]
            for each, box in zip(sample, motion.boxes(start))
        ]
        found = fitted_motion(rows, start, cycle.splines_at_frames, cycle.basis, gamma)
        report.round()
        if found is None:
            break
        motion = found
    return first_state(cycle, undeformed, motion.at_knots(start.control_points.reshape(-1, 3)), motion.boxes(start))


def first_state(cycle: Cycle, undeformed: CycleState, control_points: Array, boxes: Sequence[ControlBox]) -> CycleState:
    """The state of control points (K, k, 3) at the knots and boxes at the frames, with the nearest foot points."""
    return replace(
        undeformed,
        displacement=control_points - cycle.box.rest.reshape(-1, 3),
        boxes=list(boxes),
        fold_penalties=[penalty.relative_to(box) for penalty, box in zip(undeformed.fold_penalties, boxes)],
    ).nearest()


def _initial_strength_in_time(state: CycleState) -> float:
    """The strength in time where the search for it begins: sigma^2 / (2 pi)^4.

    At this strength a sine of m periods whose root mean square over time is one RMS radius has the penalty m^4 sigma^2
    per data point: its second derivative, with time in periods, is (2 pi m)^2 times the sine, and is squared in the
    penalty. With a period that of m = 1 is not penalised (`TimeBasis.bending`).
    """
    return state.sigma**2 / (2 * np.pi) ** 4


def _fitted(
    cycle: Cycle, state: CycleState, extreme_frames: tuple[int, int], alpha: float | None, report: Report
) -> tuple[CycleState, Strengths] | None:
    """The state when sigma has converged, or after `most_rounds`, and the strengths.

    None where a round after the falling ones leaves control points undetermined; a falling one that does is left out.
    """
    alpha_at_first = alpha or cycle.strength_in_space(state, extreme_frames, None, before_rounds=True)
    strengths = alpha_at_first, _initial_strength_in_time(state)
    state = replace(state, fraction=cycle.effective_fraction(state, before_rounds=True))
    state = state.with_estimated_prior()
    for factor in np.geomspace(cycle.in_space.first_factor, 1, ROUNDS.falling_rounds):
        stronger = factor * strengths[0], factor * strengths[1]
        state = cycle.step(state, stronger, widening=float(np.sqrt(factor))) or state
        state = state.with_estimated_prior()
        report.round()
    after: CycleState | None = state
    for done in range(ROUNDS.most_rounds):
        if done < ROUNDS.least_rounds:
            strengths = alpha or cycle.strength_in_space(state, extreme_frames, strengths[0]), strengths[1]
        if done < ROUNDS.search_rounds:
            state = replace(state, fraction=cycle.effective_fraction(state))
            strengths = strengths[0], cycle.linear_problem(state).best_in_time(*strengths)
        before, after = state, cycle.step(state, strengths)
        report.round()
        if after is None:
            return None
        # later the prior stays, as strengths do: penalties on folds increase the noise, and its weight would grow too
        state = after.with_estimated_prior()
        if done + 1 >= ROUNDS.least_rounds and abs(state.sigma - before.sigma) < ROUNDS.tolerance * before.sigma:
            break
    return state, strengths


def _unfolded_fit(cycle: Cycle, first: CycleState, state: CycleState, strengths: Strengths) -> CycleFit:
    """The fit without folds, or where that is not reached the one with folds.

    Fold removal starts from the state of the fit, at its strengths and within the accepted noise. Where that fails it
    starts from the first state, whose surfaces are smooth, at larger strengths.
    """
    most, before = accepted_sigma(state.sigma), state.sigma
    found = _unfolded(cycle, state, strengths, most)
    if found is not None:
        return cycle.result(found, strengths, (True,) * len(found.boxes))
    smooth = replace(first, fraction=state.fraction, slices=first.slices.with_prior_of(state.slices))
    unfolded = _by_decreasing_strength(cycle, smooth, strengths, most)
    if unfolded is None:
        return cycle.result(state, strengths, cycle.with_checked_folds(state)[0], before)
    found, strengths = unfolded
    return cycle.result(found, strengths, (True,) * len(found.boxes), before)


def _by_decreasing_strength(
    cycle: Cycle, state: CycleState, strengths: Strengths, most: float
) -> tuple[CycleState, Strengths] | None:
    """A state without folds, and its strengths; None where all states fold.

    The strengths decrease from multiples under which maps are nearly affine to the given ones, with a few rounds of
    fold removal at each. At the end come more rounds at the given strengths. Their result is returned if it is free of
    folds and its noise at most `most`; else that of the smallest strengths at which a state is free of folds, at any
    noise: a map that folds must not be used, and whether a surface is far from its points is reported separately.
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
            found = state, stronger
    at_last = _unfolded(cycle, state, strengths, most)
    return found if at_last is None else (at_last, strengths)


def _unfolded(cycle: Cycle, state: CycleState, strengths: Strengths, most: float) -> CycleState | None:
    """The state after rounds under growing penalties until no frame folds, with a noise of at most `most`.

    None where the noise is larger, a round leaves control points undetermined, or frames still fold after
    `unfolding_rounds`.
    """
    found: CycleState | None = state
    for _ in range(ROUNDS.unfolding_rounds):
        if found is None or found.sigma > most:
            return None
        verified, found = cycle.with_checked_folds(found)
        if all(verified):
            return found
        found = cycle.step(found, strengths)
    return None
