"""One round of refinement by tangent distance: the foot points rest, the box moves.

For all surfaces at once, with r_i from the surface to a data point and n_i the normal at its foot point,

    sum_i w_i [ (n_i . r_i)^2 + r_i' H_i r_i ] + alpha N E(P - P0)

is minimised over the control points. w_i is the probability to be an inlier, E the regulariser and alpha the strength
of the largest evidence. H_i says how far the foot point may be led along the surface: freely where neighbouring data
would notice, not across a lone curve of data, where nothing else holds the surface.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from quadriform.fitting.least_squares.marginal_likelihood import Evidence, Solution
from quadriform.fitting.least_squares.normal_equations import NormalEquations, normal_equations
from quadriform.fitting.least_squares.regularisers import Regulariser, penalty_matrix
from quadriform.fitting.neighbourhood import effective_fraction
from quadriform.fitting.refinement.surface_data import Sheet
from quadriform.fitting.result import Iteration
from quadriform.points import Array
from quadriform.shapes.closest import surface_normals
from quadriform.shapes.control_box import ControlBox
from quadriform.shapes.superquadric import Superquadric

LEAST_HOLD = 2e-3
"""Foot points are never quite free, or the linear step would have no size along the surface."""
SMALLEST_STEP = 1e-3
"""A step of which not even this fraction lowers the sum is as good as none."""


@dataclass(frozen=True)
class Pull:
    """Model points drawn to data points, besides the data's own foot points.

    Attributes:
        origins: (m, 3), on the superquadric.
        targets: (m, 3).
        weight: how much each counts.
    """

    origins: Array
    targets: Array
    weight: float


@dataclass(frozen=True)
class Rows:
    """What one surface adds to the sum: origins, targets (n, 3) and metrics (n, 3, 3)."""

    origins: Array
    targets: Array
    metric: Array


def data_rows(sheet: Sheet, box: ControlBox) -> Rows:
    """The data's own part of the sum."""
    normals = surface_normals(sheet.superquadric, box, sheet.origins)
    along = sheet.around.along - np.einsum("ni,ni->n", sheet.around.along, normals)[:, None] * normals
    across = np.cross(normals, along)
    across /= np.maximum(np.linalg.norm(across, axis=1, keepdims=True), 1e-300)
    held = sheet.around.alone_across()[:, None, None] * _squares(across)
    weights = (sheet.weights * sheet.inliers)[:, None, None]
    return Rows(sheet.origins, sheet.points, weights * (_sliding(normals) + held))


def pull_rows(superquadric: Superquadric, box: ControlBox, pull: Pull) -> Rows:
    """The part of model points that are drawn to the data."""
    normals = surface_normals(superquadric, box, pull.origins)
    return Rows(pull.origins, pull.targets, pull.weight * _sliding(normals))


def _sliding(normals: Array) -> Array:
    return LEAST_HOLD * np.eye(3) + (1 - LEAST_HOLD) * _squares(normals)


def _squares(vectors: Array) -> Array:
    return vectors[:, :, None] * vectors[:, None, :]


def evidence_of(
    sheets: Sequence[Sheet],
    pulls: Sequence[Pull | None],
    box: ControlBox,
    regularity: str | Regulariser,
    effective_fraction: float = 1.0,
) -> Evidence:
    """The linear problem of one round as a function of the strength; `share` of the points are independent."""
    rows = [data_rows(sheet, box) for sheet in sheets]
    rows += [pull_rows(sheet.superquadric, box, pull) for sheet, pull in zip(sheets, pulls) if pull is not None]
    origins, targets = np.concatenate([r.origins for r in rows]), np.concatenate([r.targets for r in rows])
    metric = np.concatenate([r.metric for r in rows])
    equations = normal_equations(box.local(origins), metric, targets - origins, box.degrees)
    count = sum(float((sheet.weights * sheet.inliers).sum()) for sheet in sheets)
    return evidence_from(equations, box, regularity, count, effective_fraction)


def evidence_from(
    equations: NormalEquations, box: ControlBox, regularity: str | Regulariser, count: float, effective_fraction: float
) -> Evidence:
    """The same from normal equations that are summed up already, of rows whose weights sum up to `count`."""
    l, m, n, _ = box.control_points.shape
    return Evidence(equations, penalty_matrix(regularity, (l, m, n)), count, effective_fraction)


def independent_of(sheets: Sequence[Sheet], box: ControlBox) -> float:
    """The share of all points that are independent, by what a fit leaves over."""
    counts, kept = [], []
    for sheet in sheets:
        feet, weights = box.deform(sheet.origins), sheet.weights * sheet.inliers
        normals = surface_normals(sheet.superquadric, box, sheet.origins)
        deviations = np.einsum("ni,ni->n", sheet.points - feet, normals)
        counts.append(float(weights.sum()))
        kept.append(effective_fraction(feet, deviations, weights))
    return float(np.average(kept, weights=counts))


def moved(box: ControlBox, solution: Solution) -> ControlBox:
    """The box with its control points displaced from rest as a solution says."""
    return box.with_control_points(box.rest + solution.displacement.reshape(box.control_points.shape))


def step_length(total: Callable[[float], float]) -> float:
    """The first of 1, 1/2, 1/4 ... at which a sum is not above that at 0, or the first below `SMALLEST_STEP`."""
    before, length = total(0.0), 1.0
    while total(length) > before and length > SMALLEST_STEP:
        length /= 2
    return length


def record(before: ControlBox, after: ControlBox, probes: Array, noise: float) -> Iteration:
    """What one round changed; `probes` (n, 3) are points of the superquadrics."""
    return Iteration(
        error=noise,
        box_motion=_rms(after.control_points - before.control_points),
        box_displacement=_rms(after.control_points - after.rest),
        surface_motion=_rms(after.deform(probes) - before.deform(probes)),
    )


def _rms(vectors: Array) -> float:
    return float(np.sqrt((vectors**2).sum(axis=-1).mean()))
