"""Fewer points of an isosurface, evenly spread: one for each cube of a lattice."""

from collections.abc import Mapping

import numpy as np

from quadriform.points import Array

MIN_POINTS = 750
"""Least number of points where voxels give so many: two for each of the 375 coordinates of the 5 x 5 x 5 control points
of the default box. Where there are hardly more than unknowns the surface can follow the voxel steps, and the residuals
show neither these nor their correlation."""
OFFSET = np.array([0.31830989, 0.36787944, 0.41421356])
"""Corner of a cube, in sides of a cube: 1 / pi, 1 / e and sqrt(2) - 1. Points of voxels lie at multiples of half an
edge; at a simple fraction of the side many of them would lie on a face between two cubes."""


def default_spacing(surfaces: Mapping[str, Array], voxel: Array) -> float:
    """Return the side of cubes of which each keeps one point, for surfaces (n, 3) by name from voxels with edges (3,).

    It is the longest edge, halved while a surface has fewer than MIN_POINTS points and half of it is not below the
    shortest edge.
    """
    side, least = float(voxel.max()), float(voxel.min())
    # with a smaller side than the shortest of a voxel some voxels would have several points, and others one
    while side / 2 >= least and min(len(thinned(points, side)) for points in surfaces.values()) < MIN_POINTS:
        side /= 2
    return side


def thinned(points: Array, side: float) -> Array:
    """Return one of the points (n, 3) for each cube of a lattice, the one nearest to the cube's centre, in their order.

    The cubes have this side and are fixed in the world, so the result depends neither on the order of the points nor on
    the axes of the image. A side of 0 keeps all points.
    """
    if side == 0 or not len(points):
        return points
    scaled = points / side + OFFSET
    cube = np.floor(scaled)
    off_centre = np.linalg.norm(scaled - cube - 0.5, axis=1)
    # sorted by cube, in each cube by distance from its centre: the first of each cube is kept
    order = np.lexsort((off_centre, *cube.T))
    first = np.unique(cube[order], axis=0, return_index=True)[1]
    return np.asarray(points[np.sort(order[first])])
