"""Which slice of its image each point of an isosurface belongs to: slices are what moves between breath-holds."""

import numpy as np
from numpy.typing import NDArray

from quadriform.imaging.volume import Volume
from quadriform.points import Array

BETWEEN = -1
"""The number of points that are of no slice."""
ON_SLICE = 1e-3
"""A point this near to a slice, in slice distances, lies in it."""
ALIKE = 1e-3
"""Spacings that differ by a smaller share are equal."""


def slice_axis(world_from_voxel: Array) -> int:
    """The axis, 0 to 2, across which an image is sliced: the one of the largest spacing, of equal ones the last."""
    spacing = np.linalg.norm(world_from_voxel[:3, :3], axis=0)
    return int(np.flatnonzero(spacing >= (1 - ALIKE) * spacing.max())[-1])


def slice_numbers(volume: Volume, points: Array) -> NDArray[np.int64]:
    """The slice of each point of an isosurface, (n,), counted from 0 along the slice axis.

    An isosurface's points lie in slices, on their outlines, or between two slices, where one is inside and the other
    outside. The latter are BETWEEN: they are of both and would move with neither, for the steps of a wall from slice to
    slice are no measurement of where it is. Those of the caps, beyond the first and the last outline, are of these.

    Args:
        volume: the image.
        points: (n, 3), in its world.
    """
    along = volume.voxels(points)[:, slice_axis(volume.world_from_voxel)]
    outlines = np.abs(along - np.rint(along)) < ON_SLICE
    if not outlines.any():
        return np.full(len(points), BETWEEN)
    along = along.clip(along[outlines].min(), along[outlines].max())
    nearest = np.rint(along)
    return np.where(np.abs(along - nearest) < ON_SLICE, nearest, BETWEEN).astype(np.int64)
