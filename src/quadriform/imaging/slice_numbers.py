"""The slice of its image that each point of an isosurface belongs to; slices move as a whole between breath-holds."""

import numpy as np
from numpy.typing import NDArray

from quadriform.imaging.volume import Volume
from quadriform.points import Array
from quadriform.shapes.voxels import voxel_spacing

CAP, BETWEEN = -1, -2
"""For points of no slice: beyond the first or the last outline, and between two slices."""
ON_SLICE = 1e-3
"""A point this near to a slice, in slice distances, lies in it."""
SAME_SPACING = 1e-3
"""Spacings that differ by a smaller fraction are equal."""


def slice_axis(world_from_voxel: Array) -> int:
    """Return the axis, 0 to 2, across which an image is sliced: that of the largest spacing, of equal ones the last."""
    spacing = voxel_spacing(world_from_voxel)
    return int(np.flatnonzero(spacing >= (1 - SAME_SPACING) * spacing.max())[-1])


def slice_numbers(volume: Volume, points: Array) -> NDArray[np.int64]:
    """Return the slice of each point of an isosurface, (n,), counted from 0 along the slice axis; else CAP or BETWEEN.

    Points of an isosurface lie in slices, on their outlines, or between two slices, where one voxel is inside and the
    other outside. The latter belong to neither slice: where slices moved, the steps from one to the next are no
    measurement of the wall. On caps the surface faces along the slice axis, and has no information about shifts.

    Args:
        volume: the image.
        points: (n, 3), in its world.
    """
    along = volume.voxels(points)[:, slice_axis(volume.world_from_voxel)]
    outlines = np.abs(along - np.rint(along)) < ON_SLICE
    # the outermost outlines; an isosurface that is closed ends half a voxel beyond them
    first, last = along[outlines].min(initial=np.inf), along[outlines].max(initial=-np.inf)
    caps = (along < first) | (along > last)
    return np.where(outlines, np.rint(along), np.where(caps, CAP, BETWEEN)).astype(np.int64)
