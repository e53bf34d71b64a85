"""The rounds of the refinement: few control points and few data points first, all of them at the end."""

from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from quadriform.errors import OptionError
from quadriform.fitting.least_squares.marginal_likelihood import Solution
from quadriform.fitting.least_squares.normal_equations import NormalEquations
from quadriform.fitting.least_squares.regularisers import Regulariser
from quadriform.fitting.neighbourhood import nearest
from quadriform.fitting.refinement.correspondence import Correspondence
from quadriform.fitting.refinement.point_to_plane import Pull, evidence_of, independent_of, moved, record, step_length
from quadriform.fitting.refinement.surface_data import Few, Sheet
from quadriform.fitting.result import Iteration, Progress
from quadriform.points import Array
from quadriform.shapes.closest import closest_on, update_foot_points
from quadriform.shapes.control_box import ControlBox
from quadriform.shapes.model import DeformableModel

FIRST_POINTS = 400
"""Enough for the first stage, which tells starts from each other."""
COARSE_POINTS = (1000, 700, 1500)
"""Few data points for the first rounds; another number gives another path, for a surface that came out folded."""
MEDIUM_POINTS = 3000
"""More than these are only taken in for the last rounds."""
COARSE_ROUNDS, FINE_ROUNDS, LAST_ROUNDS, SLIDES = 8, 10, 3, 3
COARSE_REST, FINE_REST = 0.2, 0.02
"""A stage ends when the surface moves less than this share of the noise."""
FIRST_NOISE = 1.4826
"""Times the median absolute distance: the standard deviation of a Gaussian, half of the points being strangers."""


@dataclass(frozen=True)
class Refined:
    """A refined box in the centred, scaled frame.

    Attributes:
        box: deformed.
        sheets: the surfaces with their foot points and inlier probabilities.
        solution: of the last round.
        history: one record a round.
    """

    box: ControlBox
    sheets: tuple[Sheet, ...]
    solution: Solution
    history: tuple[Iteration, ...]

    @property
    def covered(self) -> bool:
        """Whether the data samples all of every surface."""
        return all(sheet.is_covered() for sheet in self.sheets)

    @property
    def tangled(self) -> bool:
        """Whether surfaces cross although the data covers them: more strength would not undo that."""
        if not self.covered:
            return False
        names = map(str, range(len(self.sheets)))
        surfaces = {name: sheet.superquadric for name, sheet in zip(names, self.sheets)}
        return bool(DeformableModel(surfaces, self.box).crossings())


class Penalty(Protocol):
    """A cost of the box besides the data's and the regulariser's."""

    def equations(self, box: ControlBox) -> NormalEquations:
        """Its normal equations, linear about a box, in the displacement from the undeformed box."""

    def cost(self, box: ControlBox) -> float:
        """The cost itself."""


