"""Fold removal: a penalty on small Jacobian determinants, in rounds until the map is verified to be free of folds.

The data determines the surface and hardly the space inside, so a fold there can be removed almost without moving the
surface. A larger strength would remove it too, but would move the whole surface off the data.
"""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Protocol, TypeVar

import numpy as np

from quadriform.fitting.least_squares.marginal_likelihood import Solution
from quadriform.fitting.least_squares.normal_equations import NormalEquations
from quadriform.fitting.refinement.stage import Problem, Refined
from quadriform.points import Array
from quadriform.shapes.control_box import ControlBox
from quadriform.shapes.fold_bound import determinant_rows, grid_inside, jacobian_bound, never_folds
from quadriform.shapes.model import DeformableModel
from quadriform.shapes.superquadric import Superquadric


@dataclass(frozen=True)
class FoldRemoval:
    """The constants of fold removal; determinants of 1 mean no change of volume."""

    min_determinant: float = 0.1
    """The penalty acts on determinants below this fraction of the usual one, well before they reach zero."""
    verifiable: float = 0.03
    """A proof is only tried above this fraction at all points of the penalty: below it, bounds seldom suffice."""
    first_weight: float = 1e-3
    """The penalty of a point at first, as a fraction of all the data: too little to move the surface."""
    stronger: float = 2.0
    """Growth of the penalty from round to round, slow enough for the surface to follow."""
    most_rounds: int = 30
    """By then the penalty has grown a billionfold."""
    lattice: int = 21
    """Points along an axis of the lattice inside: a fold of a box of 5 control points spans several."""
    grid: int = 12
    """Cells along an edge of the grids on the surfaces, where folds often begin."""
    fine_lattice: int = 45
    """Points along an axis of the lattice on which low determinants are sought where only the proof fails."""
    fine_grid: int = 32
    """Cells along an edge of the grids on the surfaces, in that search."""
    cluster: int = 5
    """Points along each axis of a cluster around the lowest bound of a determinant, two cells of that lattice wide."""
    strongest: float = 1e3
    """Fold removal begins at this many times the strength, where maps are nearly affine."""
    descent: int = 8
    """Steps from there to the strength, each less than a factor of three."""
    rounds: int = 4
    """Most rounds at each of these strengths, where the surface need not converge."""
    foot_point_searches: int = 8
    """Nearest foot points are sought at most so many times; each time fewer of them change."""
    not_nearer: float = 0.8
    """They are used where they lower the sum of squared distances to this fraction; else the given ones were right."""
    affine: float = 1e3
    """A strength at which the map stays affine whatever the data."""
    accepted: float = 1.5
    """A fold is kept where its removal makes the noise more than this many times larger."""
    negligible: float = 0.025
    """Noise up to this fraction of the RMS radius is accepted in any case."""


FOLDS = FoldRemoval()


class State(Protocol):
    """A deformed box and the solution that led to it."""

    @property
    def box(self) -> ControlBox:
        """Of which folds are removed."""

    @property
    def solution(self) -> Solution:
        """With the strength and the noise."""


S = TypeVar("S", bound=State)


@dataclass(frozen=True)
class JacobianPenalty:
    """Penalty on small Jacobian determinants: weight (least - det / usual)^2 over the points below least.

    Attributes:
        points: (n, 3), before deformation, where the determinant is computed.
        weight: of a point.
        usual: determinant without local deformation: 1, or the change of volume by a large motion. The cavity of a
            heart is emptied to a fifth, and a fifth of the volume everywhere is no fold.
        least: fraction of the usual determinant.
    """

    points: Array
    weight: float
    usual: float = 1.0
    least: float = FOLDS.min_determinant

    @classmethod
    def of(cls, box: ControlBox, surfaces: Mapping[str, Superquadric], count: float, sigma: float) -> "JacobianPenalty":
        """The penalty on a lattice inside the surfaces and on their grids, for data of `count` points with a noise."""
        grids = [surface.grid(FOLDS.grid)[0] for surface in surfaces.values()]
        points = np.concatenate([grid_inside(box, list(surfaces.values()), FOLDS.lattice), *grids])
        # a determinant of zero costs this fraction of the squared residuals of all data
        return cls(points, FOLDS.first_weight * count * (sigma / FOLDS.min_determinant) ** 2)

    def relative_to(self, box: ControlBox) -> "JacobianPenalty":
        """The penalty with the median determinant of a box as the usual one."""
        return replace(self, usual=float(np.median(box.jacobian_determinant(self.points))))

    def minimum(self, box: ControlBox) -> float:
        """The smallest determinant at the points, over the usual one."""
        return float(self._determinants(box).min())

    def _determinants(self, box: ControlBox) -> Array:
        return box.jacobian_determinant(self.points) / self.usual

    def equations(self, box: ControlBox) -> NormalEquations:
        """The penalty, linear about a box, in the displacement of the control points from the undeformed box."""
        determinants = self._determinants(box)
        low = determinants < self.least
        rows = np.empty((0, box.control_points.size))
        if low.any():
            rows = determinant_rows(box, self.points[low]) / self.usual
        # first-order in the control points about this box, then moved to displacements from the undeformed one
        target = self.least - determinants[low] + rows @ (box.control_points - box.rest).ravel()
        return NormalEquations.of_rows(rows, target, self.weight)

    def cost(self, box: ControlBox) -> float:
        """The value of the penalty at a box."""
        return self.weight * float((np.maximum(self.least - self._determinants(box), 0) ** 2).sum())

    def stronger(self) -> "JacobianPenalty":
        """The penalty with more weight."""
        return replace(self, weight=FOLDS.stronger * self.weight)

    def check(self, box: ControlBox, surfaces: Mapping[str, Superquadric]) -> tuple[bool, "JacobianPenalty"]:
        """Whether a box is certified; and the penalty, with more points where only the certificate fails.

        Certified means that the map is verified not to fold inside the surfaces and that no meshes of them cross. False
        without a proof being tried where the smallest determinant at the points is at most `FOLDS.verifiable`.
        """
        if self.minimum(box) <= FOLDS.verifiable:
            return False, self
        if certified(box, surfaces):
            return True, self
        return False, replace(self, points=np.concatenate([self.points, _low_points(box, surfaces, self.usual)]))


