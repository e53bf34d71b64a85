"""A superquadric fitted to points, robustly or by the paper's method: input checks, search, result with warnings."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from quadriform.errors import OptionError, choose, known_options
from quadriform.fitting.cloud import Centred
from quadriform.fitting.diagnostics import INLIER, duplicates, outliers, poor_fit
from quadriform.fitting.noise import KnownNoise
from quadriform.fitting.result import SuperquadricFit
from quadriform.fitting.superquadric.candidates import AXES, SHIFT
from quadriform.fitting.superquadric.covariance import likelihood_covariance
from quadriform.fitting.superquadric.diagnostics import (
    POOR_SUPERQUADRIC,
    at_bound,
    multiple_minima,
    near_symmetric,
    not_converged,
    partial_coverage,
    undetermined,
)
from quadriform.fitting.superquadric.identifiability import identifiability_of
from quadriform.fitting.superquadric.initial import cut_to, ellipsoid_by_moments
from quadriform.fitting.superquadric.multistart import SearchResult, best_of_descents, solve
from quadriform.fitting.superquadric.paper import fit_paper
from quadriform.fitting.superquadric.problem import SearchProblem
from quadriform.fitting.superquadric.search_settings import SEARCH
from quadriform.fitting.superquadric.surroundings import Plane, Surroundings
from quadriform.fitting.support import covered_fraction
from quadriform.fitting.threads import one_blas_thread
from quadriform.point_sets import ALONE, point_set, precision_loss
from quadriform.points import Array, Frame, check_noise, check_spread, check_weights
from quadriform.shapes.kinds import KINDS
from quadriform.shapes.mesh import Mesh
from quadriform.shapes.superquadric import EXPONENTS, Superquadric

FIXABLE = ("semi_axes", "exponents", "rotation", "translation")


@known_options
@one_blas_thread
def fit_superquadric(
    points: ArrayLike | Mesh,
    kind: str = "ellipsoid",
    method: str = "robust",
    weights: ArrayLike | None = None,
    fixed: Mapping[str, ArrayLike] | None = None,
    noise: ArrayLike | None = None,
    viewpoint: ArrayLike | None = None,
    support: Plane = None,
) -> SuperquadricFit:
    """The superquadric that fits points around it.

    Args:
        points: (n, 3), in any unit and frame; at least 11 distinct ones (12 for the toroid), not on one plane. Or a
            triangle mesh, as in `fit`.
        kind: "ellipsoid" (superellipsoids, also with other exponents than one), "toroid", "hyperboloid1" or
            "hyperboloid2".
        method: "robust": allows for outliers, missing parts and other bodies, without parameters to set;
            "paper": the method of the paper, sections 2.3 and A.3: the least sum of (F - 1)^2 over the points, F the
            inside-outside function, by conjugate gradient from the ellipsoid with the moments of the points.
        weights: (n,), >= 0; a point of weight k counts as k points, one of weight 0 does not count. Not for a mesh,
            whose points are chosen here.
        fixed: values of "semi_axes" (3,), "exponents" (2,), "rotation" (3, 3) or "translation" (3,) that are fixed, as
            those of `Superquadric`: in the unit and frame of the points.
        noise: of the measurement, only for "robust": a standard deviation, one for each point (n,), or covariances
            (n, 3, 3), in the unit of the points; of a mesh a standard deviation. Each distance is divided by the
            standard deviation of its point along the normal that its neighbours suggest, before any fit, relative to
            the others; and the estimated noise of the fit is at least the known one.
        viewpoint: position (3,) of the sensor, or for each point (n, 3) where it was seen from, in the unit and frame
            of the points; only for "robust". Surface in its view, where it measured nothing, is penalised. Points have
            a position in common where all its digits are equal. The eight positions that saw most inliers are used,
            of these only those that saw at least 100.
        support: a plane that the body does not pass, as (point, normal), such as the table it stands on, in the unit
            and frame of the points; its side is that of most points. At most a quarter of the points may lie beyond it,
            so the points of the table itself are to be removed first. Only for "robust".

    Raises:
        PointsError, DegenerateError, OptionError: the input cannot be fitted.
    """
    choose(kind, tuple(KINDS), "kind")
    choose(method, ("robust", "paper"), "method")
    checked = point_set(points, weights=weights)
    world = checked.points
    covariances = checked.noise if noise is None else check_noise(noise, len(world))
    # as the points, these stay in the unit in which they were given (`fit` converts both: `surroundings_by_name`)
    surroundings = None if viewpoint is None and support is None else Surroundings.of(world, viewpoint, support)
    if method == "robust":
        found = fit_robust(
            world, kind, check_weights(weights, len(world)), dict(fixed or {}), covariances, surroundings
        )
    elif weights is not None or fixed or noise is not None or surroundings is not None:
        raise OptionError(
            "method='paper' takes neither weights nor fixed, noise, viewpoint or support; use method='robust'"
        )
    else:
        found = fit_by_paper(world, kind)
    precision = precision_loss(checked.number_type, world)
    return replace(found, warnings=precision | found.warnings, notes=(*checked.notes, *found.notes))


def fit_by_paper(world: Array, kind: str) -> SuperquadricFit:
    """The paper's fit to checked points (n, 3), in their unit and frame."""
    check_spread(world, needed=KINDS[kind].n_parameters)
    frame = Frame.of(world)
    return fit_to_world(fit_paper(frame.to_local(world), kind), frame)