class Rounds:
    """The state that goes from round to round.

    Args:
        box: undeformed, around the outermost surface, with the wanted number of control points.
        probes: (n, 3) points of all surfaces before deformation, to tell their motion by.
        regularity: name or object.
        strength: alpha per data point; None for the evidence's.
        robust: whether outliers are detected and down-weighted.
        progress: called after each round with (done, about how many).
    """

    def __init__(
        self,
        box: ControlBox,
        probes: Array,
        regularity: str | Regulariser = "bending",
        strength: float | None = None,
        robust: bool = True,
        progress: Progress | None = None,
    ) -> None:
        self.target, self.regularity, self.strength, self.robust = box, regularity, strength, robust
        self.probes, self.progress = probes, progress or (lambda done, total: None)
        self.history: list[Iteration] = []
        self.near: Solution | None = None
        self.effective_fraction = 1.0

    @property
    def ladder(self) -> list[tuple[int, int, int]]:
        """Control points a side from stage to stage: 3, 5, 7 ... up to the wanted number."""
        l, m, n, _ = self.target.control_points.shape
        most = max(l, m, n)
        return sorted({(min(l, s), min(m, s), min(n, s)) for s in (*range(3, most, 2), most)})

    def begun(self, few: Few) -> tuple[ControlBox, Solution]:
        """The first stage, with few control points."""
        return self._stage(ControlBox.undeformed(self.target.origin, self.target.edges, self.ladder[0]), few)

    def coarse(self, box: ControlBox, few: Few) -> Refined:
        """All further stages on few points that are matched anew in each round; the last round on the data alone.

        Args:
            box: from the first stage, maybe on other points.
            few: the points.
        """
        for shape in self.ladder[1:] or self.ladder:
            box, _ = self._stage(box.elevate((shape[0] - 1, shape[1] - 1, shape[2] - 1)), few)
        self._slide(box, few.sheets)
        self.near = None  # the strengths so far knew the pulls; this one counts
        box, solution = self._step(box, few.sheets, [None] * len(few.sheets))
        return Refined(box, few.sheets, solution, tuple(self.history))

    def _stage(self, box: ControlBox, few: Few) -> tuple[ControlBox, Solution]:
        self.near = None
        pairs = [Correspondence.between(sheet.superquadric, cloud) for sheet, cloud in zip(few.sheets, few.clouds)]
        for _ in range(COARSE_ROUNDS):
            pulls = [self._match(box, *each) for each in zip(few.sheets, pairs, few.covered)]
            box, solution = self._step(box, few.sheets, pulls)
            if self.history[-1].surface_motion < COARSE_REST * solution.noise:
                break
        return box, solution

    def resumed(self, sheets: Sequence[Sheet], box: ControlBox) -> Refined:
        """In place of the coarse stages: one round on few points from a box that is deformed already."""
        few = [sheet.thinned(COARSE_POINTS[0], self.robust) for sheet in sheets]
        for sheet in few:
            sheet.origins = closest_on(sheet.superquadric, box, sheet.points).origins
        box, solution = self._step(box, few, [None] * len(few))
        return Refined(box, tuple(few), solution, tuple(self.history))

    def not_worse(self, found: Refined, sheets: Sequence[Sheet]) -> Refined:
        """The coarse stages, or one round from the start where they left it for a place farther from their points.

        Sides of a thin body that are nearer to each other than its points are can be taken for each other.
        """
        rest = ControlBox.undeformed(self.target.origin, self.target.edges, found.box.control_points.shape[:3])
        before = sum((closest_on(s.superquadric, rest, s.points).signed ** 2).sum() for s in found.sheets)
        after = sum((sheet.distances(found.box) ** 2).sum() for sheet in found.sheets)
        return self.resumed(sheets, rest) if before < after else found

    def fine(self, sheets: Sequence[Sheet], coarse: Refined) -> Refined:
        """Rounds on more points, whose foot points only slide, and the last few on all.

        Raises:
            OptionError: the strength that the user gave leaves control points undetermined in the last round.
        """
        self.near, self.effective_fraction = coarse.solution, 1.0
        box, noise = coarse.box, None
        if max(len(sheet.points) for sheet in sheets) > MEDIUM_POINTS:
            some = [sheet.thinned(MEDIUM_POINTS, robust=False) for sheet in sheets]
            box, solution = self._rest(box, some, coarse, FINE_ROUNDS, noise)
            box, solution = self._rest(box, sheets, coarse, LAST_ROUNDS, solution.noise)
        else:
            box, solution = self._rest(box, sheets, coarse, FINE_ROUNDS, noise)
        if self.strength is None:
            box, solution = self._of_independent(box, sheets, solution)
        elif solution.strength != self.strength:
            raise OptionError(
                f"option strength={self.strength:g} leaves control points undetermined; expected a larger one, more "
                f"points or a smaller box (the evidence of the points is largest at {solution.strength:.1e})"
            )
        return Refined(box, tuple(sheets), solution, tuple(self.history))

    def _of_independent(
        self, box: ControlBox, sheets: Sequence[Sheet], solution: Solution
    ) -> tuple[ControlBox, Solution]:
        """A few rounds more at the strength that the points ask for when copies of their neighbours do not count.

        Only now: before the surface rests, what is left over is alike everywhere.
        """
        self.effective_fraction = independent_of(sheets, box)
        for _ in range(LAST_ROUNDS if self.effective_fraction < 1 else 0):
            self._slide(box, sheets)
            box, solution = self._step(box, sheets, [None] * len(sheets))
        return box, solution

    def _rest(
        self, box: ControlBox, sheets: Sequence[Sheet], coarse: Refined, rounds: int, noise: float | None
    ) -> tuple[ControlBox, Solution]:
        """Slide and step until the surface rests."""
        for sheet, part in zip(sheets, coarse.sheets):
            sheet.origins = _placed(sheet, part)
        for _ in range(rounds):
            self._slide(box, sheets)
            if self.robust:
                noise = self._weigh(box, sheets, noise)
            box, solution = self._step(box, sheets, [None] * len(sheets))
            noise = solution.noise
            if self.history[-1].surface_motion < FINE_REST * noise:
                break
        return box, solution

    def penalised(self, state: Refined, penalty: Penalty, strength: float) -> Refined | None:
        """One more round at a given strength with a penalty that is not linear: as far as it lowers the sum.

        None where penalty and strength leave control points undetermined.
        """
        box, sheets = state.box, state.sheets
        self._slide(box, sheets)
        evidence = evidence_of(sheets, [None] * len(sheets), box, self.regularity, self.effective_fraction)
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
        self._note(box, after, solution)
        return replace(state, box=after, solution=solution, history=tuple(self.history))

    def weighed(self, refined: Refined) -> Refined:
        """The same with the inliers that its own distances suggest, in sheets of its own."""
        sheets = tuple(copy(sheet) for sheet in refined.sheets)
        if self.robust:
            self._weigh(refined.box, sheets, None)
        return replace(refined, sheets=sheets)

    def _match(self, box: ControlBox, sheet: Sheet, pairs: Correspondence, covered: bool) -> Pull | None:
        costs = pairs.costs(box)
        sheet.origins = update_foot_points(sheet.superquadric, box, sheet.points, pairs.facing(costs), SLIDES)
        if not covered:
            return None
        origins, targets = pairs.unclaimed(costs, sheet.origins)
        wanted = ~sheet.missing(box.deform(origins)) if len(origins) else np.zeros(0, dtype=bool)
        if not wanted.any():
            return None
        return Pull(origins[wanted], targets[wanted], float(sheet.weights.sum()) / len(pairs.origins))

    def _slide(self, box: ControlBox, sheets: Sequence[Sheet]) -> None:
        for sheet in sheets:
            sheet.origins = update_foot_points(sheet.superquadric, box, sheet.points, sheet.origins, SLIDES)

    def _weigh(self, box: ControlBox, sheets: Sequence[Sheet], noise: float | None) -> float:
        distances = [sheet.distances(box) for sheet in sheets]
        if noise is None:
            noise = FIRST_NOISE * float(np.median(np.concatenate(distances)))
        for sheet, distance in zip(sheets, distances):
            sheet.weigh(distance, noise)
        return noise

    def _step(
        self, box: ControlBox, sheets: Sequence[Sheet], pulls: Sequence[Pull | None]
    ) -> tuple[ControlBox, Solution]:
        evidence = evidence_of(sheets, pulls, box, self.regularity, self.effective_fraction)
        solution = self.near = evidence.select(self.strength, self.near)
        after = moved(box, solution)
        self._note(box, after, solution)
        return after, solution

    def _note(self, box: ControlBox, after: ControlBox, solution: Solution) -> None:
        self.history.append(record(box, after, self.probes, solution.noise))
        self.progress(len(self.history), COARSE_ROUNDS * len(self.ladder) + FINE_ROUNDS)


def _placed(sheet: Sheet, part: Sheet) -> Array:
    """First foot points (n, 3) of all data: of the nearest of the few points; the mean where several are as near."""
    near, counts = nearest(part.points, sheet.points, 1)
    middle = np.einsum("nk,nki->ni", counts, part.origins[near]) / counts.sum(axis=1, keepdims=True)
    return sheet.superquadric.project(middle)


def coarse_unfolded(rounds: Rounds, box: ControlBox, sheets: Sequence[Sheet]) -> Refined:
    """The coarse stages; where they come out tangled, again on other points: the first without counts, or the last."""
    for points in COARSE_POINTS:
        few = Few.of(sheets, points, rounds.robust)
        found = rounds.coarse(box if points == COARSE_POINTS[0] else rounds.begun(few)[0], few)
        if not found.tangled:
            break
    return rounds.not_worse(found, sheets)
