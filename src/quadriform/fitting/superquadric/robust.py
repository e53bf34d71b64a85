"""The robust superquadric fit: from checked points to the answer with its covariance, inliers and warnings."""

from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from quadriform.errors import OptionError, WarningKind, choose
from quadriform.fitting.cloud import Distinct
from quadriform.fitting.result import SuperquadricFit
from quadriform.fitting.superquadric.batch import AXES, SHIFT
from quadriform.fitting.superquadric.identifiability import determined
from quadriform.fitting.superquadric.multistart import Problem, Solution, solve
from quadriform.fitting.superquadric_warnings import robust_warnings
from quadriform.points import Array, Frame, check_spread
from quadriform.shapes import pose
from quadriform.shapes.superquadric import EXPONENTS, Superquadric

FIXABLE = ("semi_axes", "exponents", "rotation", "translation")


def fit_robust(world: Array, kind: str, weights: Array, fixed: dict[str, ArrayLike]) -> SuperquadricFit:
    """Fit one superquadric to points (n, 3) of which some may be outliers, parts of other things, or missing.

    Args:
        world: checked points.
        kind: of the superquadric.
        weights: (n,) checked.
        fixed: held values by name, in the frame of the points.
    """
    check_spread(world[weights > 0], needed=12 if kind == "toroid" else 11)
    given = Distinct.of(world, weights)
    frame = Frame.of(given.points)
    held = _in_frame(fixed, frame)
    with np.errstate(all="ignore"):
        solution = solve(
            Problem(
                frame.to_local(given.points),
                given.weights / given.weights.mean(),
                kind,
                held,
                np.zeros(len(given.points)),
            )
        )
    inliers = given.spread(solution.descent.inliers[0])
    fit = in_world(_outcome(solution, frame.to_local(world), inliers), frame)
    return replace(fit, warnings=fit.warnings | given.warnings())


def _in_frame(fixed: dict[str, ArrayLike], frame: Frame) -> dict[str, Array]:
    """Held values, checked, in the centred and scaled frame."""
    for name in fixed:
        choose(name, FIXABLE, "fixed")
    try:
        checked = Superquadric(**fixed)  # type: ignore[arg-type]
    except OptionError as error:
        raise OptionError(f"option fixed: {error}") from error
    if "exponents" in fixed and checked.exponents.max() > EXPONENTS[1]:
        raise OptionError(f"option fixed: exponents {checked.exponents.tolist()}; fits keep them within {EXPONENTS}")
    local = checked.placed(1 / frame.scale, -frame.centre / frame.scale)
    return {name: getattr(local, name) for name in fixed}


def _outcome(solution: Solution, points: Array, inliers: Array) -> SuperquadricFit:
    """The answer in the centred and scaled frame; points and inliers as the caller gave them."""
    descent = solution.descent
    sigma = float(descent.mixture.sigma[0])
    found = cut_to(descent.candidates.superquadric(0), points[inliers >= 0.5])
    weights = descent.weights * descent.inliers[0]
    state = determined(descent.candidates, descent.derivatives[0], weights, sigma, descent.held)
    warnings = robust_warnings(found, points, inliers, sigma, descent.longest, state)
    if solution.rivals:
        warnings[WarningKind.MULTIPLE_MINIMA] = f"{solution.rivals} other surface(s) explain the points as well"
    if not solution.converged:
        warnings[WarningKind.MAX_ITERATIONS] = f"the fit had not come to rest after {len(descent.history)} steps"
    return SuperquadricFit(
        found,
        warnings,
        state.rank,
        state.condition,
        state.covariance,
        inliers,
        sigma,
        tuple(descent.history),
        len(descent.history),
    )


def in_world(fit: SuperquadricFit, frame: Frame) -> SuperquadricFit:
    """A fit made in the centred, unit-free frame, back in the unit of the data."""
    unit = np.ones(len(fit.covariance))
    unit[AXES] = unit[SHIFT] = frame.scale
    return replace(
        fit,
        superquadric=fit.superquadric.placed(frame.scale, frame.centre),
        covariance=fit.covariance * unit[:, None] * unit,
        noise=fit.noise * frame.scale,
    )


def cut_to(found: Superquadric, points: Array) -> Superquadric:
    """A hyperboloid cut where the points end; other kinds as they are."""
    if found.height is None or not len(points):
        return found
    axis = 0 if found.kind == "hyperboloid2" else 2
    reach = float(np.abs(pose.to_local(points, found.rotation, found.translation)[:, axis]).max())
    return replace(found, height=max(reach, 1.001 * found.semi_axes[0]) if axis == 0 else reach)
