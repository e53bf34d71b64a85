"""The refinement by tangent distance as a whole: starts, rounds, the size of the box, and the check for folds."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from quadriform.errors import Warnings
from quadriform.fitting.cloud import best_first
from quadriform.fitting.diagnostics import POOR, folding, ill_conditioned, max_error_missed
from quadriform.fitting.least_squares.marginal_likelihood import Solution
from quadriform.fitting.least_squares.regularisers import Regulariser
from quadriform.fitting.least_squares.uncertainty import EnrichedBox
from quadriform.fitting.options import TangentOptions, check_box, check_strength
from quadriform.fitting.refinement.multiresolution import FIRST_POINTS, Refined, Rounds, coarse_unfolded
from quadriform.fitting.refinement.point_to_plane import evidence_of
from quadriform.fitting.refinement.starts import candidates
from quadriform.fitting.refinement.surface_data import Few, Sheet
from quadriform.fitting.refinement.unfolding import cures, fair_price, least_regularised
from quadriform.fitting.result import HalfSpace, Progress, Result
from quadriform.points import Array
from quadriform.shapes.control_box import ControlBox, common_box
from quadriform.shapes.model import DeformableModel
from quadriform.shapes.superquadric import Superquadric

AUTO_SIDES = (3, 5, 7)
MORE = 2
"""Control points a side that the finer box of the uncertainty has besides: the next step of the ladder 3, 5, 7."""
PROBES = 8
"""Resolution of the points by which a round's motion of the surfaces is told."""


@dataclass(frozen=True)
class _Task:
    """What stays the same over starts and sizes."""

    clouds: Mapping[str, Array]
    weights: Mapping[str, Array]
    options: TangentOptions
    half_space: HalfSpace | None
    progress: Progress | None
    start: ControlBox | None
    normals: Mapping[str, Array]

    @cached_property
    def _sheets(self) -> list[Sheet]:
        """One sheet a surface, without the points of weight zero; around spheres, until there are starts."""
        result = []
        for name, cloud in self.clouds.items():
            there = self.weights[name] > 0
            facing = self.normals[name][there] if name in self.normals else None
            result.append(Sheet(Superquadric(), cloud[there], self.weights[name][there], self.half_space, facing))
        return result

    @cached_property
    def _first(self) -> Few:
        return Few.of(self._sheets, FIRST_POINTS, self.options.robust)

    def first(self, surfaces: Mapping[str, Superquadric]) -> Few:
        """The points of the first stage."""
        return self._first.around([surfaces[name] for name in self.clouds])

    def sheets(self, surfaces: Mapping[str, Superquadric]) -> list[Sheet]:
        """All points that count."""
        return [sheet.with_superquadric(surfaces[name]) for name, sheet in zip(self.clouds, self._sheets)]

    def rounds(self, surfaces: Mapping[str, Superquadric], shape: tuple[int, int, int]) -> Rounds:
        """Fresh rounds in the box around the surfaces."""
        strength = check_strength(self.options.strength)
        box = common_box(surfaces, shape)
        probes = np.concatenate([surfaces[name].grid(PROBES)[0] for name in self.clouds])
        return Rounds(box, probes, self.options.regularity, strength, self.options.robust, self.progress)


def fit_tangent(
    surfaces: dict[str, Superquadric],
    clouds: dict[str, Array],
    weights: dict[str, Array],
    options: TangentOptions,
    half_space: HalfSpace | None,
    max_error: float | None,
    kind: str | None,
    progress: Progress | None,
    start: ControlBox | None = None,
    normals: Mapping[str, Array] | None = None,
) -> Result:
    """Refine all surfaces at once; everything in the centred, scaled frame.

    Args:
        surfaces: name -> start.
        clouds: name -> (n, 3) points.
        weights: name -> (n,).
        options: the choices.
        half_space: where no data is expected.
        max_error: RMS distance that box="auto" must reach.
        kind: other starts of this kind may take the place of the given ones; None keeps them.
        progress: called after each round.
        start: a deformed box to go on from; its number of control points goes before that of the options.
        normals: name -> (n, 3) unit or zero, of the clouds that were given some.
    """
    task = _Task(clouds, weights, options, half_space, progress, start, normals or {})
    starts = [surfaces] if kind is None else candidates(clouds, surfaces, kind)
    if start is not None:
        return _best_start(task, starts, check_box(start.control_points.shape[:3]))
    if max_error is None:
        return _best_start(task, starts, check_box(options.box))
    for side in AUTO_SIDES:
        result = _best_start(task, starts, (side, side, side))
        error = _error(result, clouds)
        if error <= max_error:
            return result
    missed = max_error_missed(AUTO_SIDES[-1], error / max_error, (result.noise or 0) / max_error)
    return replace(result, warnings=result.warnings | missed)


def _error(result: Result, clouds: dict[str, Array]) -> float:
    """RMS distance of the inliers to the model."""
    squares, total = 0.0, 0.0
    for name, cloud in clouds.items():
        weight = np.ones(len(cloud)) if result.inliers is None else result.inliers[name]
        squares += float(weight @ result.model.distance(cloud, name) ** 2)
        total += float(weight.sum())
    return float(np.sqrt(squares / total))


