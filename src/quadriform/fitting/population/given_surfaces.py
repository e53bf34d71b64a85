"""A map without folds that has given surfaces: the space inside and beyond follows with the least bending.

The data are points of the surfaces, each with its standard deviation s_i along the normal n_i. With residuals e_i from
foot points to these N points, the control points minimise

    sum_i 1 / s_i^2 [ (n_i . e_i)^2 + epsilon |e_i - (n_i . e_i) n_i|^2 ] + alpha N E + a penalty on small determinants

with epsilon and the bending energy E of `refinement/point_to_plane.py`. At a large strength alpha the map is nearly
affine and has no folds. From there alpha decreases under the penalty, so that no round begins far inside a fold. Points
and their foot points correspond from the beginning, so that a few rounds at each strength suffice.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from scipy.linalg import cho_solve

from quadriform.fitting.least_squares.factorisation import cholesky_factor
from quadriform.fitting.least_squares.normal_equations import NormalEquations
from quadriform.fitting.refinement.point_to_plane import Rows, plane_metrics, step_length
from quadriform.fitting.refinement.unfolding import FOLDS, JacobianPenalty, cluster
from quadriform.points import Array, outer_squares
from quadriform.shapes.bending import Bending
from quadriform.shapes.closest import surface_normals, update_foot_points
from quadriform.shapes.control_box import ControlBox
from quadriform.shapes.fold_bound import positive_bound
from quadriform.shapes.model import DeformableModel
from quadriform.shapes.superquadric import Superquadric


@dataclass(frozen=True)
class Descent:
    """The constants of the descent from an affine map."""

    strengths: tuple[float, ...] = (1e-4, 1e-3, 1e-2, 1e-1, 1e0, 1e1, 1e2, 1e3)
    """It begins at the first one from `affine` on whose map has no folds. At the least one surfaces without folds move
    by a fifth of their standard deviation."""
    affine: float = 1e-1
    rounds: int = 3
    """At each strength."""
    tangential_steps: int = 3
    """Of each foot point in a round."""
    least: float = 0.2
    """The penalty acts on determinants below this, where 1 is no change of volume."""
    weight: float = 1e3
    """Of the penalty: a point without volume counts as one of the data at a distance of six standard deviations."""
    stronger: float = 2.0
    """Growth of the penalty from round to round where folds remain at the end of the descent."""
    most_rounds: int = 20
    """By then it has grown a millionfold."""


DESCENT = Descent()


class GivenSurface(NamedTuple):
    """A surface by its points.

    Attributes:
        superquadric: before deformation.
        points: (n, 3).
        deviations: (n,), the standard deviation of each along the normal.
    """

    superquadric: Superquadric
    points: Array
    deviations: Array


class State(NamedTuple):
    """A box, and points (n, 3) of each surface before deformation, which it moves to foot points of the given ones."""

    box: ControlBox
    origins: tuple[Array, ...]


@dataclass(frozen=True)
class GivenSurfaces:
    """One or more surfaces, and N E, the bending energy (3 k, 3 k) of a box times the number of their points."""

    given: tuple[GivenSurface, ...]
    bending: Array

    @classmethod
    def of(cls, given: Sequence[GivenSurface], shape: tuple[int, int, int]) -> GivenSurfaces:
        """For boxes with so many control points along each axis."""
        count = sum(len(each.points) for each in given)
        energy: Array = count * np.kron(Bending.matrix(shape), np.eye(3)).astype(np.float64)
        return cls(tuple(given), energy)

    @property
    def superquadrics(self) -> dict[str, Superquadric]:
        """The surfaces before deformation, by number."""
        return {str(number): each.superquadric for number, each in enumerate(self.given)}

    def without_folds(self, start: State) -> ControlBox | None:
        """The certified box of the least strength at which one is found; None where there is none.

        Args:
            start: a box that has the surfaces, and maybe folds.
        """
        penalty = JacobianPenalty.of(start.box, self.superquadrics, 1.0, 1.0)
        penalty = replace(penalty, weight=DESCENT.weight, least=DESCENT.least)
        states = self._descent(start, penalty)
        for strength, state in reversed(states):
            found, penalty = self._certified(state, strength, penalty)
            if found is not None:
                return found
        return None

    def _descent(self, start: State, penalty: JacobianPenalty) -> list[tuple[float, State]]:
        """Strengths, the largest one first, and the states after rounds at them."""
        data = self._equations(start)
        above = [strength for strength in DESCENT.strengths if strength >= DESCENT.affine]
        for strength in above:
            box = _solved(start.box, data.matrix + strength * self.bending, data.right)
            if penalty.minimum(box) > FOLDS.verifiable:
                break
        states = [(strength, State(box, start.origins))]
        for strength in (each for each in reversed(DESCENT.strengths) if each < states[0][0]):
            state = states[-1][1]
            for _ in range(DESCENT.rounds):
                state = self._round(state, strength, penalty)
            states.append((strength, state))
        return states

    def _certified(
        self, state: State, strength: float, penalty: JacobianPenalty
    ) -> tuple[ControlBox | None, JacobianPenalty]:
        """The first certified box of rounds with a growing penalty; and the given penalty with the points it needed."""
        for weight in penalty.weight * DESCENT.stronger ** np.arange(DESCENT.most_rounds):
            verified, penalty = self._checked(state.box, penalty)
            if verified:
                return state.box, penalty
            state = self._round(state, strength, replace(penalty, weight=DESCENT.stronger * float(weight)))
        return None, penalty

    def _checked(self, box: ControlBox, penalty: JacobianPenalty) -> tuple[bool, JacobianPenalty]:
        """Whether a box is certified; and the penalty, with points where the proof fails if only that does."""
        if penalty.minimum(box) <= FOLDS.verifiable:
            return False, penalty
        bound = positive_bound(box, self.superquadrics.values())
        if bound.lower > 0 and not DeformableModel(self.superquadrics, box).crossings():
            return True, penalty
        points = np.concatenate([penalty.points, bound.where + cluster(box)])
        return False, replace(penalty, points=points)

    def _equations(self, state: State) -> NormalEquations:
        """The normal equations of all points."""
        parts = []
        for each, origins in zip(self.given, state.origins):
            normals = surface_normals(each.superquadric, state.box, origins)
            metric = plane_metrics(outer_squares(normals)) / each.deviations[:, None, None] ** 2
            parts.append(Rows(origins, each.points, metric).equations(state.box))
        return sum(parts[1:], parts[0])

    def _with_foot_points(self, state: State) -> State:
        steps, pairs = DESCENT.tangential_steps, zip(self.given, state.origins)
        origins = [update_foot_points(each.superquadric, state.box, each.points, o, steps) for each, o in pairs]
        return State(state.box, tuple(origins))

    def _round(self, state: State, strength: float, penalty: JacobianPenalty) -> State:
        """The state after a Gauss-Newton step, shortened until the sum does not increase."""
        state = self._with_foot_points(state)
        box, data, bending = state.box, self._equations(state), strength * self.bending
        whole = data + penalty.equations(box)
        step = _solved(box, whole.matrix + bending, whole.right).control_points - box.control_points

        def total(length: float) -> float:
            """The sum at a fraction of the step."""
            trial = box.with_control_points(box.control_points + length * step)
            p = (trial.control_points - trial.rest).ravel()
            return data.squares(p) + float(p @ bending @ p) + penalty.cost(trial)

        return State(box.with_control_points(box.control_points + step_length(total) * step), state.origins)


def _solved(box: ControlBox, matrix: Array, right: Array) -> ControlBox:
    """The box of normal equations; the given one where rounding leaves them undetermined."""
    factor = cholesky_factor(np.asfortranarray(matrix))
    if factor is None:
        return box
    displacement = cho_solve((factor, True), right)
    return box.with_control_points(box.rest + displacement.reshape(box.rest.shape))