def remove_folds(
    penalised: Callable[[S, JacobianPenalty, float], S | None],
    state: S,
    penalty: JacobianPenalty,
    strength: float,
    surfaces: Mapping[str, Superquadric],
    largest_sigma: float,
) -> S | None:
    """The state after rounds under a growing penalty until it is certified (`JacobianPenalty.check`).

    None where that is not reached within `FOLDS.most_rounds` and with a noise of at most `largest_sigma`, or where
    control points stay undetermined.

    Args:
        penalised: the state after a round at a strength with the penalty; None where control points stay undetermined.
        state: a box and the solution that led to it.
        penalty: of the first round.
        strength: of all rounds.
        surfaces: name -> superquadric.
        largest_sigma: the largest noise that is accepted.
    """
    found: S | None = state
    for _ in range(FOLDS.most_rounds):
        if found is None or found.solution.sigma > largest_sigma:
            return None
        verified, penalty = penalty.check(found.box, surfaces)
        if verified:
            return found
        found, penalty = penalised(found, penalty, strength), penalty.stronger()
    return None


def accepted_sigma(before: float) -> float:
    """The largest sigma, in RMS radii, at which the removal of folds succeeds; `before` is that of the folded fit."""
    return max(FOLDS.accepted * before, FOLDS.negligible)


def least_regularised(problem: Problem, refined: Refined, surfaces: dict[str, Superquadric]) -> Refined | None:
    """The certified refinement of least noise on the way from an affine map to the strength of a folded refinement.

    None where there is none. The strength decreases, by about a decade a step, from one under which every map is nearly
    affine; the first map starts from the undeformed superquadrics, each later one from the map before. The search ends
    at the first strength whose map is not certified: where that is the first of all, as where the undeformed
    superquadrics cross, there is none. The noise falls with the strength, so the result is mostly the least regularised
    map. It is meant for points that are no surface, such as those of a filled volume, whose folded fit is useless at
    any noise.
    """
    unfolded, best = _undeformed(refined), None
    penalty = _penalty(refined, surfaces)
    # one strength a decade: each map begins near that of the last
    decades = int(np.ceil(np.log10(FOLDS.affine / refined.solution.strength)))
    for strength in np.geomspace(FOLDS.affine, refined.solution.strength, max(decades, 0) + 1):
        unfolded = replace(unfolded, datasets=problem.weighting.weighted(unfolded.box, unfolded.datasets, None))
        unfolded, above = _after_penalised_rounds(problem, unfolded, penalty, float(strength))
        if not above or not certified(unfolded.box, surfaces):
            break
        if best is None or unfolded.sigma < best.sigma:
            best = unfolded
    return best


def without_folds(
    problem: Problem, refined: Refined, surfaces: dict[str, Superquadric], largest_sigma: float
) -> Iterator[Refined]:
    """Up to three certified refinements with a sigma of at most `largest_sigma`, each computed when it is asked for.

    First the given refinement, if it is certified within that sigma; this is not tried where its least determinant is
    at most `FOLDS.verifiable`. Then the results of fold removal from two starts, its own box and the undeformed one.
    Where surfaces cross although data covers them, the undeformed box comes first, because the foot points of the given
    one are misleading.
    """
    penalty = _penalty(refined, surfaces)
    accepted = refined.sigma <= largest_sigma
    if accepted and penalty.minimum(refined.box) > FOLDS.verifiable and certified(refined.box, surfaces):
        yield refined
    undeformed_first = refined.crosses_though_covered
    for is_undeformed in (undeformed_first, not undeformed_first):
        start = _undeformed(refined) if is_undeformed else refined
        found = _by_decreasing_strength(problem, start, penalty, surfaces, largest_sigma)
        if found is not None:
            yield _continued_from_nearest(problem, found, penalty, surfaces)


