"""One round of refinement by point-to-plane distances: the foot points are fixed, the box moves.

For all surfaces at once the control points minimise

    sum_i w_i / u_i [ (n_i . e_i)^2 + epsilon |e_i - (n_i . e_i) n_i|^2 ] + alpha N E(P - P0) + attractions + priors

    P, P0   the control points, (k, 3), and their undeformed positions
    d_i     a data point, and o_i the origin of its foot point
    e_i     d_i - D(o_i), with D the deformation by P: the residual, from the surface to the data point
    n_i     the normal at the foot point, before the round
    w_i     the probability to be an inlier times the weight of the point
    u_i     (v_i + x) / (1 + x), its variance along n_i relative to the mean one (`SurfaceData.variances`), with the
            known variance v_i (`SurfaceData.known_variances`) and the excess x; 1 where nothing is known
    epsilon `TANGENTIAL_WEIGHT`
    alpha   the strength; E the energy of the regulariser, P -> p' K p for p = P - P0
    N       the sum of the w_i of the data alone (`total_weight`): alpha is per data point, and terms that are no
            measurements do not add to it

Attractions of model points (`Attraction`) are terms like those of data points, in the first rounds only. Priors are
those of surfaces beyond a base (`base_prior.py`). epsilon is small because a foot point may move along the surface:
that part of e_i is no error of the data. With a large one, many points on the same contours would fix the surface
across the contours too, where they measure nothing.

Each term is e_i' M_i e_i with M_i = w_i / u_i [n_i n_i' + epsilon (I - n_i n_i')] and e_i = r_i - B_i p, r_i = d_i -
o_i: the normal equations in the displacement p are those of `normal_equations.py`. Symbols are those of
docs/equations.md.
"""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from quadriform.fitting.cloud import effective_fraction_of_points
from quadriform.fitting.least_squares.marginal_likelihood import LinearProblem, Solution
from quadriform.fitting.least_squares.normal_equations import NormalEquations, normal_equations
from quadriform.fitting.least_squares.regularisers import Regulariser, regulariser_matrix
from quadriform.fitting.refinement.surface_data import SurfaceData
from quadriform.fitting.result import Iteration
from quadriform.points import Array, outer_squares, rms_length
from quadriform.shapes.closest import surface_normals
from quadriform.shapes.control_box import ControlBox
from quadriform.shapes.superquadric import Superquadric

TANGENTIAL_WEIGHT = 2e-3
"""Weight of the tangential part of a residual, relative to the normal one: it limits steps along the surface."""
SMALLEST_STEP = 1e-3
"""A step length of this or less is not halved again: a step that does not lower the sum then is practically none."""
PROBES = 8
"""Cells along an edge of the grids by which the motion of the surfaces in a round is measured."""


@dataclass(frozen=True)
class Attraction:
    """Model points attracted to data points, besides the data's own foot points.

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
    """Terms of the sum, of one or more surfaces: origins o_i and targets d_i (n, 3), and metrics M_i (n, 3, 3)."""

    origins: Array
    targets: Array
    metric: Array

    def equations(self, box: ControlBox, degrees: tuple[int, int, int] | None = None) -> NormalEquations:
        """The normal equations of their sum in the displacement of the control points.

        Args:
            box: in whose undeformed state the origins lie.
            degrees: of a box that is elevated to other degrees, which deforms space alike; None for those of `box`.
        """
        offsets = self.targets - self.origins
        return normal_equations(box.local(self.origins), self.metric, offsets, degrees or box.degrees)


def data_rows(data: SurfaceData, box: ControlBox) -> Rows:
    """The terms of the data in the sum."""
    normals = surface_normals(data.superquadric, box, data.origins)
    weights = (data.effective_weights / data.variances(normals))[:, None, None]
    return Rows(data.origins, data.points, weights * plane_metrics(outer_squares(normals)))


def attraction_rows(superquadric: Superquadric, box: ControlBox, attraction: Attraction) -> Rows:
    """The terms of model points that are attracted to the data."""
    normals = surface_normals(superquadric, box, attraction.origins)
    return Rows(attraction.origins, attraction.targets, attraction.weight * plane_metrics(outer_squares(normals)))


def plane_metrics(squares: Array) -> Array:
    """Metrics (n, 3, 3) with little weight along planes, from the squares (n, 3, 3) of their unit normals."""
    return TANGENTIAL_WEIGHT * np.eye(3) + (1 - TANGENTIAL_WEIGHT) * squares


def linear_problem_of(
    datasets: Sequence[SurfaceData],
    attractions: Sequence[Attraction | None],
    box: ControlBox,
    regularity: str | Regulariser,
    effective_fraction: float = 1.0,
    least_sigma: float = 0.0,
) -> LinearProblem:
    """The linear problem of one round as a function of the strength; a fraction of the points are independent."""
    rows = [data_rows(data, box) for data in datasets]
    rows += [
        attraction_rows(data.superquadric, box, each) for data, each in zip(datasets, attractions) if each is not None
    ]
    origins, targets = np.concatenate([r.origins for r in rows]), np.concatenate([r.targets for r in rows])
    metric = np.concatenate([r.metric for r in rows])
    total_weight = sum(data.total_weight for data in datasets)
    equations = Rows(origins, targets, metric).equations(box)
    return linear_problem_from(equations, box, regularity, total_weight, effective_fraction, least_sigma)


def linear_problem_from(
    equations: NormalEquations,
    box: ControlBox,
    regularity: str | Regulariser,
    total_weight: float,
    effective_fraction: float,
    least_sigma: float = 0.0,
) -> LinearProblem:
    """The linear problem of accumulated normal equations; `total_weight` is N, that of the data without attractions."""
    l, m, n, _ = box.control_points.shape
    return LinearProblem(
        equations, regulariser_matrix(regularity, (l, m, n)), total_weight, effective_fraction, least_sigma
    )


def effective_fraction_of_data(datasets: Sequence[SurfaceData], box: ControlBox) -> float:
    """Effective number of independent points over the number of all points, by the residuals of a fit.

    It is the mean of those of the surfaces, weighted by the sums of their effective weights.
    """
    weights, fractions = [], []
    for data in (each for each in datasets if each.total_weight):  # a surface of outliers alone says nothing
        feet, normals, residuals = data.along_normals(box)
        standardised = residuals / np.sqrt(data.variances(normals))
        weights.append(data.total_weight)
        fractions.append(effective_fraction_of_points(feet, standardised, data.effective_weights))
    return float(np.average(fractions, weights=weights))


def displaced(box: ControlBox, solution: Solution) -> ControlBox:
    """The undeformed box with the displacement of a solution."""
    return box.with_control_points(box.rest + solution.displacement.reshape(box.control_points.shape))


def step_length(total: Callable[[float], float]) -> float:
    """The first of 1, 1/2, 1/4 ... at which a sum is not above that at 0, or the first below `SMALLEST_STEP`."""
    before, length = total(0.0), 1.0
    while total(length) > before and length > SMALLEST_STEP:
        length /= 2
    return length


def probes(superquadrics: Iterable[Superquadric]) -> Array:
    """Points (n, 3) of all surfaces before deformation, by which their motion in a round is measured."""
    return np.concatenate([surface.grid(PROBES)[0] for surface in superquadrics])


def record(before: ControlBox, after: ControlBox, probes: Array, sigma: float) -> Iteration:
    """The changes by one round; `probes` (n, 3) are points of the superquadrics."""
    step, displacement = after.control_points - before.control_points, after.control_points - after.rest
    motion = after.deform(probes) - before.deform(probes)
    return Iteration(sigma, *(rms_length(vectors) for vectors in (step, displacement, motion)))
