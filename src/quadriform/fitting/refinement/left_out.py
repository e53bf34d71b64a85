"""Cross-validation of the strength: the error of predicting points left out, one patch of the surface at a time.

Patches and not single points, for errors of neighbours are correlated: a surface that follows them predicts the next
point well and the next patch badly. Foot points and inlier probabilities stay those of the given state, so it must be a
smooth one, which does not depend on details of the data.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from quadriform.fitting.cloud import EQUAL, canonical_order
from quadriform.fitting.least_squares.marginal_likelihood import LinearProblem
from quadriform.fitting.least_squares.normal_equations import NormalEquations, normal_equations
from quadriform.fitting.refinement.point_to_plane import data_rows
from quadriform.fitting.refinement.stage import Problem, Refined
from quadriform.fitting.refinement.surface_data import SurfaceData
from quadriform.points import Array
from quadriform.shapes.control_box import ControlBox


@dataclass(frozen=True)
class LeftOut:
    """The constants of the cross-validation."""

    patches: int = 20
    """Patches over all surfaces, each left out in turn: about as large as what a control point changes."""
    step: float = 10.0
    """Factor between neighbouring strengths, of which the best is found."""
    significant: float = 0.01
    """Each step to a smaller strength must lower the errors of the patches by a signed-rank test at this level: a few
    patches, such as the ends of a stack of thick slices, have most of the error, and prove nothing."""


LEFT_OUT = LeftOut()


def better_strength(problem: Problem, state: Refined) -> float | None:
    """A smaller strength that predicts patches left out better than that of a state; None where there is none."""
    patches, strength = _patches(problem, state), state.solution.strength
    squares = _squares(patches, strength)
    # each step must lower the errors: where they are level, or zero, the larger strength is as good
    while is_less(smaller := _squares(patches, strength / LEFT_OUT.step), squares):
        strength, squares = strength / LEFT_OUT.step, smaller
    return strength if strength < state.solution.strength else None


def is_less(one: Array, other: Array) -> bool:
    """Whether squared errors (n,) of the same patches are less in sum, and significantly so by their ranks."""
    return bool(one.sum() < other.sum() and signed_rank_p_value(other - one) < LEFT_OUT.significant)


def signed_rank_p_value(differences: Array) -> float:
    """The p-value of Wilcoxon's signed-rank test (Biometrics Bulletin 1(6), 1945), one-sided, of differences (n,).

    It is the probability that the ranks of the positive differences have a sum as large as here or larger, where the
    signs are random and independent. Exact, for a few dozen differences; zeros are left out, and equal sizes share
    their mean rank. SciPy has the test too, in a package that takes as long to load as a small fit.
    """
    differences = differences[differences != 0]
    sizes = np.abs(differences)
    # twice the mean ranks, so that they are whole numbers: with m smaller sizes and e equal ones, itself among them,
    # the ranks m + 1 to m + e have the mean m + (e + 1) / 2
    ranks = 2 * (sizes < sizes[:, None]).sum(axis=1) + (sizes == sizes[:, None]).sum(axis=1) + 1
    # counts[s] becomes the number of sign patterns whose positive ranks sum up to s: each rank is negative, and leaves
    # the sum as it is, or positive, and adds to it
    counts = np.ones(1)
    for rank in ranks:
        without, more = counts, np.zeros(rank)
        counts = np.concatenate([without, more]) + np.concatenate([more, without])
    return float(counts[ranks[differences > 0].sum() :].sum() / counts.sum())


@dataclass(frozen=True)
class _Patch:
    """The equations of all points but those of a patch, and of these alone."""

    others: LinearProblem
    own: NormalEquations


def _squares(patches: Sequence[_Patch], strength: float) -> Array:
    """Sums of squares (n,) of the distances of each patch to the surface without it; infinite where undetermined."""
    found = [(patch.own, patch.others.solve(strength)) for patch in patches]
    squares = [np.inf if each is None else own.squares(each.displacement) for own, each in found]
    return np.maximum(np.array(squares), 0.0)


def _patches(problem: Problem, state: Refined) -> list[_Patch]:
    """All patches of all surfaces that have a weight.

    The linear problem without a patch is that of all points less the equations of the patch.
    """
    each = max(LEFT_OUT.patches // len(state.datasets), 2)
    parts = [part for data in state.datasets for part in _equations(data, state.box, each)]
    whole = problem.linear_problem(state.datasets, (None,) * len(state.datasets), state.box, 1.0)
    return [_Patch(whole.without_points(own, count), own) for own, count in parts if count > 0]


def _equations(data: SurfaceData, box: ControlBox, count: int) -> list[tuple[NormalEquations, float]]:
    """Normal equations and sum of weights of each patch of one surface."""
    rows, weights, patch = data_rows(data, box), data.effective_weights, _patch_of(data.points, count)
    local, offsets = box.local(rows.origins), rows.targets - rows.origins
    chosen = [patch == number for number in range(count)]
    return [
        (normal_equations(local[of], rows.metric[of], offsets[of], box.degrees), float(weights[of].sum()))
        for of in chosen
    ]


def _patch_of(points: Array, count: int) -> NDArray[np.int64]:
    """The number (n,) of the patch of each point: that of the nearest of centres by farthest-point sampling."""
    ordered = points[canonical_order(points - points.mean(axis=0))]
    far, centres = np.linalg.norm(ordered - points.mean(axis=0), axis=1), []
    for _ in range(count):
        # of equally far points the first in the canonical order, whatever their last digits are
        centres.append(ordered[np.argmax(far >= (1 - EQUAL.values) * far.max())])
        reached = np.linalg.norm(ordered - centres[-1], axis=1)
        far = reached if len(centres) == 1 else np.minimum(far, reached)
    return np.asarray(cKDTree(np.array(centres)).query(points)[1], dtype=np.int64)
