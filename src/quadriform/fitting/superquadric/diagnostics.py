"""Warnings about a superquadric, one function and one text for each kind; without cause a mapping is empty."""

from quadriform.errors import WarningKind, Warnings
from quadriform.fitting.diagnostics import INLIER
from quadriform.points import Array
from quadriform.shapes.superquadric import EXPONENTS, Superquadric

POOR_SUPERQUADRIC = 0.1
"""RMS distance, as a fraction of the cloud's RMS radius, of a poor fit: larger than that of a model, because the shape
of most bodies is not that of a superquadric."""
COVERED = 0.85
"""Of a covered superquadric at least this fraction of the directions from its centre has points."""
UNDETERMINED = 1e4
"""Condition of the derivatives by the parameters of a superquadric above which some of them are not determined."""
NEAR_BOUND = 1e-3
"""A parameter this near to its bound, relative to its range for a semi-axis, lies at it."""


def not_converged(converged: bool, steps: int) -> Warnings:
    """MAX_ITERATIONS of a superquadric fit that did not converge in the steps of its last descent, on all points."""
    return {} if converged else {WarningKind.MAX_ITERATIONS: f"the superquadric fit did not converge in {steps} steps"}


def undetermined(rank: int, condition: float, parameters: int, weakest: str) -> Warnings:
    """ILL_CONDITIONED where points do not determine a superquadric, or hardly.

    Args:
        rank: number of parameters, or of combinations of them, that the points determine.
        condition: of the derivatives by the parameters.
        parameters: number of those that were estimated.
        weakest: the part of the parameters that is determined least (`Identifiability.weakest`).
    """
    determined = f"determine {rank} of {parameters}" if rank < parameters else f"hardly determine all {parameters}"
    text = f"the points {determined} superquadric parameters, least of all the {weakest}, condition {condition:.1e}"
    return {WarningKind.ILL_CONDITIONED: text} if condition > UNDETERMINED else {}


def near_symmetric(symmetric: bool) -> Warnings:
    """NEAR_SYMMETRIC of a surface of revolution, or nearly one."""
    text = "the surface looks the same when rotated: its axes are not determined"
    return {WarningKind.NEAR_SYMMETRIC: text} if symmetric else {}


def multiple_minima(others: int) -> Warnings:
    """MULTIPLE_MINIMA where other surfaces explain the points as well."""
    return {WarningKind.MULTIPLE_MINIMA: f"{others} other surface(s) explain the points as well"} if others else {}


def at_bound(found: Superquadric, longest: float) -> Warnings:
    """AT_BOUND where exponents are at the ends of their range, or a semi-axis at or above `longest`, in RMS radii."""
    parts, exponents = [], found.exponents
    if (exponents < EXPONENTS[0] + NEAR_BOUND).any() or (exponents > EXPONENTS[1] - NEAR_BOUND).any():
        parts.append(f"exponents {exponents.round(3).tolist()} at {EXPONENTS}")
    if (found.semi_axes > longest * (1 - NEAR_BOUND)).any():
        parts.append(f"a semi-axis of {found.semi_axes.max():.3g} RMS radii of the data, at or above {longest:.3g}")
    return {WarningKind.AT_BOUND: " and ".join(parts) + ": the data does not determine them"} if parts else {}


def partial_coverage(covered: float, inliers: Array) -> Warnings:
    """PARTIAL_COVERAGE where too small a fraction of the directions from the centre is covered by inliers (n,)."""
    if not (inliers >= INLIER).any():
        return {WarningKind.PARTIAL_COVERAGE: "no point is near the surface"}
    if covered >= COVERED:
        return {}
    text = (
        f"points cover {100 * covered:.0f} % of the directions from the centre; elsewhere the surface is extrapolated"
    )
    return {WarningKind.PARTIAL_COVERAGE: text}