def _best_start(task: _Task, starts: Sequence[dict[str, Superquadric]], shape: tuple[int, int, int]) -> Result:
    """The best certified refinement; a fold is kept, and reported, only by a fit that is not poor.

    Where no start gives a certified one, all are tried once more without weights: robust ones can take whole faces of a
    body with sharp edges for outliers, and nothing then stops the surface from folding there.
    """
    first, found = _certified(task, starts, shape)
    trial, folded = first
    if found is None and folded.solution.noise > POOR:
        regularised = least_regularised(trial.rounds, folded, trial.surfaces)
        found = None if regularised is None else (trial, regularised)
    elif found is None and task.options.robust:
        even = replace(task, options=replace(task.options, robust=False))
        found = _certified(even, starts, shape, fair_price(folded))[1]
    if found is None:
        return _result(task, *first, folding(DeformableModel(trial.surfaces, folded.box)))
    return _result(task, *found, {})


def _certified(
    task: _Task, starts: Sequence[dict[str, Superquadric]], shape: tuple[int, int, int], price: float | None = None
) -> tuple["Tried", "Tried | None"]:
    """The first start refined, and the best start that unfolds at a fair price, or else the one of least noise.

    The best has the largest evidence after its first stage; one that comes out tangled is the last resort. Several
    surfaces in one box are only worth having when the space between them does not fold: there any price is fair, if
    there is none better.

    Args:
        price: the fair price; None for that of the first start.
    """
    tried, dear = list["Tried"](), list["Tried"]()
    for trial in _tangled_last(_ordered(task, starts, shape)):
        refined = trial.rounds.fine(trial.sheets, trial.coarse)
        tried.append((trial, refined))
        fair = fair_price(tried[0][1]) if price is None else price
        for cured in cures(trial.rounds, refined, trial.surfaces, np.inf if len(trial.surfaces) > 1 else fair):
            if cured.solution.noise <= fair:
                return tried[0], (trial, cured)
            dear.append((trial, cured))
    return tried[0], min(dear, key=lambda found: found[1].solution.noise, default=None)


def _ordered(task: _Task, starts: Sequence[dict[str, Superquadric]], shape: tuple[int, int, int]) -> "list[_Trial]":
    """Trials of the starts, the one of largest evidence after its first stage first."""
    trials = [_Trial.of(task, surfaces, shape) for surfaces in starts]
    if len(trials) == 1:
        return trials
    return [trials[index] for index in best_first(np.array([-trial.begun[1].criterion for trial in trials]))]


@dataclass(frozen=True)
class _Trial:
    """A start, and its coarse stages when they are asked for."""

    task: _Task
    surfaces: dict[str, Superquadric]
    rounds: Rounds
    sheets: list[Sheet]

    @classmethod
    def of(cls, task: _Task, start: dict[str, Superquadric], shape: tuple[int, int, int]) -> "_Trial":
        sheets = task.sheets(start)
        surfaces = dict(zip(task.clouds, (sheet.superquadric for sheet in sheets)))
        return cls(task, surfaces, task.rounds(start, shape), sheets)

    @cached_property
    def begun(self) -> tuple[ControlBox, Solution]:
        return self.rounds.begun(self.task.first(self.surfaces))

    @cached_property
    def coarse(self) -> Refined:
        if self.task.start is not None:
            return self.rounds.resumed(self.sheets, self.task.start)
        return coarse_unfolded(self.rounds, self.begun[0], self.sheets)


Tried = tuple[_Trial, Refined]
"""A start and what it was refined to."""


def _tangled_last(trials: Sequence[_Trial]) -> Iterator[_Trial]:
    """In their order, but those whose coarse stages come out tangled at the end."""
    tangled = []
    for trial in trials:
        if trial.coarse.tangled:
            tangled.append(trial)
        else:
            yield trial
    yield from tangled


def _result(task: _Task, trial: _Trial, refined: Refined, warnings: Warnings) -> Result:
    model = DeformableModel(trial.surfaces, refined.box)
    return Result(
        model=model,
        history=refined.history,
        strength=refined.solution.strength,
        noise=refined.solution.noise,
        covariance=refined.solution.covariance(),
        enriched=_enriched(refined, task.options.regularity),
        inliers=_all_inliers(task, refined),
        warnings=warnings | ill_conditioned(model, refined.solution),
        half_space=task.half_space,
        covered=trial.coarse.covered and task.half_space is None,
        ends=tuple(name for name, sheet in zip(task.clouds, trial.coarse.sheets) if sheet.ends()),
    )


def _all_inliers(task: _Task, refined: Refined) -> dict[str, Array]:
    """Probabilities of all points, zero for those of weight zero."""
    result = {}
    for (name, weights), sheet in zip(task.weights.items(), refined.sheets):
        result[name] = np.zeros(len(weights))
        result[name][weights > 0] = sheet.inliers
    return result


def _enriched(refined: Refined, regularity: str | Regulariser) -> EnrichedBox:
    """The same foot points in a finer box, held at its own strength of largest evidence."""
    l, m, n = refined.box.degrees
    enriched = refined.box.elevate((l + MORE, m + MORE, n + MORE))
    evidence = evidence_of(
        refined.sheets, [None] * len(refined.sheets), enriched, regularity, refined.solution.effective_fraction
    )
    return EnrichedBox(enriched, evidence, refined.solution.strength)
