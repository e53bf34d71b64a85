"""What is to be said of a superquadric fitted robustly."""

import numpy as np

from quadriform.errors import WarningKind, Warnings
from quadriform.fitting.coverage import coverage_warning
from quadriform.fitting.superquadric.identifiability import UNDETERMINED, Determined
from quadriform.points import Array
from quadriform.shapes.superquadric import EXPONENTS, Superquadric

NEAR_BOUND = 1e-3
SYMMETRIC_TURN = 0.2
"""An axis known no better than this, in radians, is an axis of symmetry for all that the data says."""
POOR = 0.1
"""Noise above this share of the cloud's RMS radius is no surface of this kind, or no surface."""
NAMED = 5
"""How many outliers are named by index."""


def robust_warnings(
    found: Superquadric,
    points: Array,
    inliers: Array,
    sigma: float,
    longest: float,
    state: Determined,
) -> Warnings:
    """Warnings from the answer itself.

    Args:
        found: in the frame of the points.
        points: (n, 3) centred and scaled, as the caller gave them otherwise.
        inliers: (n,) probability of each.
        sigma: noise.
        longest: the bound of the semi-axes.
        state: what the derivatives say.
    """
    warnings: Warnings = {}
    if state.condition > UNDETERMINED:
        warnings[WarningKind.ILL_CONDITIONED] = (
            f"the points determine {state.rank} of {len(found.parameters)} parameters, condition {state.condition:.1e}"
        )
    if state.symmetric or state.turn_spread > SYMMETRIC_TURN:
        warnings[WarningKind.NEAR_SYMMETRIC] = "the surface looks the same when turned: its axes are not determined"
    outside = np.flatnonzero(inliers < 0.5)
    if len(outside):
        named = ", ".join(map(str, outside[:NAMED])) + (", ..." if len(outside) > NAMED else "")
        warnings[WarningKind.OUTLIERS] = f"{len(outside)} of {len(points)} points are not of the surface: {named}"
    coverage = coverage_warning(found, points[inliers >= 0.5]) if (inliers >= 0.5).any() else "no point is near"
    if coverage:
        warnings[WarningKind.PARTIAL_COVERAGE] = coverage
    if sigma > POOR:
        warnings[WarningKind.POOR_FIT] = (
            f"noise is {100 * sigma:.0f} % of the cloud's RMS radius: a filled volume, several bodies or another kind?"
        )
    bound = _at_bound(found, longest)
    if bound:
        warnings[WarningKind.AT_BOUND] = bound
    return warnings


def _at_bound(found: Superquadric, longest: float) -> str:
    parts = []
    e = found.exponents
    if (e < EXPONENTS[0] + NEAR_BOUND).any() or (e > EXPONENTS[1] - NEAR_BOUND).any():
        parts.append(f"exponents {e.round(3).tolist()} at {EXPONENTS}")
    if (found.semi_axes > longest * (1 - NEAR_BOUND)).any():
        parts.append("a semi-axis at twice the extent of the data")
    return " and ".join(parts) + ": the data does not hold them" if parts else ""