def fit_robust(
    world: Array,
    kind: str,
    weights: Array,
    fixed: dict[str, ArrayLike],
    noise: Array | None,
    surroundings: Surroundings | None = None,
) -> SuperquadricFit:
    """The superquadric of points (n, 3) of which some may be outliers, of other bodies, or missing.

    Args:
        world: checked points.
        kind: of the superquadric.
        weights: (n,) checked.
        fixed: fixed values by name, in the frame of the points.
        noise: (n, 3, 3) covariances of the points, checked, where they are known.
        surroundings: what is known beside the points, in their frame, or None.
    """
    if fixed.keys() >= set(FIXABLE) and not KINDS[kind].has_hole:
        raise OptionError(f"option fixed: nothing is left to fit; expected at most three of {', '.join(FIXABLE)}")
    check_spread(world[weights > 0], needed=KINDS[kind].n_parameters)
    centred = Centred.of({ALONE: world}, {ALONE: weights})
    frame, distinct = centred.frame, centred.distinct[ALONE]
    local = centred.points[ALONE]
    known_noise = KnownNoise.of({} if noise is None else {ALONE: noise}, centred)
    problem = SearchProblem(
        local,
        centred.weights[ALONE],
        kind,
        fixed=_fixed_to_local(fixed, frame),
        log_odds=np.zeros(len(local)),
        relative_noise=known_noise.deviations(ALONE, centred),
        least_sigma=known_noise.least_sigma,
        surroundings=None if surroundings is None else surroundings.to_local(distinct, frame),
    )
    with np.errstate(all="ignore"):
        solution = solve(problem)
    inliers = distinct.expand_to_duplicates(solution.descent.inliers[0])
    fit = fit_to_world(_outcome(solution, frame.to_local(world), inliers, known_noise.least_sigma), frame)
    return replace(fit, warnings=fit.warnings | duplicates(distinct.copies, len(world)))


def plain_ellipsoid(points: Array, robust: Superquadric) -> Superquadric:
    """The true ellipsoid, with exponents of one, that is reached from the moments of all points or their robust fit.

    Points (n, 3), `robust` and the result are in the centred, scaled frame.
    """
    ones, fixed = np.ones(len(points)), {"exponents": np.ones(2)}
    problem = SearchProblem(points, ones, "ellipsoid", fixed, log_odds=np.zeros(len(points)), relative_noise=ones)
    with np.errstate(all="ignore"):
        return best_of_descents(problem, [ellipsoid_by_moments(points), robust])


def _fixed_to_local(fixed: dict[str, ArrayLike], frame: Frame) -> dict[str, Array]:
    """Fixed values, checked, in the centred and scaled frame."""
    for name in fixed:
        choose(name, FIXABLE, "fixed")
    try:
        checked = Superquadric(**fixed)  # type: ignore[arg-type]
    except OptionError as error:
        raise OptionError(f"option fixed: {error}") from error
    if "exponents" in fixed and checked.exponents.max() > EXPONENTS[1]:
        raise OptionError(f"option fixed: exponents {checked.exponents.tolist()}; fits keep them within {EXPONENTS}")
    local = frame.shape_to_local(checked)
    return {name: getattr(local, name) for name in fixed}


def _outcome(solution: SearchResult, points: Array, inliers: Array, least_sigma: float) -> SuperquadricFit:
    """The fit in the centred and scaled frame.

    Args:
        solution: of the search.
        points: (n, 3), all that the caller gave, in that frame.
        inliers: (n,), their probabilities.
        least_sigma: the known standard deviation of the points along the normal, the lower bound of sigma.
    """
    descent = solution.descent
    sigma = float(descent.mixture.sigma[0])
    found = cut_to(descent.candidates.superquadric(0), points[inliers >= INLIER])
    weights = descent.weights * descent.inliers[0]
    state = identifiability_of(descent.candidates, descent.derivatives[0], weights, sigma, descent.fixed_mask)
    steps = len(descent.history)
    warnings = (
        undetermined(state.rank, state.condition, descent.problem.n_estimated, state.weakest)
        | near_symmetric(state.symmetric)
        | outliers(inliers)
        | partial_coverage(covered_fraction(found, points[inliers >= INLIER]), inliers)
        # sigma is the RMS distance of the inliers, so it is judged like one distance
        | poor_fit(np.array([sigma]), limit=POOR_SUPERQUADRIC, known=least_sigma**2)
        | at_bound(found, descent.problem.longest)
        | multiple_minima(solution.n_alternatives)
        | not_converged(solution.converged, steps)
    )
    # without noise the distances are rounding, and so is the curvature of their likelihood
    covariance = state.covariance if sigma < SEARCH.exact else likelihood_covariance(descent)
    history = tuple(descent.history)
    return SuperquadricFit(found, warnings, state.rank, state.condition, covariance, inliers, sigma, history, steps)


def fit_to_world(fit: SuperquadricFit, frame: Frame) -> SuperquadricFit:
    """A fit made in the centred, unit-free frame, back in the unit of the data."""
    return _in_unit(fit, frame.shape_to_world(fit.superquadric), frame.scale)


def fit_to_local(fit: SuperquadricFit, frame: Frame) -> SuperquadricFit:
    """A fit in the unit of the data in a centred, unit-free frame."""
    return _in_unit(fit, frame.shape_to_local(fit.superquadric), 1 / frame.scale)


def _in_unit(fit: SuperquadricFit, moved: Superquadric, scale: float) -> SuperquadricFit:
    unit = np.ones(len(fit.covariance))
    unit[AXES] = unit[SHIFT] = scale  # exponents, angles and the hole radius have no unit
    covariance = fit.covariance * unit[:, None] * unit
    return replace(fit, superquadric=moved, covariance=covariance, noise=fit.noise * scale)
