"""The stages of a refinement: the first, the coarse ones on few points, and the fine one on all."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from quadriform.errors import OptionError
from quadriform.fitting.cloud import nearest
from quadriform.fitting.refinement.left_out import better_strength
from quadriform.fitting.refinement.stage import (
    SCHEDULE,
    FacingPairs,
    IndependentFraction,
    InitialState,
    Problem,
    Refined,
    Stage,
    StoppingRule,
    all_independent,
    independent_fraction,
    nearest_foot_points,
    tangential_steps,
)
from quadriform.fitting.refinement.surface_data import Subsample, SurfaceData
from quadriform.fitting.result import Iteration
from quadriform.points import Array
from quadriform.shapes.control_box import ControlBox


def control_point_counts(box: ControlBox) -> list[tuple[int, int, int]]:
    """Numbers of control points along each axis from stage to stage: 3, 5, 7 ... up to those of the box."""
    l, m, n, _ = box.control_points.shape
    most = max(l, m, n)
    return sorted({(min(l, s), min(m, s), min(n, s)) for s in (*range(3, most, 2), most)})


def first_stage(problem: Problem, sample: Subsample) -> Refined:
    """The stage with the fewest control points, from the undeformed box."""
    box = problem.box
    return _coarse_stage(
        problem, ControlBox.undeformed(box.origin, box.edges, control_point_counts(box)[0]), sample, ()
    )


def coarse_stages(
    problem: Problem, first: Refined, sample: Subsample, independent: IndependentFraction = all_independent
) -> Refined:
    """The state after all further stages on few points with new correspondences in each round.

    A last round has no attraction of model points. A box that has only one stage repeats that stage.

    Args:
        problem: of all rounds.
        first: after the first stage, maybe on other points.
        sample: the points.
        independent: the rule for how many of them count as independent.
    """
    box, history = first.box, first.history
    for l, m, n in control_point_counts(problem.box)[1:] or control_point_counts(problem.box):
        found = _coarse_stage(problem, box.elevate((l - 1, m - 1, n - 1)), sample, history, independent)
        box, history = found.box, found.history
    # from no solution, for its strength would be that of data and attractions
    last = Stage(problem, tangential_steps, independent=independent)
    return last.step(InitialState(box, found.datasets, history=history))


def _coarse_stage(
    problem: Problem,
    box: ControlBox,
    sample: Subsample,
    history: tuple[Iteration, ...],
    independent: IndependentFraction = all_independent,
) -> Refined:
    update, stop = FacingPairs.of(sample).update, StoppingRule(SCHEDULE.coarse_rounds, SCHEDULE.coarse_motion)
    stage = Stage(problem, update, stop=stop, independent=independent)
    return stage.run(InitialState(box, sample.datasets, history=history))


def warm_start(
    problem: Problem, datasets: Sequence[SurfaceData], box: ControlBox, before: Refined | None = None
) -> Refined:
    """The state after one round on few points from a given box, in place of the coarse stages."""
    chosen = tuple(data.subsample(SCHEDULE.coarse_points, problem.robust) for data in datasets)
    solution, history = (None, ()) if before is None else (before.solution, before.history)
    return Stage(problem, nearest_foot_points).step(InitialState(box, chosen, solution, history))


def all_coarse_stages(problem: Problem, first: Refined, datasets: Sequence[SurfaceData]) -> Refined:
    """The result of the coarse stages, repeated for correlated errors and on other points while its surfaces cross.

    A surface that follows correlated errors, as of displaced slices, crosses itself, and the folds of later rounds
    amplify rounding. Where its points count as fewer (`independent_fraction`), the surface is smoother. Where that
    does not help, both are tried on another sample, which may lead to another minimum.
    """
    for count in (SCHEDULE.coarse_points, *SCHEDULE.other_coarse_points):
        sample = Subsample.of(datasets, count, problem.robust)
        start = first if count == SCHEDULE.coarse_points else first_stage(problem, sample)
        for independent in (all_independent, independent_fraction):
            found = coarse_stages(problem, start, sample, independent)
            if not found.crosses_though_covered:
                return _not_worse(problem, found, datasets)
    return _not_worse(problem, found, datasets)


def _not_worse(problem: Problem, found: Refined, datasets: Sequence[SurfaceData]) -> Refined:
    """The result of the coarse stages, or of one round from the undeformed box where that is nearer to the points.

    In a thin body, with sides nearer to each other than neighbouring points, data can be matched to the wrong side.
    """
    box = problem.box
    undeformed = ControlBox.undeformed(box.origin, box.edges, found.box.control_points.shape[:3])
    before = sum(
        (data.with_nearest_foot_points(undeformed).distances(undeformed) ** 2).sum() for data in found.datasets
    )
    after = sum((data.distances(found.box) ** 2).sum() for data in found.datasets)
    return warm_start(problem, datasets, undeformed, found) if before < after else found


def fine_stage(problem: Problem, datasets: Sequence[SurfaceData], coarse: Refined) -> Refined:
    """The state after rounds on more points, with foot points that only move along the surface, the last ones on all.

    Raises:
        OptionError: the strength that the user gave leaves control points undetermined in the last round.
    """
    state: InitialState | Refined = InitialState(coarse.box, coarse.datasets, history=coarse.history)
    rounds = SCHEDULE.fine_rounds
    if max(len(data.points) for data in datasets) > SCHEDULE.fine_points:
        some = [data.subsample(SCHEDULE.fine_points, robust=False) for data in datasets]
        state, rounds = _stage(problem, rounds).run(_on_points(state, some, coarse)), SCHEDULE.last_rounds
    found = _stage(problem, rounds).run(_on_points(state, datasets, coarse))
    if problem.strength is None:
        return with_details(problem, found)
    # the solution has exactly the given strength, or, where that was singular, the best one (`solve_or_best`)
    if found.solution.strength != problem.strength:
        raise OptionError(
            f"option strength={problem.strength:g} leaves control points undetermined; expected a larger one, more "
            f"points or a smaller box (the evidence of the points is largest at {found.solution.strength:.1e})"
        )
    return found


def with_details(problem: Problem, found: Refined) -> Refined:
    """The result or, where residuals are correlated, one at a smaller strength that predicts left-out patches better.

    Residuals are correlated where the errors of the data are, and also where the surface misses details of the body. A
    real detail can be predicted from neighbouring patches of the surface, correlated errors cannot.
    """
    for _ in range(SCHEDULE.strength_searches):
        independent = found.solution.effective_fraction == 1
        strength = None if independent else better_strength(problem, found)
        if strength is None:
            break
        found = _stage(replace(problem, strength=strength), SCHEDULE.last_rounds).run(found)
    return found


def _stage(problem: Problem, rounds: int) -> Stage:
    stop = StoppingRule(rounds, SCHEDULE.fine_motion)
    return Stage(problem, tangential_steps, problem.weighting, stop, independent_fraction)


def _on_points(
    state: InitialState | Refined, datasets: Sequence[SurfaceData], coarse: Refined
) -> InitialState | Refined:
    """The state with other data, whose first foot points are those of the nearest points of the coarse stages."""
    parts = zip(datasets, coarse.datasets)
    return replace(state, datasets=tuple(replace(data, origins=_first_origins(data, part)) for data, part in parts))


def _first_origins(data: SurfaceData, part: SurfaceData) -> Array:
    """First foot points (n, 3) of all data: of the nearest of the few points; the mean where several are as near."""
    near, counts = nearest(part.points, data.points, 1)
    # the mean of tied neighbours lies inside the surface, so it is projected back
    middle = np.einsum("nk,nki->ni", counts, part.origins[near]) / counts.sum(axis=1, keepdims=True)
    return data.superquadric.project(middle)