def _penalty(refined: Refined, surfaces: Mapping[str, Superquadric]) -> JacobianPenalty:
    count = sum(len(data.points) for data in refined.datasets)
    return JacobianPenalty.of(refined.box, surfaces, count, refined.sigma)


def _by_decreasing_strength(
    problem: Problem,
    refined: Refined,
    penalty: JacobianPenalty,
    surfaces: dict[str, Superquadric],
    largest_sigma: float,
) -> Refined | None:
    """The refinement under the penalty at strengths that decrease from one under which nothing folds to the given one.

    Folds that remain are removed at the least of these strengths at which that succeeds; None where it does at none.
    """
    states = list[Refined]()
    for strength in refined.solution.strength * np.geomspace(FOLDS.strongest, 1, FOLDS.descent):
        refined, _ = _after_penalised_rounds(problem, refined, penalty, float(strength))
        states.append(refined)
    # the noise at the largest strength is that of a nearly affine map: no certified result need be worse
    largest_sigma = min(largest_sigma, states[0].sigma)
    for state in reversed(states):
        strength = state.solution.strength
        found = remove_folds(problem.penalised, state, penalty, strength, surfaces, largest_sigma)
        if found is not None:
            return found
    return None


def _continued_from_nearest(
    problem: Problem, refined: Refined, penalty: JacobianPenalty, surfaces: dict[str, Superquadric]
) -> Refined:
    """The certified refinement, continued from the nearest foot points where the given ones are much farther away.

    Foot points move along the surface. When it is folded and unfolded, some remain far from the nearest point, such as
    on the wrong face beside a sharp rim: they distort the surface, and robust weights treat their points as outliers.
    """
    for _ in range(FOLDS.foot_point_searches):
        renewed = refined.nearest()
        if _misfit(renewed) > FOLDS.not_nearer * _misfit(refined):
            return refined
        renewed = replace(renewed, datasets=problem.weighting.weighted(renewed.box, renewed.datasets, refined.sigma))
        strength, sigma = refined.solution.strength, refined.sigma
        penalised, _ = _after_penalised_rounds(problem, renewed, penalty, strength)
        unfolded = remove_folds(problem.penalised, penalised, penalty, strength, surfaces, sigma)
        if unfolded is None:
            return refined
        refined = unfolded
    return refined


def _misfit(refined: Refined) -> float:
    """Sum of squares of the distances from all points to their foot points."""
    return float(sum((data.weights * data.distances(refined.box) ** 2).sum() for data in refined.datasets))


def _after_penalised_rounds(
    problem: Problem, refined: Refined, penalty: JacobianPenalty, strength: float
) -> tuple[Refined, bool]:
    """The refinement after a few rounds with the penalty at one strength, and whether a proof may succeed."""
    for _ in range(FOLDS.rounds):
        after = problem.penalised(refined, penalty, strength)
        if after is None:
            return refined, False
        refined = after
        if penalty.minimum(refined.box) > FOLDS.verifiable:
            return refined, True
    return refined, False


def _undeformed(refined: Refined) -> Refined:
    """The undeformed box, and the nearest foot points on the undeformed surfaces."""
    return replace(refined, box=refined.box.with_control_points(refined.box.rest)).nearest()


def certified(box: ControlBox, surfaces: Mapping[str, Superquadric]) -> bool:
    """Whether the map provably does not fold inside the surfaces and no mesh of them crosses."""
    return never_folds(box, surfaces.values()) and not DeformableModel(dict(surfaces), box).crossings()


def _low_points(box: ControlBox, surfaces: Mapping[str, Superquadric], usual: float) -> Array:
    """More points for the penalty: those of finer lattices with a low determinant, and some around the lowest bound."""
    inside = [grid_inside(box, list(surfaces.values()), FOLDS.fine_lattice)]
    fine = np.concatenate([*inside, *(surface.grid(FOLDS.fine_grid)[0] for surface in surfaces.values())])
    low = fine[box.jacobian_determinant(fine) < FOLDS.verifiable * usual]
    # the proof subdivides cells, so its lowest bound lies between lattice points
    return np.concatenate([jacobian_bound(box, surfaces.values()).where + cluster(box), low])


def cluster(box: ControlBox) -> Array:
    """Points (n, 3) around the origin, two cells of the fine lattice wide."""
    steps = np.linspace(-1, 1, FOLDS.cluster) / FOLDS.fine_lattice
    return np.asarray(np.stack(np.meshgrid(steps, steps, steps), axis=-1).reshape(-1, 3) @ box.edges, dtype=np.float64)
