"""Longitudinal contours of the cavity: sections of the endocardium with planes through the long axis."""

import numpy as np

from quadriform.heart.axis import LongAxis
from quadriform.heart.base import BasePlane
from quadriform.heart.volumes import section
from quadriform.points import Array, unit_vectors
from quadriform.shapes.mesh import Mesh

CUTS = 12


def contour_length(mesh: Mesh, axis: LongAxis, base: BasePlane | None) -> float:
    """Return the mean length of the contours in 12 planes through the long axis, from base over apex to base.

    Args:
        mesh: of a closed surface.
        axis: the long axis of that frame.
        base: the plane at the base of that frame; None: the whole closed contour.
    """
    total = 0.0
    for across in _directions(axis):
        segments = section(mesh, BasePlane(axis.apex, across))
        lengths = np.linalg.norm(segments[1] - segments[0], axis=1)
        total += float(lengths @ _fraction_below(segments, base))
    return total / CUTS


def _fraction_below(segments: Array, base: BasePlane | None) -> Array:
    """The fraction (m,) of each segment that lies below the base."""
    if base is None:
        return np.ones(segments.shape[1])
    # heights along a segment are linear
    low, high = np.sort([base.heights(ends) for ends in segments], axis=0)
    return np.clip(-low / np.maximum(high - low, 1e-300), 0, 1)


def _directions(axis: LongAxis) -> Array:
    """Unit vectors (CUTS, 3) across the axis, evenly over half a revolution."""
    # the coordinate axis that is least along the long axis has the longest component across it
    first = unit_vectors(axis.across(np.eye(3))[np.abs(axis.direction).argmin()])
    angles = np.pi * np.arange(CUTS)[:, None] / CUTS
    return np.cos(angles) * first + np.sin(angles) * np.cross(axis.direction, first)
